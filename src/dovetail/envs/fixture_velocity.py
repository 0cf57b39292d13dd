"""Velocity of the fixture, fitted to the positions where a tracker saw it."""

import math
from collections import deque

import numpy as np

from dovetail.poses import Pose
from dovetail.trackers.tracker import Estimate
from dovetail.types import Vec3

WINDOW = 8
"""Sights that the velocity is fitted to; at 50 ms each 0.35 s."""
FASTEST = 0.1
"""Largest speed that is followed [m/s]; what is seen to jump further is a new place."""
LONGEST = 0.25
"""Age of the last sight from which on nothing is known of the motion [s]."""
STANDS: Vec3 = np.zeros(3)
"""Velocity of a fixture that stands [m/s]."""
STANDS.setflags(write=False)
_JUMP = 3e-3  # [m] that noise may add to a way
_CERTAIN = 6.0  # standard deviations between a velocity and noise
_RESOLUTION = 1e-5  # [m], below any sensor's


class FixtureVelocity:
    """Fits a line to the last sights; where noise explains it, the fixture stands."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=WINDOW)
        self._positions: deque[list[float]] = deque(maxlen=WINDOW)
        self._same = 0  # sights in a row that are like the one before

    def reset(self) -> None:
        """Forget what was seen."""
        self._times.clear()
        self._positions.clear()
        self._same = 0

    def follow(self, estimate: Estimate, now: float) -> tuple[Pose, Vec3]:
        """Return where the fixture is by now, and its velocity [m/s], world axes.

        Args:
            estimate: What the tracker says.
            now: Time of the episode [s].
        """
        pose, seen = estimate.pose, now - estimate.age
        if not self._times or seen > self._times[-1] + 1e-6:
            self._take(seen, pose.position.tolist())
        if self._same >= WINDOW or now - self._times[-1] >= LONGEST:
            return pose, STANDS
        velocity = self._fit()
        if velocity is STANDS:
            return pose, STANDS
        position = pose.position + estimate.age * velocity
        return pose._replace(position=position), velocity

    def _take(self, seen: float, position: list[float]) -> None:
        if self._times:
            way = math.dist(position, self._positions[-1])
            self._same = self._same + 1 if way == 0.0 else 0
            if way > FASTEST * (seen - self._times[-1]) + _JUMP:
                self.reset()
        self._times.append(seen)
        self._positions.append(position)

    def _fit(self) -> Vec3:
        count = len(self._times)
        if count < WINDOW:
            return STANDS
        p = np.array(self._positions)
        if np.ptp(p, axis=0).max() < _RESOLUTION:
            return STANDS
        t = np.array(self._times)
        t -= t.mean()
        spread = t @ t
        velocity = t @ p / spread
        rest = p - p.mean(axis=0) - np.outer(t, velocity)
        sigma = np.sqrt((rest**2).sum() / (3 * (count - 2)) + _RESOLUTION**2)
        speed = float(np.linalg.norm(velocity))
        if speed < _CERTAIN * sigma / np.sqrt(spread):
            return STANDS
        return velocity * min(1.0, FASTEST / speed)
