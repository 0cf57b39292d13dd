"""Ctrl-C that ends work at its next whole step, and at once when it is repeated."""

import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

INTERRUPTED = 130
"""Exit code of what Ctrl-C has ended, as a shell gives it."""
_SHOW_CURSOR = "\x1b[?25h"  # a progress bar hides it


class Event(Protocol):
    """An event of threads or of processes."""

    def set(self) -> None:
        """Set the event."""
        ...

    def is_set(self) -> bool:
        """Return True once the event is set."""
        ...


class Interrupt:
    """Flag that Ctrl-C sets."""

    def __init__(self, event: Event | None = None) -> None:
        """Begin unpressed.

        Args:
            event: Set when it is pressed; another process may set it, too.
        """
        self._pressed: Event = event or threading.Event()

    def press(self) -> None:
        """Note that Ctrl-C was pressed."""
        self._pressed.set()

    def is_pressed(self) -> bool:
        """Return True once Ctrl-C was pressed."""
        return self._pressed.is_set()

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed; called between whole steps."""
        if self.is_pressed():
            raise KeyboardInterrupt


@contextmanager
def ends_whole(words: str) -> Iterator[Interrupt]:
    """Note the first Ctrl-C, say what follows, and end the process at the second.

    Python raises KeyboardInterrupt between any two instructions: an update may be half
    done. In a callback of the garbage collector (JAX has one) the exception is dropped
    and the work goes on. While JAX compiles, Python runs no handler at all. So a thread
    waits for the signal, prints the message, and ends the process.

    Outside of the main thread, where no signal arrives, and in a job that ignores
    Ctrl-C, nothing is changed.

    Args:
        words: Said at the first Ctrl-C: what is still done.
    """
    interrupt = Interrupt()
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        yield interrupt
        return
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    thread = threading.Thread(target=_listen, args=(ours, interrupt, words))
    thread.start()
    handler = signal.signal(signal.SIGINT, lambda *_: None)
    wakeup = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    try:
        yield interrupt
    finally:
        signal.set_wakeup_fd(wakeup)
        signal.signal(signal.SIGINT, handler)
        theirs.close()
        thread.join()
        ours.close()


def _listen(wire: socket.socket, interrupt: Interrupt, words: str) -> None:
    """Wait for signals until the other end is closed."""
    while number := wire.recv(1):
        if number[0] != signal.SIGINT:
            continue
        if interrupt.is_pressed():
            _say(_SHOW_CURSOR if os.isatty(2) else "")
            os._exit(INTERRUPTED)
        interrupt.press()
        _say(f"\n{words}; Ctrl-C again ends at once\n")


def _say(text: str) -> None:
    """Write past Python's buffers and locks, which the main thread may hold."""
    with suppress(OSError):
        os.write(2, text.encode())


@contextmanager
def left_to_the_parent() -> Iterator[None]:
    """Start child processes that Ctrl-C does not reach: it goes to all of a terminal.

    A process inherits which signals are blocked.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
