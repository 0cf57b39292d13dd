"""Stops of a motion: the categories of IEC 60204-1, and the ramp of category 1."""

from enum import IntEnum

import numpy as np

from dovetail.types import Vec7

DECELERATION = 30.0
"""Deceleration of the fastest joint on the ramp [rad/s2]: 0.25 m/s, which is some
0.5 rad/s, ends in 17 ms, and the fastest joint at its limit in 80 ms."""


class StopCategory(IntEnum):
    """Way to bring the arm to rest; afterwards the brakes hold it."""

    BRAKES = 0
    """Drives off, brakes at once: every joint stops as soon as it can."""
    RAMP = 1
    """The drives stop the arm on its path, then the brakes close."""
    HOLD = 2
    """As category 1; a real arm's drives stay on."""


class Ramp:
    """A straight way in joint space on which every joint stops at the same time."""

    def __init__(self, q: Vec7, dq: Vec7) -> None:
        """Begin where the arm is.

        Args:
            q: Configuration [rad].
            dq: Velocity [rad/s].
        """
        self._q, self._dq = q, dq
        self.duration = float(np.abs(dq).max()) / DECELERATION
        """From the beginning to rest [s]."""
        self.time = 0.0
        """Time since the beginning [s]."""

    @property
    def is_over(self) -> bool:
        """True once every joint is at rest."""
        return self.time >= self.duration

    def advance(self, duration: float) -> tuple[Vec7, Vec7, Vec7]:
        """Go on for a duration [s].

        Returns:
            Configuration [rad], velocity [rad/s] and acceleration [rad/s2] then.
        """
        self.time += duration
        if self.is_over:
            zero = np.zeros(7)
            return self._q + 0.5 * self.duration * self._dq, zero, zero
        share = self.time / self.duration
        q = self._q + self.time * (1.0 - 0.5 * share) * self._dq
        return q, (1.0 - share) * self._dq, -self._dq / self.duration
