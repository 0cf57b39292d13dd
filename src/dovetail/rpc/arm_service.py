"""The service's calls: who calls, is it allowed, what is answered."""

import functools
import logging
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import grpc
import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.errors import ArmError, ConfigError, DovetailError
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.arm_host import ArmHost, Watched
from dovetail.rpc.fields import FieldReader
from dovetail.rpc.first_message import first_message
from dovetail.rpc.lease import TIMEOUT, TIMEOUT_MAX, TIMEOUT_MIN, Holder, LeaseBook
from dovetail.rpc.messages import (
    read_configuration,
    read_duration,
    read_target,
    rows_to_bytes,
    write_state,
)
from dovetail.rpc.problems import abort, problem_of
from dovetail.rpc.robot_message import write_robot
from dovetail.rpc.room import Room
from dovetail.rpc.settings import read_settings, write_settings
from dovetail.rpc.version import own_version, require_version
from dovetail.types import JOINTS

WATCHERS_MAX = 8
"""Most read-only watchers at a time: each needs a thread."""
STREAMS_MAX = 8
"""Most control streams at a time: one is the learner's, the others are mistakes."""
LOGS_MAX = 4
"""Most logs that are read at a time: a reader may be slow."""
LOG_TIME_MAX = 60.0
"""Longest time for reading a log, 40 MB at most [s]; then the call is ended."""
MOTIONS_MAX = 8
"""Most resets and steps at a time outside the stream: all but one of them wait."""
LASTING_MAX = WATCHERS_MAX + STREAMS_MAX + LOGS_MAX + MOTIONS_MAX
"""Most threads that lasting calls can take; short ones, as a stop, need more."""
INTERVAL_MAX = 10.0
"""Longest time between two reports that a watcher can ask for [s]."""

_NAME_MAX = 200
_OF_THE_HOLDER = ("configure", "reset", "step", "clear")
_NO_LOG = np.empty((0, len(CYCLE_COLUMNS)))
_LOG = logging.getLogger("dovetail.rpc")
_Asked = TypeVar("_Asked")
_Answer = TypeVar("_Answer")


def _answered(
    method: "Callable[[ArmService, _Asked, grpc.ServicerContext], _Answer]",
) -> "Callable[[ArmService, _Asked, grpc.ServicerContext], _Answer]":
    """Turn an exception into the call's status; a stream's is turned in the stream."""

    @functools.wraps(method)
    def call(
        self: "ArmService", request: _Asked, context: grpc.ServicerContext
    ) -> _Answer:
        try:
            return method(self, request, context)
        except DovetailError as error:
            return abort(context, error)
        except Exception as error:
            self.fail(error, is_holder=method.__name__ in _OF_THE_HOLDER)
            return abort(context, error)

    return call


