"""Positions that a client has commanded, as they arrive over a wire with a delay."""

import math
from collections import deque

import numpy as np

from dovetail.types import Vec7


class LatePath:
    """The last commanded positions, one per period, and when each of them acts.

    A twin's delay is the wire's: the cabinet's own servo and impedance, which are local
    to the joints, follow late commands without delay.
    """

    def __init__(self, period: float, delay: float) -> None:
        """Begin without a position.

        Args:
            period: Time between two positions [s].
            delay: From a command to its effect [s].
        """
        self._period = period
        self._delay = delay
        self._points: deque[Vec7] = deque(maxlen=math.ceil(delay / period) + 2)

    def clear(self) -> None:
        """Forget every position."""
        self._points.clear()

    def add(self, q: Vec7) -> None:
        """Begin a period with a new position [rad]."""
        if not self._points:
            self._points.append(q)
        self._points.append(q)

    def held(self, time: float) -> Vec7:
        """Return the position [rad] that has arrived at a time in the period [s]."""
        age = math.ceil((self._delay - time) / self._period - 1e-9)
        return self._point(-1 - max(age, 0))

    def passed(self, time: float) -> tuple[Vec7, Vec7]:
        """Return where a straight way from point to point is at a time in the period.

        Args:
            time: Since the newest position was added, at most a period [s].

        Returns:
            Position [rad] and velocity [rad/s].
        """
        way = (time - self._delay) / self._period
        segment = math.ceil(way - 1e-9) - 1  # 0 leads to the newest position
        end, start = self._point(-1 + segment), self._point(-2 + segment)
        dq = (end - start) / self._period
        return np.asarray(start + (way - segment) * self._period * dq), dq

    def _point(self, index: int) -> Vec7:
        """Return a position by its index from the end; the oldest for one before."""
        return self._points[max(index, -len(self._points))]
