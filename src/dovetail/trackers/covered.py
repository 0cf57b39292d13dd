"""A camera that was covered before the episode, and the fixture then moved."""

import math

import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.settings import Range, in_range
from dovetail.trackers.tracker import Estimate
from dovetail.types import Vec3

_DOUBT = Range(0.0, 0.05, "m")
_TURN = Range(0.0, 0.5, "rad")
_STREAM = 0xC07E3D
"""Keeps these draws apart from those of start and fixture, which have the same seed."""


class Covered:
    """The estimate is the last one seen: off by `shift`, and of growing age."""

    def __init__(self, doubt: float = 0.0, turn: float = 0.0) -> None:
        """Take how far the fixture may have been moved and turned.

        Args:
            doubt: Largest horizontal shift [m], drawn for each episode, its place
                anywhere in the circle alike. 0 leaves `shift` as it was set.
            turn: Largest turn about the vertical [rad], drawn for each episode.

        Raises:
            ConfigError: Out of range.
        """
        self.doubt = in_range("tracker doubt", doubt, _DOUBT)
        self.shift: Vec3 = np.zeros(3)
        """Motion of the fixture since it was seen last [m], world axes."""
        self.turn = in_range("tracker turn", turn, _TURN)
        self._seen: Pose | None = None
        self._age = 0.0

    def reset(self, fixture: Pose, seed: int) -> None:
        """Remember where a fixture that now is at `fixture` was seen last."""
        rng = np.random.default_rng([_STREAM, seed])
        if self.doubt > 0.0:
            angle = rng.uniform(-math.pi, math.pi)
            away = np.array([math.cos(angle), math.sin(angle), 0.0])
            self.shift = self.doubt * math.sqrt(rng.uniform()) * away
        turned = quat_about_z(self.turn * rng.uniform(-1.0, 1.0))
        self._seen = Pose(
            fixture.position - self.shift, quat_multiply(turned, fixture.quat_wxyz)
        )
        self._age = 0.0

    def update(self, fixture: Pose, state: ArmState) -> None:
        """See nothing: time passes."""
        self._age = state.stamp

    def estimate(self) -> Estimate:
        """Return the pose that was seen last and the time since the episode began."""
        if self._seen is None:
            raise RuntimeError("Covered: call reset(fixture, seed) before estimate()")
        return Estimate(self._seen, self._age)
