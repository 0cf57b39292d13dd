"""The service's calls: who calls, is it allowed, what is answered.

They run in one event loop, so a call that waits takes no thread. The arm's own work,
which blocks, has one thread beside it; a stop needs neither that thread nor a turn.
"""

import asyncio
import logging
import secrets
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from functools import partial
from typing import Any, TypeVar

import grpc
import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.errors import ArmError, ConfigError, DovetailError
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.printable import printable
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.arm_host import ArmHost, StatusReport
from dovetail.rpc.calls import read_message
from dovetail.rpc.fields import FieldReader
from dovetail.rpc.lease import Holder, LeaseBook
from dovetail.rpc.messages import (
    read_configuration,
    read_duration,
    read_target,
    rows_to_bytes,
    write_state,
)
from dovetail.rpc.problems import NoRoomError, SilentCallError, TokenError, problem_of
from dovetail.rpc.robot_message import write_robot
from dovetail.rpc.settings import read_settings, write_settings
from dovetail.rpc.token import AUTHORIZATION, TOKEN, bearer
from dovetail.rpc.version import own_version, require_version
from dovetail.types import JOINTS

READERS_MAX = 8
"""Most watchers and readers of logs at a time: answers to them take time from steps."""
LOG_TIME_MAX = 60.0
"""Longest time for reading a log, 40 MB at most [s]; then the call is ended."""
INTERVAL_MAX = 10.0
"""Longest time between two reports that a watcher can ask for [s]."""
HOLD_AGAIN = 0.1
"""Time after which a reset that goes on in spite of a stop is stopped again [s]."""

_NAME_MAX = 200
_NEEDS_NO_TOKEN = ("stop",)
_OF_THE_HOLDER = ("control", "configure", "reset", "step", "clear")
_NO_LOG = np.empty((0, len(CYCLE_COLUMNS)))
_LOG = logging.getLogger("dovetail.rpc")
_Context = grpc.aio.ServicerContext
_Result = TypeVar("_Result")


