"""A camera whose picture is old: every estimate is what was true a while ago."""

from collections import deque
from typing import Annotated

from dovetail.arms.arm import ArmState
from dovetail.poses import Pose
from dovetail.settings import Range, in_range
from dovetail.trackers.tracker import Estimate

_DELAY = Range(0.0, 10.0, "s")
_ROUNDING = 1e-9  # s, of stamps that are sums of periods


class Delayed:
    """Tells the newest pose that is at least `delay` old; before, that of the start."""

    def __init__(self, delay: Annotated[float, _DELAY] = 0.1) -> None:
        """Take the age of a picture when it is used [s].

        Raises:
            ConfigError: Out of range.
        """
        self.delay = in_range("tracker delay", delay, _DELAY)
        self._past: deque[tuple[float, Pose]] = deque()
        self._now = 0.0

    def reset(self, fixture: Pose, seed: int) -> None:
        """Begin with the fixture where it is: it stood there before."""
        self._past = deque([(0.0, fixture)])
        self._now = 0.0

    def update(self, fixture: Pose, state: ArmState) -> None:
        """Take a picture, and forget those that are older than needed."""
        self._now = state.stamp
        self._past.append((state.stamp, fixture))
        old = self._now - self.delay + _ROUNDING
        while len(self._past) > 1 and self._past[1][0] <= old:
            self._past.popleft()

    def estimate(self) -> Estimate:
        """Return the newest pose that is old enough, and its age."""
        stamp, pose = self._past[0]
        return Estimate(pose, self._now - stamp)
