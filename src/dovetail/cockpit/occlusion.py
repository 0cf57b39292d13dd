"""A camera that a user covers and uncovers while the arm moves."""

from dovetail.arms.arm import ArmState
from dovetail.poses import Pose
from dovetail.trackers.covered import Covered
from dovetail.trackers.tracker import Estimate, Tracker, close_tracker, is_on_arm


class Occlusion:
    """Wraps a tracker: covered, its estimate is the last one, and grows old."""

    def __init__(self, tracker: Tracker) -> None:
        """Wrap the tracker that looks while the camera is free."""
        self._tracker = tracker
        self._covered: Covered | None = None
        self._is_up = False  # a camera on the arm looks from above, covered later
        self.is_covered = False
        """True to cover the camera; it acts from the next look on."""

    def reset(self, fixture: Pose, seed: int) -> None:
        """Start an episode; a covered camera has seen where the fixture stands now."""
        self._tracker.reset(fixture, seed)
        self._covered = None
        self._is_up = self.is_on_arm
        if self.is_covered and not self._is_up:
            self._cover()

    @property
    def is_on_arm(self) -> bool:
        """True if the camera is on the flange."""
        return is_on_arm(self._tracker)

    def rewind(self, fixture: Pose) -> None:
        """Start the episode again, with the estimate from above."""
        if is_on_arm(self._tracker):
            self._tracker.rewind(fixture)
        self._is_up = False

    def update(self, fixture: Pose, state: ArmState) -> None:
        """Look, or let time pass."""
        if self.is_covered and self._covered is None and not self._is_up:
            self._cover()
        elif not self.is_covered:
            self._covered = None
        (self._covered or self._tracker).update(fixture, state)

    def _cover(self) -> None:
        self._covered = Covered()
        self._covered.reset(self._tracker.estimate().pose, 0)

    def estimate(self) -> Estimate:
        """Return the newest estimate."""
        return (self._covered or self._tracker).estimate()

    def close(self) -> None:
        """Release the tracker; harmless when repeated."""
        close_tracker(self._tracker)
