"""A camera that was covered before the episode, and the fixture then moved."""

import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.poses import Pose
from dovetail.trackers.tracker import Estimate
from dovetail.types import Vec3


class Covered:
    """The estimate is the last one seen: off by `shift`, and of growing age."""

    def __init__(self) -> None:
        self.shift: Vec3 = np.zeros(3)
        """How far the fixture was moved after it was seen last [m], world axes."""
        self._seen: Pose | None = None
        self._age = 0.0

    def reset(self, fixture: Pose, seed: int) -> None:
        """Remember where a fixture that now is at `fixture` was seen last."""
        self._seen = fixture._replace(position=fixture.position - self.shift)
        self._age = 0.0

    def update(self, fixture: Pose, state: ArmState) -> None:
        """See nothing: time passes."""
        self._age = state.stamp

    def estimate(self) -> Estimate:
        """Return the pose that was seen last and the time since the episode began."""
        if self._seen is None:
            raise RuntimeError("Covered: call reset(fixture, seed) before estimate()")
        return Estimate(self._seen, self._age)
