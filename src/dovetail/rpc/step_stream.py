"""A learner's steps over the control stream, quick because everything is at hand."""

import queue
import time
from typing import TYPE_CHECKING

import grpc

from dovetail.arms.arm import ArmState
from dovetail.errors import ArmError
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.client import Connection
from dovetail.rpc.messages import read_state, write_target
from dovetail.rpc.problems import error_of

if TYPE_CHECKING:
    from dovetail import _core

_NEVER = float("inf")


class StepStream:
    """The holder's stream: a request in, its answer out; the lease ends with it."""

    def __init__(self, connection: Connection, lease: str, timeout: float) -> None:
        """Open the stream and tie the lease to it.

        Args:
            connection: To the service.
            lease: The holder's.
            timeout: Longest wait for an answer, beyond a step's own duration [s].

        Raises:
            ArmError: The service is gone, or the lease is not this client's.
        """
        self._connection, self._lease, self._timeout = connection, lease, timeout
        self._counter = 0
        self._due = _NEVER
        self._outbox: queue.SimpleQueue[pb.StepRequest | None] = queue.SimpleQueue()
        self._answers = connection.stub.control(iter(self._outbox.get, None))
        self._outbox.put(pb.StepRequest(lease=lease))
        self._next("the arm's stream cannot be opened")

    def step(self, target: "_core.Target", duration: float) -> ArmState:
        """Follow the target for a duration [s]; see `RemoteArm.step`."""
        self._counter += 1
        request = pb.StepRequest(
            lease=self._lease, counter=self._counter, duration=duration
        )
        write_target(target, request.target)
        self._due = time.monotonic() + max(0.0, duration) + self._timeout
        self._outbox.put(request)
        try:
            report = self._next("the arm was lost in a step")
            while report.counter < self._counter:  # of a step that was interrupted
                report = self._next("the arm was lost in a step")
        finally:
            self._due = _NEVER
        if report.HasField("problem"):
            raise error_of(report.problem)
        return read_state(report.state)

    def end_overdue(self) -> None:
        """End a step whose answer has not come in time; call it now and then."""
        if time.monotonic() > self._due:
            self._answers.cancel()

    def close(self) -> None:
        """Send nothing more; harmless when repeated."""
        self._outbox.put(None)

    def _next(self, doing: str) -> pb.Report:
        try:
            return next(self._answers)
        except StopIteration:
            raise ArmError(f"{doing}: the service has closed the stream") from None
        except grpc.RpcError as call:
            raise self._connection.error(call, doing) from call
