"""Simulated time beside the wall's: as fast as asked, and how well that is kept."""

import time
from collections import deque
from collections.abc import Callable

SPEED_MIN, SPEED_MAX = 0.05, 4.0
"""Range of the speed [1]: simulated over wall time."""
LATE_MAX = 0.25
"""Largest part of a delay that is caught up [s]; the rest is lost."""
_WINDOW = 2.0  # [s] of wall time over which the rate is measured


class Pace:
    """Makes a simulation wait for the wall's clock."""

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Begin now, at real time.

        Args:
            clock: Monotonic time [s].
            sleep: Waits for a time [s].
        """
        self._clock, self._sleep = clock, sleep
        self._speed = 1.0
        self.begin()

    def begin(self) -> None:
        """Begin anew, after a pause: what lies behind is not caught up."""
        self._due = self._clock()
        self._past: deque[tuple[float, float]] = deque([(self._due, 0.0)])

    @property
    def speed(self) -> float:
        """Simulated time over wall time [1]."""
        return self._speed

    @speed.setter
    def speed(self, value: float) -> None:
        self._speed = min(max(value, SPEED_MIN), SPEED_MAX)
        self.begin()

    def wait(self, duration: float) -> None:
        """Wait until a duration [s] that was simulated is over on the wall, too."""
        self._due += duration / self._speed
        ahead = self._due - self._clock()
        if ahead > 0.0:
            self._sleep(ahead)
        elif ahead < -LATE_MAX:
            self._due -= ahead + LATE_MAX
        now, past = self._clock(), self._past
        past.append((now, past[-1][1] + duration))
        while len(past) > 2 and past[1][0] < now - _WINDOW:
            past.popleft()

    @property
    def rate(self) -> float:
        """Simulated over wall time in the last 2 s, over the speed asked for [1]."""
        (begin, before), (end, after) = self._past[0], self._past[-1]
        if end <= begin:
            return 1.0
        return (after - before) / (end - begin) / self._speed
