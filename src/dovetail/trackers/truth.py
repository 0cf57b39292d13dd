"""The simulation's truth, never late: the reference for every other tracker."""

from dovetail.arms.arm import ArmState
from dovetail.poses import Pose
from dovetail.trackers.tracker import Estimate


class Truth:
    """Knows where the fixture is."""

    def __init__(self) -> None:
        self._fixture: Pose | None = None

    def reset(self, fixture: Pose, seed: int) -> None:
        """Remember the true pose."""
        self._fixture = fixture

    def update(self, fixture: Pose, state: ArmState) -> None:
        """Follow the fixture without delay."""
        self._fixture = fixture

    def estimate(self) -> Estimate:
        """Return the true pose with age 0."""
        if self._fixture is None:
            raise RuntimeError("Truth: call reset(fixture, seed) before estimate()")
        return Estimate(self._fixture, 0.0)
