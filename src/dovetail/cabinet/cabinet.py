"""The simulated cabinet: an FRI server over any plant or twin.

The cabinet speaks first and sets the pace: one monitoring message per send period, to
one client, in which the session's state tells the client what it may do.
"""

import queue
import socket
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from dovetail.cabinet.config import CabinetConfig, Endpoint
from dovetail.cabinet.control_port import ControlPort
from dovetail.cabinet.event_log import EventLog
from dovetail.cabinet.exchange import Exchange, LockstepExchange, WallExchange
from dovetail.cabinet.faults import FaultConfig
from dovetail.cabinet.protocol import SafetyState, SessionState
from dovetail.cabinet.requests import RequestDesk
from dovetail.cabinet.robot_controller import RobotController
from dovetail.cabinet.udp_port import UdpPort
from dovetail.cabinet.wire import Command, Wire
from dovetail.cabinet.wrong_values import with_joint_values
from dovetail.errors import ConfigError

if TYPE_CHECKING:
    from dovetail.plants.plant import DrivenPlant

_GOODBYES = 5
"""IDLE messages at the end of a session; KUKA's clients leave at the first."""
_REQUEST_TIME = 10.0
"""Longest wait of a request for the cabinet's thread [s]."""
_ANSWER_TIME = 0.1
"""Period at which a waiting request checks that the cabinet still runs [s]."""
_RATE_TIME = 0.5
"""Time over which the rate is counted [s]."""


