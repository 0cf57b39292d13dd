"""Who drives: one viewer of the page at a time; the others watch, and may stop."""

import threading


class Seat:
    """Taken by the first who asks, free again when that one leaves the page."""

    def __init__(self) -> None:
        """Begin empty."""
        self._lock = threading.Lock()
        self._driver: int | None = None

    @property
    def driver(self) -> int | None:
        """Number of the viewer who drives; None is nobody."""
        return self._driver

    def take(self, viewer: int) -> bool:
        """Take the seat if it is free; say whether the viewer has it."""
        with self._lock:
            if self._driver is None:
                self._driver = viewer
            return self._driver == viewer

    def leave(self, viewer: int) -> bool:
        """Give the seat back; say whether the viewer had it."""
        with self._lock:
            if self._driver != viewer:
                return False
            self._driver = None
            return True
