"""End of a command that runs until Ctrl-C or SIGTERM."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue


class End:
    """Flag for a signal that asks the command to end; it can be waited for.

    Not a `threading.Event`: a handler that sets it while the same thread holds its
    lock, as a second signal's does in the first one's, waits for itself for ever.
    """

    def __init__(self) -> None:
        self._signals: SimpleQueue[int] = SimpleQueue()

    def request(self, number: int, frame: object = None) -> None:
        """Ask the command to end; a signal handler, harmless when repeated."""
        self._signals.put(number)

    def is_requested(self) -> bool:
        """Return True once the command was asked to end."""
        return not self._signals.empty()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait for a signal, a time [s] at most; return True once one has come."""
        try:
            self._signals.put(self._signals.get(timeout=seconds))  # for the next call
        except Empty:
            return False
        return True


@contextmanager
def ended_by_signal() -> Iterator[End]:
    """Yield a flag that Ctrl-C and SIGTERM set, in place of their usual effect.

    A flag, not an exception: that could come anywhere, and by a second signal, such as
    `timeout` sends, in the middle of the clean-up after the first.
    """
    end = End()
    before = {
        number: signal.signal(number, end.request)
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield end
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