class Cabinet:
    """A cabinet in a thread of this process, or in the calling one with `run`.

    As a context manager it starts and closes itself. The plant belongs to the caller.
    """

    def __init__(
        self,
        plant: "DrivenPlant",
        config: CabinetConfig | None = None,
        *,
        faults: FaultConfig | None = None,
        script: Sequence[tuple[float, FaultConfig]] = (),
        log: Path | None = None,
    ) -> None:
        """Open the ports; nothing is sent before `start` or `run`.

        Args:
            plant: The arm and its scene, reset; used by the cabinet's thread alone.
            config: Settings.
            faults: Faults from the beginning.
            script: Changes of the faults: time since the start [s], faults.
            log: File for the events, as JSON lines; None for none.

        Raises:
            ConfigError: A port is in use, or an address is wrong.
            LogError: The log cannot be written.
        """
        self.config = config = config or CabinetConfig()
        self.log = EventLog(log)
        self.controller = RobotController(plant, config, self.log.write)
        self._wire = Wire(self.controller)
        counts = self.controller.counts
        self._port = UdpPort(config.bind, config.client, counts)
        self._wake, self._woken = socket.socketpair()
        self._woken.setblocking(False)
        self._exchange = self._make_exchange()
        self._script = list(script)
        self._faults = FaultConfig()
        self._stop_at: float | None = None
        self._freeze = 0.0
        self._install(faults or FaultConfig())
        self._desk = RequestDesk(self.controller, self._install, self._status)
        self._requests: queue.SimpleQueue[tuple[Any, queue.SimpleQueue[Any]]]
        self._requests = queue.SimpleQueue()
        self._is_closing = False
        self._thread: threading.Thread | None = None
        self._rate, self._rate_from, self._rate_count = 0.0, time.monotonic(), 0
        self.address = self._port.address
        """The cabinet's UDP address."""
        self._control: ControlPort | None = None
        if config.control is not None:
            try:
                self._control = ControlPort(config.control, self.request)
            except ConfigError:
                self._port.close()
                raise

    def _make_exchange(self) -> Exchange:
        pace, wake = self.config, self._woken.fileno()
        if pace.clock == "wall":
            return WallExchange(self._port, wake, self, pace.period)
        return LockstepExchange(
            self._port,
            wake,
            self,
            pace.period,
            patience=pace.patience,
            multiplier=pace.receive_multiplier,
        )

    @property
    def control_address(self) -> Endpoint | None:
        """The control port's address; None where there is none."""
        return self._control.address if self._control else None

    @property
    def is_running(self) -> bool:
        """True while the cabinet's thread runs."""
        return self._thread is not None and self._thread.is_alive()

    # -- life --------------------------------------------------------------------

    def __enter__(self) -> Self:
        """Start the cabinet's thread."""
        self.start()
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the cabinet."""
        self.close()

    def start(self) -> None:
        """Run in a thread of this process."""
        self._thread = threading.Thread(target=self._guard, name="cabinet", daemon=True)
        self._thread.start()

    def _guard(self) -> None:
        try:
            self.run()
        except Exception as error:  # kept for the status: no caller waits for it
            self.failure = f"{type(error).__name__}: {error}"
            self.log.write("failure", error=self.failure)

    def close(self) -> None:
        """Send IDLE messages, close the ports; harmless when repeated."""
        self._is_closing = True
        self._wake.send(b"x") if self._wake.fileno() >= 0 else None
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._control is not None:
            self._control.close()
        self._port.close()
        self._wake.close()
        self._woken.close()
        self.log.close()

    def run(self) -> None:
        """Run until `close` is called or a KeyboardInterrupt comes."""
        self._started = self._exchange.now
        version, clock = self.config.version, self.config.clock
        self.log.write("start", version=version, clock=clock)
        try:
            while not self._is_closing:
                if self.controller.application.is_open:
                    self._pass_period()
                else:
                    self._wait_for_session()
        finally:
            self._is_closing = True
            self.controller.application.close()
            if self.controller.state is not SessionState.IDLE:
                self._say_goodbye()
            self.log.write("end", **self._status())

    # -- periods -----------------------------------------------------------------

    def _pass_period(self) -> None:
        controller, exchange = self.controller, self._exchange
        now = exchange.now
        if self._script or self._stop_at is not None or self._freeze:
            self._change_faults(now)
        controller.begin()
        if isinstance(exchange, LockstepExchange):
            exchange.is_patient = controller.state >= SessionState.MONITORING_READY
        payload = self._wire.encode(self._stamp())
        if (values := self._faults.values) != 7:
            is_framed = self.config.version == "2.7"
            payload = with_joint_values(payload, values, is_framed=is_framed)
        is_due = controller.is_slot_end
        exchange.transact(payload, controller.sequence, is_due=is_due)
        if self._is_closing:
            return
        controller.finish()
        exchange.rest()
        self._port.count_foreign()
        self._count_rate()

    def _stamp(self) -> tuple[int, int]:
        return divmod(time.time_ns(), 1_000_000_000)

    def _count_rate(self) -> None:
        self._rate_count += 1
        now = time.monotonic()
        if (elapsed := now - self._rate_from) >= _RATE_TIME:
            self._rate = self._rate_count / elapsed
            self._rate_from, self._rate_count = now, 0

    def _wait_for_session(self) -> None:
        """Say that the session is over, then be silent until there is one."""
        if self.controller.state is not SessionState.IDLE:
            self.controller.body.come_to_rest()
            self._say_goodbye()
        self.serve_for(0.1)

    def serve_for(self, duration: float) -> None:
        """Serve requests and nothing else for a duration [s]."""
        self._exchange.shift(duration)
        self.serve()

    def _say_goodbye(self) -> None:
        for _ in range(_GOODBYES):
            self.controller.begin()
            self._port.send(self._wire.encode(self._stamp()))

    # -- faults ------------------------------------------------------------------

    def _install(self, faults: FaultConfig) -> None:
        """Put faults in the place of the present ones."""
        self._faults = faults
        self._exchange.configure(faults)
        robot = faults
        self.controller.quality.forced = robot.quality
        self._freeze = robot.freeze
        self._stop_at = None
        if robot.stop_at is not None:
            self._stop_at = self._exchange.now + robot.stop_at
        self.log.write("faults", faults=faults.describe())

    def _change_faults(self, now: float) -> None:
        while self._script and self._script[0][0] <= now - self._started:
            self._install(self._script.pop(0)[1])
        if self._stop_at is not None and now >= self._stop_at:
            self._stop_at = None
            robot = self._faults
            self.controller.stop_safely(SafetyState(robot.stop), robot.stop_time)
        if self._freeze:
            duration, self._freeze = self._freeze, 0.0
            self.log.write("freeze", duration=duration)
            self._exchange.shift(duration)

    # -- what the exchange asks for ----------------------------------------------

    def take(self, payload: bytes) -> bool:
        """Take a client's datagram; return whether it is the reply waited for."""
        command = self._decode(payload)
        return command is not None and self.controller.receive(command)

    def _decode(self, payload: bytes) -> Command | None:
        try:
            return self._wire.decode(payload)
        except ValueError as error:
            counts = self.controller.counts
            counts["undecodable"] += 1
            if (
                counts["undecodable"] in (1, 10, 100)
                or not counts["undecodable"] % 1000
            ):
                self.log.write("undecodable", error=str(error))
            self.last_error = f"undecodable datagram: {error}"
            return None

    def reflects(self, payload: bytes) -> int | None:
        """Return which message a datagram answers; None where it cannot be read."""
        try:
            return self._wire.decode(payload).reflected
        except ValueError:
            return None

    def serve(self) -> bool:
        """Serve requests; return whether they made the period void."""
        try:
            while self._woken.recv(64):
                pass
        except BlockingIOError:
            pass
        while not self._requests.empty():
            request, reply = self._requests.get()
            reply.put(self._desk.answer(request))
            what = request.get("do") if isinstance(request, dict) else None
            if what not in ("status", "truth"):
                self.log.write("request", request=request)
        return self._is_closing or self.controller.is_abandoned

    # -- requests ----------------------------------------------------------------

    def request(self, request: Any) -> dict[str, Any]:
        """Ask the running cabinet as over the control port; any thread.

        Args:
            request: {"do": "place" | "fixture" | "push" | "io" | "fault" | "pause" |
                "resume" | "stop" | "status" | "truth", ...}.

        Returns:
            {"ok": true, ...}, or {"ok": false, "error": why}.
        """
        reply: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._requests.put((request, reply))
        end = time.monotonic() + _REQUEST_TIME
        while not self._is_closing and time.monotonic() < end:
            try:
                self._wake.send(b"x")
                return reply.get(timeout=_ANSWER_TIME)
            except queue.Empty:
                continue
            except OSError:
                break
        why = f": {self.failure}" if self.failure else ""
        return {"ok": False, "error": f"the cabinet does not run{why}"}

    def status(self) -> dict[str, Any]:
        """Return state, quality, rate and counts of the running cabinet; any thread."""
        return self.request({"do": "status"})

    def _status(self) -> dict[str, Any]:
        status = self.controller.status()
        status["rate"] = round(self._rate, 1)
        status["counts"]["overruns"] = self._exchange.overruns
        status["clock"] = self.config.clock
        status["faults"] = self._faults.describe()
        status["last_error"] = self.last_error
        status["log_failure"] = self.log.failure
        return status

    failure = ""
    """Error that ended the cabinet's thread; empty while there is none."""
    last_error = ""
    """The last datagram that could not be read, and why."""
    _started = 0.0
