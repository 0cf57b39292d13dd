"""How a command that runs until it is told to end is told: Ctrl-C, SIGTERM."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue


class End:
    """Whether a command was told to end, and waiting for it.

    Not a `threading.Event`: a handler that sets it while the same thread holds its
    lock, as a second signal's does in the first one's, waits for itself for ever.
    """

    def __init__(self) -> None:
        self._told: SimpleQueue[int] = SimpleQueue()

    def tell(self, number: int, frame: object = None) -> None:
        """Tell it; a signal's handler, and harmless when repeated."""
        self._told.put(number)

    def is_told(self) -> bool:
        """Whether it was told."""
        return not self._told.empty()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until it is told, or a time [s] is over; return whether it was told."""
        try:
            self._told.put(self._told.get(timeout=seconds))  # for whoever asks next
        except Empty:
            return False
        return True


@contextmanager
def ended_by_signal() -> Iterator[End]:
    """Give what Ctrl-C and SIGTERM tell, in place of what they usually do.

    Told, not raised: an exception would come anywhere, and a second signal, such as
    `timeout` sends, in the middle of what is cleaned up after the first.
    """
    end = End()
    before = {
        number: signal.signal(number, end.tell)
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield end
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
