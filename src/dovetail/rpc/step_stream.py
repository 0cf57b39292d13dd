"""A learner's control stream: it holds the lease, and its steps go over it."""

import queue
import threading
import time
from typing import TYPE_CHECKING

import grpc

from dovetail.arms.arm import ArmState
from dovetail.errors import ArmError
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.client import Connection
from dovetail.rpc.messages import read_state, write_target
from dovetail.rpc.problems import error_of
from dovetail.rpc.version import own_version

if TYPE_CHECKING:
    from dovetail import _core

_NEVER = float("inf")
_LOOK = 1.0  # s between two looks at the stream, at most


class StepStream:
    """The holder's stream: a request in, its answer out; the lease ends with it."""

    problem = ""
    """Reason why the stream has ended; empty while it is open."""

    def __init__(self, connection: Connection, name: str, timeout: float) -> None:
        """Open the stream and take the lease.

        Args:
            connection: To the service.
            name: The holder's name, as other clients see it.
            timeout: Longest wait for an answer, beyond a step's own duration [s].

        Raises:
            ArmError: The service is gone, or another client holds the arm.
            ConfigError: The service speaks another version.
        """
        self._connection, self._timeout = connection, timeout
        self._counter = 0
        self._due = time.monotonic() + timeout
        self._closed = threading.Event()
        self._outbox: queue.SimpleQueue[pb.StepRequest | None] = queue.SimpleQueue()
        acquire = pb.LeaseRequest(version=own_version(), client=name)
        self._outbox.put(pb.StepRequest(acquire=acquire))
        self._answers = connection.stub.control(iter(self._outbox.get, None))
        threading.Thread(target=self._watch, name="dovetail-lease", daemon=True).start()
        try:
            self.lease = self._next("the arm's lease cannot be had").lease
            """Secret of the holder's other calls."""
        except BaseException:
            self.close()
            raise
        self._due = _NEVER

    def step(self, target: "_core.Target", duration: float) -> ArmState:
        """Follow the target for a duration [s]; see `RemoteArm.step`."""
        self._counter += 1
        request = pb.StepRequest(counter=self._counter, duration=duration)
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

    def close(self) -> None:
        """Send nothing more; harmless when repeated."""
        self._closed.set()
        self._outbox.put(None)

    def _watch(self) -> None:
        """End a wait for an answer that does not come; note that the stream has ended.

        gRPC has a time limit for a stream as a whole, and none for its next message.
        """
        while not self._closed.wait(min(_LOOK, self._timeout / 3.0)):
            if time.monotonic() > self._due:
                self._answers.cancel()
            if not self._answers.is_active():
                lost = self._connection.error(self._answers, "no answer")
                self.problem = str(lost)
                return

    def _next(self, doing: str) -> pb.Report:
        try:
            return next(self._answers)
        except StopIteration:
            raise ArmError(f"{doing}: the service has closed the stream") from None
        except grpc.RpcError as call:
            raise self._connection.error(call, doing) from call
