"""What people wish of a loop that runs in another thread: done there, in order."""

import queue
from collections.abc import Callable

from dovetail.errors import DovetailError


class Wishes:
    """Left by any thread, fulfilled by the loop's."""

    def __init__(self) -> None:
        """Begin without one."""
        self._queue: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()

    def put(self, wish: Callable[[], None]) -> None:
        """Leave a wish."""
        self._queue.put(wish)

    def fulfil(self, say: Callable[[str], None]) -> None:
        """Do what was wished for; a wish that fails is said and forgotten."""
        while True:
            try:
                wish = self._queue.get_nowait()
            except queue.Empty:
                return
            try:
                wish()
            except DovetailError as error:
                say(str(error))
