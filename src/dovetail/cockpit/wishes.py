"""Commands to a loop that runs in another thread: done there, in order."""

import queue
from collections.abc import Callable

from dovetail.errors import DovetailError


class Wishes:
    """Queue of commands: any thread adds one, the loop's thread carries them out."""

    def __init__(self) -> None:
        """Begin empty."""
        self._queue: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()

    def put(self, wish: Callable[[], None]) -> None:
        """Add a command."""
        self._queue.put(wish)

    def fulfil(self, say: Callable[[str], None]) -> None:
        """Carry out the commands; one that fails is reported and dropped."""
        while True:
            try:
                wish = self._queue.get_nowait()
            except queue.Empty:
                return
            try:
                wish()
            except DovetailError as error:
                say(str(error))
