"""Seat of the driver: one viewer of the page; the others watch, and may stop."""

import threading
import time
from collections.abc import Callable

PATIENCE = 60.0
"""Time without input, while the arm stands, after which another viewer may drive [s].
A browser may keep a page that was left, and so may a closed laptop."""


class Seat:
    """Seat of the one viewer who drives: the first to ask, until that one leaves."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin empty.

        Args:
            clock: Tells the time [s].
        """
        self._lock, self._clock = threading.Lock(), clock
        self._driver: int | None = None
        self._asked = 0.0  # when the driver did something last

    @property
    def driver(self) -> int | None:
        """Number of the viewer who drives; None if the seat is free."""
        return self._driver

    def take(self, viewer: int, *, is_standing: bool = False) -> bool:
        """Take the seat if it is free; say whether the viewer has it.

        Args:
            viewer: Who does something.
            is_standing: Whether nothing moves; then the seat of a driver who has done
                nothing for `PATIENCE` is free.
        """
        with self._lock:
            now = self._clock()
            is_left = is_standing and now - self._asked > PATIENCE
            if self._driver is None or is_left:
                self._driver = viewer
            if self._driver == viewer:
                self._asked = now
            return self._driver == viewer

    def leave(self, viewer: int) -> bool:
        """Give the seat back; say whether the viewer had it."""
        with self._lock:
            if self._driver != viewer:
                return False
            self._driver = None
            return True
