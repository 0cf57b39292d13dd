"""A loop in a thread of its own, where what it uses is built and closed, too.

OpenGL, which draws a simulated camera's pictures, belongs to the thread that opened it.
"""

import threading
from collections.abc import Callable
from concurrent.futures import Future

from dovetail.cockpit.page_log import LOG
from dovetail.errors import DovetailError


class LoopThread:
    """Takes turns until it is ended."""

    def __init__(
        self,
        *,
        begin: Callable[[], None],
        turn: Callable[[], None],
        fail: Callable[[Exception], None],
        end: Callable[[], None],
    ) -> None:
        """Begin, and wait until that is done; raises what it raised.

        Args:
            begin: Is called first, in the thread.
            turn: Then again and again.
            fail: With what a turn raised; the next turn follows.
            end: Is called last.
        """
        self._turn, self._fail, self._end = turn, fail, end
        self._is_ended = threading.Event()
        begun: Future[None] = Future()
        self._thread = threading.Thread(
            target=self._run, args=(begin, begun), name="cockpit", daemon=True
        )
        self._thread.start()
        begun.result()

    def _run(self, begin: Callable[[], None], begun: Future[None]) -> None:
        try:
            begin()
        except BaseException as error:  # passed to the caller of `__init__`
            begun.set_exception(error)
            return
        begun.set_result(None)
        while not self._is_ended.is_set():
            try:
                self._turn()
            except Exception as error:  # a task of one's own may raise anything
                self._fail(error)
                if not isinstance(error, DovetailError):
                    LOG.exception("page: a turn of the control loop failed")
        self._end()

    @property
    def is_ended(self) -> bool:
        """True once `end` was called."""
        return self._is_ended.is_set()

    def end(self) -> None:
        """Take no more turns, and wait until it is over."""
        self._is_ended.set()
        self._thread.join()
