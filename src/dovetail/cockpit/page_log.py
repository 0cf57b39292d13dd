"""Log lines of the page go to the terminal by a thread of their own.

A terminal that stands still, after Ctrl-S or behind a full pipe, keeps a thread that
writes to it waiting. The thread that serves the page, and with it STOP, and the one
that controls the arm never write there themselves.
"""

import contextlib
import logging
import logging.handlers
import queue
from typing import Any

LOG = logging.getLogger("dovetail.cockpit")
"""Log of the page and its control loop."""
SOCKETS = logging.getLogger("websockets.server")
"""Log of faults in the page's sockets."""
_WAITING_MAX = 100
"""Records that wait for the terminal; more are dropped."""


class PageLog:
    """Takes what both loggers say until it is closed."""

    def __init__(self) -> None:
        """Take it from now on."""
        waiting: queue.Queue[Any] = queue.Queue(_WAITING_MAX)
        self._handler = _Dropping(waiting)
        self._writer = _Writer(waiting, _ToRoot())
        SOCKETS.addFilter(_IN_A_LINE)
        for logger in (LOG, SOCKETS):
            logger.addHandler(self._handler)
            logger.propagate = False
        self._writer.start()

    def close(self) -> None:
        """Let both write as usual again, once what waits was written."""
        for logger in (LOG, SOCKETS):
            logger.removeHandler(self._handler)
            logger.propagate = not logger.handlers
        self._writer.stop()


class _Dropping(logging.handlers.QueueHandler):
    def enqueue(self, record: logging.LogRecord) -> None:
        with contextlib.suppress(queue.Full):
            self.queue.put_nowait(record)

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        return record  # it stays in this process


class _Writer(logging.handlers.QueueListener):
    def __init__(self, waiting: queue.Queue[Any], handler: logging.Handler) -> None:
        super().__init__(waiting, handler)
        self._waiting = waiting

    def enqueue_sentinel(self) -> None:
        self._waiting.put(None)  # a full queue is no error


class _ToRoot(logging.Handler):
    """Gives a record to the program's own log handlers, or to the standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        logging.getLogger().callHandlers(record)


class _InALine(logging.Filter):
    """Says of what no browser sends, such as a port scan, a line and no traceback.

    At most one a second: a flood of them must not fill the terminal.
    """

    def __init__(self) -> None:
        super().__init__()
        self._said = 0.0

    def filter(self, record: logging.LogRecord) -> bool:
        """Shorten a record, or leave it out."""
        if not record.exc_info:
            return True
        if record.created < self._said + 1.0:
            return False
        self._said = record.created
        error = record.exc_info[1]
        text = f"{type(error).__name__}: {error}".strip().splitlines()[0]
        # A stranger's bytes are in it: no escape sequence of theirs gets to a terminal.
        why = "".join(c if c.isprintable() else "?" for c in text)
        record.msg, record.args = f"page: {record.getMessage()} ({why})", ()
        record.exc_info = None
        return True


_IN_A_LINE = _InALine()
