"""A learner's steps over the control stream, quick because everything is at hand.

During a step's wait every thread on the road falls asleep; two `KeepAlive` calls just
before the report is due wake them. What the arm adds to gRPC are four pieces of Python,
request and report written and read, of 55 to 90 us each after a wait, 30 to 50 without.
No better than the two calls: one call (0.05 ms slower), three (0.03 ms faster), short
sleeps, writing and reading a message for practice, `grpc.minimal_stack` and
`grpc.optimization_target`. Faster, but not used: reports over a stream of their own,
read by the caller's thread (0.10 of 0.84 ms; an interrupted wait cannot be taken up
again), and older pollers by `GRPC_EXPERIMENTS` (0.05 ms; their names change).
"""

import queue
import time
from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import grpc

from dovetail.arms.arm import ArmState
from dovetail.errors import ArmError
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.calls import is_failed_call
from dovetail.rpc.client import Connection
from dovetail.rpc.messages import DURATION_MAX, read_state, write_target
from dovetail.rpc.problems import error_of

if TYPE_CHECKING:
    from dovetail import _core

WAKE_LEAD = 3e-3
"""How long before a report is expected the road to the service is woken [s]."""
WAKE_CALLS = 2
"""Calls that wake it: the first finds all threads asleep, the second leaves no gap."""
WAKE_FROM = 0.02
"""Shortest wait that is worth it [s]; quicker steps keep the road awake themselves."""
WAKE_STEPS = 8
"""Steps back from which the next report's time is told: as early as any of them."""

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
        self._late: deque[float] = deque(maxlen=WAKE_STEPS)
        self._outbox: queue.SimpleQueue[tuple[pb.StepRequest, float] | None]
        self._outbox = queue.SimpleQueue()
        self._answers = connection.stub.control(self._requests())
        self._outbox.put((pb.StepRequest(lease=lease), _NEVER))
        self._next("the arm's stream cannot be opened")

    def step(self, target: "_core.Target", duration: float) -> ArmState:
        """Follow the target for a duration [s]; see `RemoteArm.step`."""
        self._counter += 1
        request = pb.StepRequest(
            lease=self._lease, counter=self._counter, duration=duration
        )
        write_target(target, request.target)
        start = time.monotonic()
        self._due = start + max(0.0, duration) + self._timeout
        self._outbox.put((request, start + self._expected(duration)))
        try:
            report = self._next("the arm was lost in a step")
            while report.counter < self._counter:  # of a step that was interrupted
                report = self._next("the arm was lost in a step")
        finally:
            self._due = _NEVER
        if report.HasField("problem"):
            raise error_of(report.problem)
        self._late.append(time.monotonic() - start - duration)
        return read_state(report.state)

    def end_overdue(self) -> None:
        """End a step whose answer has not come in time; call it now and then."""
        if time.monotonic() > self._due:
            self._answers.cancel()

    def close(self) -> None:
        """Send nothing more; harmless when repeated."""
        self._outbox.put(None)

    def _expected(self, duration: float) -> float:
        """Return how long a step's report will take [s]; never if none can be told.

        A real arm's cycles go on while the learner thinks, so that a report may come
        before the duration has passed since the request; a simulation's comes at once.
        """
        wait = duration + min(self._late, default=_NEVER)
        return wait if WAKE_FROM <= wait <= DURATION_MAX else _NEVER

    def _requests(self) -> Iterator[pb.StepRequest]:
        """Yield what is to be sent; runs in gRPC's sending thread."""
        item = self._outbox.get()
        while item is not None:
            request, expected = item
            yield request
            if expected < _NEVER:
                rest = expected - WAKE_LEAD - time.monotonic()
                try:
                    item = self._outbox.get(timeout=max(0.0, rest))
                    continue
                except queue.Empty:
                    self._wake(expected)
            item = self._outbox.get()

    def _wake(self, expected: float) -> None:
        """Ask whether the service is there, so that the report finds nobody asleep.

        In a step's wait every thread on the road falls asleep, and what it needs
        leaves the processor's caches: 0.3 ms of a report's way. These calls pay that
        before the report comes. If they fail, the step itself will tell.
        """
        holder = pb.Holder(lease=self._lease)
        for _ in range(WAKE_CALLS):
            rest = expected - time.monotonic()
            if rest <= 0.0 or self._due == _NEVER:  # too late, or the report is here
                return
            try:
                self._connection.stub.keep_alive(holder, timeout=rest)
            except Exception as error:
                if not is_failed_call(error):
                    raise
                return

    def _next(self, doing: str) -> pb.Report:
        try:
            return next(self._answers)
        except StopIteration:
            raise ArmError(f"{doing}: the service has closed the stream") from None
        except grpc.RpcError as call:
            self._ask_why(call, doing)
            raise self._connection.error(call, doing) from call

    def _ask_why(self, call: Any, doing: str) -> None:
        """Raise what the service says of the lease, if the service ended the stream."""
        if call.code() != grpc.StatusCode.CANCELLED or time.monotonic() > self._due:
            return
        holder = pb.Holder(lease=self._lease)
        try:
            self._connection.stub.keep_alive(holder, timeout=self._timeout)
        except grpc.RpcError as refusal:
            raise self._connection.error(refusal, doing) from refusal
        except ValueError:  # the channel is closed: it was this end
            return
