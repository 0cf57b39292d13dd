"""Where the hole is, as far as the environment may know."""

from typing import NamedTuple, Protocol

from dovetail.poses import Pose


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

    def estimate(self) -> HoleEstimate:
        """Return the true pose with age 0."""
        if self._hole is None:
            raise RuntimeError("TrueHole: call reset(hole) before estimate()")
        return HoleEstimate(self._hole, 0.0)