class ArmService:
    """Serves one arm to one controlling client and to watchers."""

    def __init__(
        self, host: ArmHost, notify: Callable[[str], None], token: str = ""
    ) -> None:
        """Serve a host's arm; in the event loop of the calls.

        Args:
            host: Owns the arm; closed by its maker.
            notify: Called with a line for each thing that a person should know, in a
                thread of its own.
            token: Secret that a caller has to show; empty where certificates do that.
        """
        self._host = host
        self._notify = notify
        self._token = token
        self.leases = LeaseBook(self._lease_ended)
        self.steps = 0
        self.readers = 0
        self._noted: set[str] = set()
        self._watches: set[asyncio.Task[None]] = set()
        self._arm_thread = ThreadPoolExecutor(1, "dovetail-arm")
        self._lines_thread = ThreadPoolExecutor(1, "dovetail-lines")
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        host.on_news = self._tell_readers

    @property
    def status(self) -> str:
        """One line: the holder, the number of steps, and whether the arm is stopped."""
        holder = self.leases.holder
        parts = [f"held by {holder}" if holder else "free", f"{self.steps} steps"]
        if self._host.stop_reason:
            parts.append(f"stopped: {self._host.stop_reason}")
        return ", ".join(parts)

    def close(self) -> None:
        """Take no more work; what is under way ends by itself."""
        self._arm_thread.shutdown(wait=False, cancel_futures=True)
        self._lines_thread.shutdown()

    def admit(self, name: str, context: _Context) -> None:
        """Let a call pass if it carries the token; a stop needs none.

        Stopping is safe, and who wants to stop the arm must not look for a word first.

        Raises:
            TokenError: It carries none, or another one.
        """
        if not self._token or name in _NEEDS_NO_TOKEN:
            return
        shown = dict(context.invocation_metadata() or ()).get(AUTHORIZATION, "")
        if not secrets.compare_digest(
            str(shown).encode(), bearer(self._token).encode()
        ):
            other = "another one" if shown else "none"
            raise TokenError(
                f"the service wants its token and was shown {other}: take the whole "
                "address that `dovetail serve` prints, grpc://HOST:PORT?token=..., or "
                f"set {TOKEN}"
            )

    def fail(self, name: str, error: Exception) -> None:
        """Report an unexpected error; hold the arm if the call was a motion's."""
        _LOG.error("an error that nobody expected", exc_info=error)
        is_holder = name in _OF_THE_HOLDER
        held = "; the arm is held" if is_holder else ""
        self._say(f"unexpected {type(error).__name__}: {error}{held}")
        if is_holder:
            self._host.stop(f"unexpected {type(error).__name__}", is_ordered=False)

    async def get_info(self, request: pb.InfoRequest, context: _Context) -> pb.Info:
        """Say what arm this is."""
        require_version(request.version, "client")
        offered, holder = self._host.offered, self.leases.holder
        info = pb.Info(
            version=own_version(),
            arm=offered.address.text,
            real_time=offered.address.is_real_time,
            places_fixture=offered.address.places_fixture,
            holder=str(holder or ""),
            stopped=self._host.stop_reason,
            joints=JOINTS,
            columns=CYCLE_COLUMNS,
        )
        write_robot(offered.robot, info.robot)
        info.cell.name = offered.cell.name
        if self._host.settings is not None:
            write_settings(self._host.settings, info.configured)
        return info

    async def release_lease(self, request: pb.Holder, context: _Context) -> pb.Done:
        """Take the lease back."""
        self.leases.end(self.leases.require(request.lease), "released")
        return pb.Done()

    async def configure(self, request: pb.Configuration, context: _Context) -> pb.Done:
        """Build the arm with the caller's settings."""
        require_version(request.version, "client")
        self.leases.require(request.lease)
        self._require_cell(request)
        settings = read_settings(request, self._host.offered.robot)
        key = pb.Configuration()
        write_settings(settings, key)
        is_new = await self._by_arm(
            self._host.configure, settings, key.SerializeToString(deterministic=True)
        )
        if is_new:
            self._say(f"configured: {settings.task}, {settings.period:g} s")
            for text in settings.limits.beyond_proven():
                self._say(f"warning: {text}")
        return pb.Done()

    async def reset(self, request: pb.ResetRequest, context: _Context) -> pb.Report:
        """Begin a motion."""
        self.leases.require(request.lease)
        q, fixture = read_configuration(request, self._host.offered.robot)
        seed = request.seed if request.HasField("seed") else None
        still = partial(self.leases.require, request.lease)
        motion = self._arm_thread.submit(self._host.reset, q, fixture, seed, still)
        watch = self._loop.create_task(self._keep_stopped(motion))
        self._watches.add(watch)  # it goes on where this call's client has gone
        watch.add_done_callback(self._watches.discard)
        report = _report(0, await asyncio.wrap_future(motion))
        for note in await self._by_arm(self._host.notes):
            if note not in self._noted:
                self._noted.add(note)
                self._say(note)
        return report

    async def step(self, request: pb.StepRequest, context: _Context) -> pb.Report:
        """Follow a target."""
        self.leases.require(request.lease)
        return await self._step(request)

    async def control(self, request: pb.StepRequest, context: _Context) -> None:
        """Give the caller the lease, then follow its targets one after the other."""
        if not request.HasField("acquire"):
            raise ArmError("the first message of a control stream acquires the lease")
        require_version(request.acquire.version, "client")
        name = printable(request.acquire.client)[:_NAME_MAX] or "a client"
        holder = self.leases.acquire(name, _caller(context))
        try:
            self._say(f"{holder} holds the arm")
            await context.write(pb.Report(lease=holder.lease))
            while (request := await read_message(context)) is not None:
                await context.write(await self._streamed_step(holder, request))
        finally:
            self.leases.end(holder, "its connection has ended")

    async def state(self, request: pb.WatchRequest, context: _Context) -> None:
        """Report every change to a watcher, or the newest if it is slow."""
        require_version(request.version, "client")
        interval = _interval(request)
        with self._reading():
            serial = -1
            while True:
                news = self._news  # first, so that no report is missed
                report = self._host.report
                if report.serial == serial:
                    await news.wait()
                    continue
                serial = report.serial
                await context.write(self._status_report(report, has_log=request.log))
                await asyncio.sleep(interval)

    async def stop(self, request: pb.StopRequest, context: _Context) -> pb.Done:
        """Hold the arm now, for any client: the lease is not needed."""
        reason = f"{printable(request.reason)[:_NAME_MAX] or 'stopped'}, asked by "
        reason += _caller(context)
        before = self._host.report.stop
        self._host.stop(reason, is_ordered=True)
        if before is None or not before.is_ordered:
            self._say(f"the arm is held: {reason}")
        return pb.Done()

    async def clear(self, request: pb.Holder, context: _Context) -> pb.Done:
        """Let the arm move again."""
        holder = self.leases.require(request.lease)
        still = partial(self.leases.require, request.lease)
        await self._by_arm(self._host.clear, still)
        self._say(f"{holder} lets the arm move again")
        return pb.Done()

    async def get_log(self, request: pb.LogRequest, context: _Context) -> None:
        """Send the control cycles since the last reset; the holder's need no room."""
        require_version(request.version, "client")
        is_holder = self.leases.is_held_by(request.lease)
        with nullcontext() if is_holder else self._reading():
            sending = await self._send_log(context)
        if sending is not None:
            await sending  # the call can end only when its reader has read this
            raise SilentCallError(
                f"the log was not read within {LOG_TIME_MAX:g} s: read it at once"
            )

    async def _keep_stopped(self, motion: Future[ArmState]) -> None:
        """Say a stop again while a reset goes on in spite of it."""
        while not motion.done():
            await asyncio.sleep(HOLD_AGAIN)
            self._host.hold_if_stopped()

    async def _send_log(self, context: _Context) -> asyncio.Future[None] | None:
        """Send the log; return what is still being sent at the end of the time."""
        end = self._loop.time() + LOG_TIME_MAX
        for chunk in _chunks(await self._by_arm(self._host.cycles)):
            sending = asyncio.ensure_future(context.write(chunk))
            await asyncio.wait({sending}, timeout=end - self._loop.time())
            if not sending.done():
                return sending
            await sending
        return None

    def _by_arm(
        self, function: Callable[..., _Result], *given: Any
    ) -> asyncio.Future[_Result]:
        """Call what may block in the arm's thread, after what waits there already."""
        return self._loop.run_in_executor(self._arm_thread, function, *given)

    def _say(self, line: str) -> None:
        """Print a line for a person; a terminal that stands still stops no call."""
        self._lines_thread.submit(self._notify, line)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Count a reader.

        Raises:
            NoRoomError: There are as many as there may be.
        """
        if self.readers >= READERS_MAX:
            raise NoRoomError(
                f"{self.readers} clients watch or read logs, the most at a time: end "
                "one of them, then try again"
            )
        self.readers += 1
        try:
            yield
        finally:
            self.readers -= 1

    def _tell_readers(self) -> None:
        """Wake the watchers; called in any thread."""
        if self.readers:
            self._loop.call_soon_threadsafe(self._wake_readers)

    def _wake_readers(self) -> None:
        news, self._news = self._news, asyncio.Event()
        news.set()

    async def _streamed_step(self, holder: Holder, request: pb.StepRequest) -> Any:
        """Return the report of a step; an error is inside it, so the stream goes on."""
        try:
            self.leases.require(holder.lease)
            return await self._step(request)
        except DovetailError as error:
            return _trouble(request.counter, error)
        except Exception as error:
            self.fail("control", error)
            return _trouble(request.counter, error)

    async def _step(self, request: pb.StepRequest) -> pb.Report:
        settings = self._host.settings
        if settings is None:
            raise ArmError("the arm has no settings yet: configure it first")
        fields = FieldReader()
        target = read_target(request.target, fields)
        duration = read_duration(request, settings.period, fields)
        fields.finish()
        state = await self._by_arm(self._host.step, target, duration)
        self.steps += 1
        return _report(request.counter, state)

    def _status_report(self, news: StatusReport, *, has_log: bool) -> pb.Report:
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
        cell = self._host.offered.cell
        if request.HasField("cell") and request.cell.name != cell.name:
            raise ConfigError(
                f"the learner's cell is {request.cell.name!r}, the service's is "
                f"{cell.name!r}: start both with the same options of the task, and "
                "the same --cell"
            )

    def _lease_ended(self, holder: Holder, reason: str) -> None:
        why = f"{holder} has left: {reason}"
        self._host.stop(why, is_ordered=False)
        self._say(f"{why}; the arm is held")


def _report(counter: int, state: ArmState) -> pb.Report:
    report = pb.Report(counter=counter)
    write_state(state, report.state)
    return report


def _trouble(counter: int, error: Exception) -> pb.Report:
    return pb.Report(counter=counter, problem=problem_of(error))


def _chunks(blocks: list[tuple[int, Any]]) -> Iterator[pb.LogChunk]:
    yield pb.LogChunk(columns=CYCLE_COLUMNS, dropped=blocks[0][0] if blocks else 0)
    for step, rows in blocks:
        yield pb.LogChunk(step=step, rows=rows_to_bytes(rows))


def _interval(request: pb.WatchRequest) -> float:
    fields = FieldReader()
    interval = 0.0
    if request.HasField("interval"):
        interval = fields.number(
            "interval", request, "interval", "s", (0.0, INTERVAL_MAX)
        )
    fields.finish()
    return interval


def _caller(context: _Context) -> str:
    """Return where a call comes from, with the name in its certificate if any."""
    names: Any = context.auth_context().get("x509_common_name", [])
    name = printable(", ".join(part.decode(errors="replace") for part in names))
    return f"{context.peer()} ({name[:_NAME_MAX]})" if name else context.peer()
