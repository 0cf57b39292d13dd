"""Where the hole is, as far as the environment may know."""

from typing import NamedTuple, Protocol

import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.poses import Pose
from dovetail.types import Vec3


class HoleEstimate(NamedTuple):
    """One estimate of the hole's pose."""

    pose: Pose
    """Mouth centre [m] and rotation (z out of the hole), world axes."""
    age: float
    """Time since it was measured [s]."""


class HoleTracker(Protocol):
    """Anything that can say where the hole is."""

    def reset(self, hole: Pose) -> None:
        """Start an episode whose hole really is at `hole`."""
        ...

    def update(self, hole: Pose, state: ArmState) -> None:
        """Take in what has happened since the last call.

        Args:
            hole: Where the hole really is; a tracker that looks for itself ignores it.
            state: What the arm has measured; `stamp` is the episode's time [s].
        """
        ...

    def estimate(self) -> HoleEstimate:
        """Return the newest estimate."""
        ...


class TrueHole:
    """The simulation's truth, never late: the reference for every other tracker."""

    def __init__(self) -> None:
        self._hole: Pose | None = None

    def reset(self, hole: Pose) -> None:
        """Remember the true pose."""
        self._hole = hole

    def update(self, hole: Pose, state: ArmState) -> None:
        """Follow the hole without delay."""
        self._hole = hole

    def estimate(self) -> HoleEstimate:
        """Return the true pose with age 0."""
        if self._hole is None:
            raise RuntimeError("TrueHole: call reset(hole) before estimate()")
        return HoleEstimate(self._hole, 0.0)


class CoveredHole:
    """A camera that was covered before the episode, and the hole then moved.

    The estimate is the last one seen: off by `shift`, and of growing age.
    """

    def __init__(self) -> None:
        self.shift: Vec3 = np.zeros(3)
        """How far the hole was moved after it was seen last [m], world axes."""
        self._seen: Pose | None = None
        self._age = 0.0

    def reset(self, hole: Pose) -> None:
        """Remember where a hole that now is at `hole` was seen last."""
        self._seen = hole._replace(position=hole.position - self.shift)
        self._age = 0.0

    def update(self, hole: Pose, state: ArmState) -> None:
        """See nothing: time passes."""
        self._age = state.stamp

    def estimate(self) -> HoleEstimate:
        """Return the pose that was seen last and the time since the episode began."""
        if self._seen is None:
            raise RuntimeError("CoveredHole: call reset(hole) before estimate()")
        return HoleEstimate(self._seen, self._age)