class ArmService:
    """Serves one arm to one controlling client and to watchers."""

    def __init__(self, host: ArmHost, notify: Callable[[str], None]) -> None:
        """Serve a host's arm.

        Args:
            host: Owns the arm; closed by whoever made it.
            notify: Called with a line for each thing that a person should know.
        """
        self._host = host
        self._notify = notify
        self.leases = LeaseBook(self._lease_ended)
        self.steps = 0
        self._noted: set[str] = set()
        self._watchers = threading.BoundedSemaphore(WATCHERS_MAX)
        self.streams = Room(
            STREAMS_MAX,
            "control streams are open",
            "a learner needs one, so close the others; silent ones end by themselves "
            "within seconds, then try again",
        )
        self.logs = Room(
            LOGS_MAX, "logs are being read", "read one to its end, then try again"
        )
        self.motions = Room(
            MOTIONS_MAX,
            "resets and steps are under way",
            "wait for their answers before asking for another",
        )

    @property
    def status(self) -> str:
        """One line: who holds the arm, how far it is, whether it is stopped."""
        holder = self.leases.holder
        parts = [f"held by {holder}" if holder else "free", f"{self.steps} steps"]
        if self._host.stop_reason:
            parts.append(f"stopped: {self._host.stop_reason}")
        return ", ".join(parts)

    def fail(self, error: Exception, *, is_holder: bool) -> None:
        """Tell of an error that nobody expected; hold the arm if it was a motion's."""
        _LOG.error("an error that nobody expected", exc_info=error)
        held = "; the arm is held" if is_holder else ""
        self._notify(f"unexpected {type(error).__name__}: {error}{held}")
        if is_holder:
            self._host.stop(f"unexpected {type(error).__name__}", is_ordered=False)

    @_answered
    def get_info(self, request: pb.InfoRequest, context: Any) -> pb.Info:
        """Say what arm this is."""
        require_version(request.version, "client")
        builder, holder = self._host.builder, self.leases.holder
        info = pb.Info(
            version=own_version(),
            arm=builder.name,
            real_time=builder.is_real_time,
            places_fixture=builder.places_fixture,
            holder=str(holder or ""),
            stopped=self._host.stop_reason,
            joints=JOINTS,
            columns=CYCLE_COLUMNS,
        )
        write_robot(builder.robot, info.robot)
        if builder.cell is not None:
            info.cell.name = builder.cell.name
        if self._host.settings is not None:
            write_settings(self._host.settings, info.configured)
        return info

    @_answered
    def acquire_lease(self, request: pb.LeaseRequest, context: Any) -> pb.Lease:
        """Give the lease to the caller, if nobody has it."""
        require_version(request.version, "client")
        timeout = TIMEOUT
        if request.HasField("timeout"):
            fields = FieldReader()
            allowed = (TIMEOUT_MIN, TIMEOUT_MAX)
            timeout = fields.number("timeout", request, "timeout", "s", allowed)
            fields.finish()
        name = "".join(c for c in request.client if c.isprintable())[:_NAME_MAX]
        holder = self.leases.acquire(name or "a client", _caller(context), timeout)
        self._notify(f"{holder} holds the arm")
        return pb.Lease(lease=holder.lease, timeout=timeout)

    @_answered
    def keep_alive(self, request: pb.Holder, context: Any) -> pb.Lease:
        """Note that the holder is there."""
        holder = self.leases.require(request.lease)
        return pb.Lease(lease=holder.lease, timeout=holder.timeout)

    @_answered
    def release_lease(self, request: pb.Holder, context: Any) -> pb.Done:
        """Take the lease back."""
        self.leases.end(self.leases.require(request.lease), "released")
        return pb.Done()

    @_answered
    def configure(self, request: pb.Configuration, context: Any) -> pb.Done:
        """Build the arm with the caller's settings."""
        require_version(request.version, "client")
        with self.leases.use(request.lease):
            self._require_cell(request)
            settings = read_settings(request, self._host.builder.robot)
            key = pb.Configuration()
            write_settings(settings, key)
            is_new = self._host.configure(
                settings, key.SerializeToString(deterministic=True)
            )
        if is_new:
            self._notify(f"configured: {settings.task}, {settings.period:g} s")
            for text in settings.limits.declared.unproven():
                self._notify(f"warning: {text}")
        return pb.Done()

    @_answered
    def reset(self, request: pb.ResetRequest, context: Any) -> pb.Report:
        """Begin a motion."""
        with self.leases.use(request.lease), self.motions:
            q, fixture = read_configuration(request, self._host.builder.robot)
            seed = request.seed if request.HasField("seed") else None
            report = _report(0, self._host.reset(q, fixture, seed))
        for note in self._host.notes():
            if note not in self._noted:
                self._noted.add(note)
                self._notify(note)
        return report

    @_answered
    def step(self, request: pb.StepRequest, context: Any) -> pb.Report:
        """Follow a target."""
        with self.leases.use(request.lease), self.motions:
            return self._step(request)

    def control(
        self, requests: Iterator[pb.StepRequest], context: grpc.ServicerContext
    ) -> Iterator[pb.Report]:
        """Follow targets one after the other; the lease ends with the stream."""
        try:
            with self.streams:
                yield from self._control(requests, context)
        except DovetailError as error:
            abort(context, error)

    def state(
        self, request: pb.WatchRequest, context: grpc.ServicerContext
    ) -> Iterator[pb.Report]:
        """Report every change to a watcher, or the newest if it is slow."""
        try:
            require_version(request.version, "client")
            interval = _interval(request)
            if not self._watchers.acquire(blocking=False):
                raise ArmError(f"{WATCHERS_MAX} clients watch already: end one of them")
        except DovetailError as error:
            return abort(context, error)
        try:
            serial = -1
            while context.is_active():
                news = self._host.wait_for_news(serial, timeout=0.5)
                if news.serial > serial:
                    serial = news.serial
                    yield self._watched(news, has_log=request.log)
                    time.sleep(interval)
        finally:
            self._watchers.release()

    @_answered
    def stop(self, request: pb.StopRequest, context: Any) -> pb.Done:
        """Hold the arm now, whoever asks."""
        reason = "".join(c for c in request.reason if c.isprintable())[:_NAME_MAX]
        reason = f"{reason or 'stopped'}, asked by {_caller(context)}"
        self._host.stop(reason, is_ordered=True)
        self._notify(f"the arm is held: {reason}")
        return pb.Done()

    @_answered
    def clear(self, request: pb.Holder, context: Any) -> pb.Done:
        """Let the arm move again."""
        with self.leases.use(request.lease) as holder:
            self._host.clear()
        self._notify(f"{holder} lets the arm move again")
        return pb.Done()

    def get_log(
        self, request: pb.LogRequest, context: grpc.ServicerContext
    ) -> Iterator[pb.LogChunk]:
        """Send the control cycles since the last reset."""
        try:
            require_version(request.version, "client")
            with self.logs:
                # A reader that reads no more would keep thread and room for ever.
                limit = threading.Timer(LOG_TIME_MAX, context.cancel)
                limit.daemon = True
                limit.start()
                try:
                    yield from self._log()
                finally:
                    limit.cancel()
        except DovetailError as error:
            abort(context, error)

    def _control(
        self, requests: Iterator[pb.StepRequest], context: grpc.ServicerContext
    ) -> Iterator[pb.Report]:
        lease = first_message(requests, pb.StepRequest()).lease
        # A learner that hangs would hold the stream's thread and room for ever.
        holder = self.leases.bind(lease, context.cancel)
        if not context.add_callback(
            lambda: self.leases.end(holder, "its connection has ended")
        ):
            return self.leases.end(holder, "its connection has ended")
        yield pb.Report()
        for request in requests:
            try:
                report = self._step(request)
            except DovetailError as error:
                report = _trouble(request.counter, error)
            except Exception as error:
                self.fail(error, is_holder=True)
                report = _trouble(request.counter, error)
            yield report

    def _log(self) -> Iterator[pb.LogChunk]:
        blocks = self._host.cycles()
        yield pb.LogChunk(columns=CYCLE_COLUMNS, dropped=blocks[0][0] if blocks else 0)
        for step, rows in blocks:
            yield pb.LogChunk(step=step, rows=rows_to_bytes(rows))

    def _step(self, request: pb.StepRequest) -> pb.Report:
        with self.leases.use(request.lease):
            settings = self._host.settings
            if settings is None:
                raise ArmError("the arm has no settings yet: configure it first")
            fields = FieldReader()
            target = read_target(request.target, fields)
            duration = read_duration(request, settings.period, fields)
            fields.finish()
            state = self._host.step(target, duration)
            self.steps += 1
            return _report(request.counter, state)

    def _watched(self, news: Watched, *, has_log: bool) -> pb.Report:
        holder = self.leases.holder
        report = pb.Report(
            counter=news.serial,
            holder=str(holder or ""),
            stopped="" if news.stop is None else news.stop.reason,
        )
        if news.state is not None:
            state = news.state if has_log else news.state._replace(log=_NO_LOG)
            write_state(state, report.state)
        return report

    def _require_cell(self, request: pb.Configuration) -> None:
        cell = self._host.builder.cell
        if cell is None or not request.HasField("cell"):
            return
        if request.cell.name != cell.name:
            raise ConfigError(
                f"the learner's cell is {request.cell.name!r}, the service's is "
                f"{cell.name!r}: start both with the same options of the task"
            )

    def _lease_ended(self, holder: Holder, reason: str) -> None:
        why = f"{holder} has left: {reason}"
        self._host.stop(why, is_ordered=False)
        self._notify(f"{why}; the arm is held")


def _report(counter: int, state: ArmState) -> pb.Report:
    report = pb.Report(counter=counter)
    write_state(state, report.state)
    return report


def _trouble(counter: int, error: Exception) -> pb.Report:
    return pb.Report(counter=counter, problem=problem_of(error))


def _interval(request: pb.WatchRequest) -> float:
    fields = FieldReader()
    interval = 0.0
    if request.HasField("interval"):
        interval = fields.number(
            "interval", request, "interval", "s", (0.0, INTERVAL_MAX)
        )
    fields.finish()
    return interval


def _caller(context: grpc.ServicerContext) -> str:
    """Return where a call comes from, with the name in its certificate if any."""
    names: Any = context.auth_context().get("x509_common_name", [])
    name = ", ".join(part.decode(errors="replace") for part in names)
    return f"{context.peer()} ({name})" if name else context.peer()
