"""A stream's first message has a time limit: a silent stream holds nothing for long."""

import queue
import threading
from collections.abc import Iterator
from typing import TypeVar

from dovetail.errors import ArmError

FIRST_MESSAGE_MAX = 3.0
"""Longest wait for a stream's first message [s]; a learner sends it at once."""

_Message = TypeVar("_Message")


class SilentStreamError(ArmError):
    """A stream was opened and nothing was said."""


def first_message(requests: Iterator[_Message], otherwise: _Message) -> _Message:
    """Wait for a stream's first message, which gRPC has no time limit for.

    A thread waits beside the caller's. It ends with the message, or with the stream,
    which ends when the caller lets this error pass to gRPC.

    Args:
        requests: What comes in, nothing of it read yet.
        otherwise: Returned if the stream is closed without a message.

    Raises:
        SilentStreamError: Nothing came in time.
        grpc.RpcError: The client has gone.
    """
    came: queue.SimpleQueue[_Message | Exception] = queue.SimpleQueue()

    def wait() -> None:
        try:
            came.put(next(requests, otherwise))
        except Exception as error:  # raised below, in the caller's thread
            came.put(error)

    threading.Thread(target=wait, name="dovetail-first-message", daemon=True).start()
    try:
        message = came.get(timeout=FIRST_MESSAGE_MAX)
    except queue.Empty:
        raise SilentStreamError(
            f"the stream was silent for {FIRST_MESSAGE_MAX:g} s and has ended: open it "
            "again and send its first message, with the lease, at once"
        ) from None
    if isinstance(message, Exception):
        raise message
    return message
