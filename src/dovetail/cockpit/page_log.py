"""Log of the page, written to the terminal by a thread of its own.

A terminal that stands still, after Ctrl-S or behind a full pipe, keeps a thread that
writes to it waiting. The thread that serves the page, and with it STOP, and the one
that controls the arm never write there themselves.
"""

import logging
import queue
import threading
from contextlib import suppress

from dovetail.printable import printable

LOG = logging.getLogger("dovetail.cockpit")
"""Log of the page and its control loop."""
SOCKETS = logging.getLogger("websockets.server")
"""Log of faults in the page's sockets."""
_WAITING_MAX = 100  # records that wait for the terminal; more are dropped
_PAUSE = 1.0  # [s] between two faults in sockets: a flood must not fill the terminal


class _InALine(logging.Filter):
    """Makes a line of a fault in a socket, such as a port scan, without traceback."""

    def __init__(self) -> None:
        super().__init__()
        self._last = 0.0  # time of the last fault that passed [s]

    def filter(self, record: logging.LogRecord) -> bool:
        """Shorten a fault, or leave it out."""
        if not record.exc_info:
            return True
        if record.created < self._last + _PAUSE:
            return False
        self._last = record.created
        error = record.exc_info[1]
        why = printable(f"{type(error).__name__}: {error}".strip().splitlines()[0])
        record.msg, record.args = f"page: {record.getMessage()} ({why})", ()
        record.exc_info = None
        return True


_IN_A_LINE = _InALine()  # one for good: viser adds a filter that hides what is behind


class PageLog(logging.Handler):
    """Takes the records of both loggers until it is closed."""

    def __init__(self) -> None:
        """Take the records from now on."""
        super().__init__()
        self._waiting: queue.Queue[logging.LogRecord | None] = queue.Queue(_WAITING_MAX)
        SOCKETS.addFilter(_IN_A_LINE)
        for logger in (LOG, SOCKETS):
            logger.addHandler(self)
            logger.propagate = False
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a record; drop it where too many wait."""
        with suppress(queue.Full):
            self._waiting.put_nowait(record)

    def _write(self) -> None:
        """Pass the records to the program's own handlers, or to the standard error."""
        while (record := self._waiting.get()) is not None:
            logging.getLogger().callHandlers(record)

    def close(self) -> None:
        """Write the records that wait, then let both loggers write as usual again."""
        if self not in LOG.handlers:
            return
        for logger in (LOG, SOCKETS):
            logger.removeHandler(self)
            logger.propagate = not logger.handlers
        self._waiting.put(None)
        self._thread.join()
        super().close()
