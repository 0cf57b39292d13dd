"""An arm behind KUKA's FRI: a real cabinet, or a simulated one.

Its address is `fri://0.0.0.0:30200?KEY=VALUE&...`: the cabinet sends its messages to
this host and port. The controller runs in C++ on a thread of its own, paced by these
messages (cpp/include/dovetail/servo_loop.hpp). `FriArm` gives it Targets and reads
back.
"""

import math
import threading
import time
from dataclasses import replace
from ipaddress import IPv4Address
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
from pydantic import model_validator

from dovetail.arms.arm import ArmFacts, ArmState, ArmTraits, ToolState
from dovetail.arms.arm_address import ArmAddress, Keys, parse_endpoint
from dovetail.arms.cabinet_control import CabinetControl
from dovetail.arms.fri_errors import (
    connection_error,
    motion_error,
    silence_error,
    socket_error,
    stop_error,
)
from dovetail.arms.reset_motion import TICK, drive_along, plan_reset
from dovetail.arms.start_distance import require_near
from dovetail.arms.watchdog import WatchdogConfig
from dovetail.control.config import check_period
from dovetail.control.observer import observer_gain
from dovetail.control.period import FRI_PERIODS, require_period
from dovetail.control.settings import ControllerSettings
from dovetail.control.torque_limits import check_torque
from dovetail.errors import ArmError, ConfigError
from dovetail.plants.plant import CYCLE_COLUMNS, require_configuration
from dovetail.poses import Pose
from dovetail.robots.robot import Robot
from dovetail.settings import Range, fill_in, settings
from dovetail.types import Array, Vec3, Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.workcell.workcell import Workcell

PORT = 30200
Version = Literal["1.15", "2.5", "2.7"]
VERSIONS: dict[str, Version] = {
    **{"1.14": "1.15", "1.15": "1.15", "1.16": "1.15"},
    **{"2.5": "2.5", "2.7": "2.7"},
}
"""Known FRI versions, and the one whose wire format each has."""
Clock: TypeAlias = Literal["wall", "lockstep"]
Reset: TypeAlias = Literal["move", "place"]
CLOCKS: tuple[Clock, ...] = ("wall", "lockstep")
RESETS: tuple[Reset, ...] = ("move", "place")
_SIGNS = {"measured_sign": "-1", "commanded_sign": "-1", "external_sign": "1"}
_KEYS = (
    *("version", "period", "clock", "control", "reset", "approach"),
    *("timeout", "target_timeout", "realtime", "margins", "peer"),
    *_SIGNS,
    "commanded_is_total",
)
_SLICE = 0.05
"""Period of a waiting learner's signs of life [s]: less than the watchdog's time."""
_PRIORITY = 90
"""SCHED_FIFO priority in real time: above drivers and a cabinet on the same machine,
below the kernel's own threads."""


@settings(owner="arm")
class FriAddress(ArmAddress):
    """A cabinet, real or simulated, that sends its messages to this machine."""

    measures_contact: ClassVar[bool] = False
    periods: ClassVar[tuple[float, ...]] = FRI_PERIODS
    period_name: ClassVar[str] = "control period of an arm behind FRI"

    host: str
    """Address of this machine to listen at; 0.0.0.0 is every one of them."""
    port: int
    """UDP port to listen at; a real cabinet sends to 30200 to 30209."""
    version: Version = "1.15"
    """Wire format; the messages themselves do not name it."""
    control: str | None = None
    """Control port HOST:PORT of a simulated cabinet; a real one has none."""
    peer: str | None = None
    """The cabinet's IPv4 address: datagrams of no other are taken."""
    measured_sign: Literal[-1, 1] = -1
    """Sign of the measured torque on the wire over the torque on the joint."""
    commanded_sign: Literal[-1, 1] = -1
    """The same of the commanded torque."""
    external_sign: Literal[-1, 1] = 1
    """The same of the external torque."""
    commanded_is_total: bool = False
    """The commanded torque on the wire contains gravity."""
    clock: Clock = "wall"
    """Lockstep: a simulated cabinet waits for the learner."""
    timeout: Annotated[float, Range(1e-3, math.inf, "s")] = 10.0
    """Longest wait for the cabinet [s]."""
    target_timeout: Annotated[float, Range(1e-3, math.inf, "s")] = 0.15
    """Time without a new target after which the arm is held [s]; wall clock only."""
    realtime: bool = False
    """Ask the system for real-time priority and locked memory."""
    reset: Reset | None = None
    """Way to the start: "move" below the limits, or "place", which needs a simulated
    cabinet. None is place with a control port, else move."""
    approach: bool = False
    """Move to a start that is far away, too."""

    @model_validator(mode="after")
    def _check_fri_address(self) -> Self:
        """Choose the reset if none is given; refuse one that the cabinet cannot do."""
        control = self.control
        if self.reset is None:
            fill_in(self, reset="move" if control is None else "place")
        if self.reset == "place" and control is None:
            raise ConfigError(
                "arm reset=place needs control=HOST:PORT, the control port of a "
                "simulated cabinet; a real arm starts its episodes with reset=move"
            )
        return self

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read an address.

        Raises:
            ConfigError: Unknown key (lists the known ones), or a value out of range.
        """
        keys = Keys(text, PORT, _KEYS)
        given = keys.get("version")
        version = VERSIONS.get("1.15" if given is None else given)
        if version is None:
            raise ConfigError(
                f"FRI version is {given!r}; known: {', '.join(VERSIONS)}; "
                "the robot's own is in its Sunrise project (for 3.0 try 2.7)"
            )
        control = keys.get("control")
        if control is not None:
            parse_endpoint(control, "arm control")
        return cls(
            text=text,
            host=keys.host,
            port=keys.port,
            version=version,
            period=keys.period(FRI_PERIODS),
            clock=keys.choice("clock", CLOCKS),
            control=control,
            reset=None if keys.get("reset") is None else keys.choice("reset", RESETS),
            approach=keys.is_on("approach"),
            timeout=keys.time("timeout", cls.timeout),
            target_timeout=keys.time("target_timeout", cls.target_timeout),
            realtime=keys.is_on("realtime"),
            peer=_peer(keys.get("peer")),
            margins=keys.choice("margins", ("hardware", "model")),
            commanded_is_total=keys.is_on("commanded_is_total"),
            **_signs(keys),
        )

    def build(
        self,
        cell: "Workcell",
        settings: ControllerSettings,
        watchdog: WatchdogConfig | None = None,
    ) -> "FriArm":
        """Listen for the cabinet.

        Args:
            cell: What stands around the arm.
            settings: Of the controller.
            watchdog: When the arm must not follow; None is as usual.

        Raises:
            ConfigError: A period that the cabinet cannot have.
            ArmError: The port cannot be listened on.
        """
        require_period(settings.period, self.period_name, self.periods)
        if self.may_be_robot:  # T1's speed limit is one of the velocity's norm
            limits = settings.limits
            limits = replace(limits, dx_max=limits.dx_max / np.sqrt(3.0))
            settings = replace(settings, limits=limits)
        robot = cell.loaded_robot()
        return FriArm(self, robot, settings, watchdog=watchdog, cell=cell)

    @property
    def is_real_time(self) -> bool:
        """True if the arm moves on while the learner thinks."""
        return self.clock == "wall"

    @property
    def places_fixture(self) -> bool:
        """True if it can place the fixture: with a control port."""
        return self.control is not None

    def describe_ground(self) -> str:
        """Return where a result was found."""
        if self.control is not None:
            return f"simulated cabinet ({self.text})"
        return f"the arm at {self.text.partition('?')[0]}"

    @property
    def may_be_robot(self) -> bool:
        """True if a real arm may move there: without a control port."""
        return self.control is None

    @property
    def can_be_disturbed(self) -> bool:
        """True with a control port: nothing else can push the arm."""
        return self.control is not None

    def with_approach(self) -> str:
        """Return the address of the arm where it may move to a start far away."""
        if self.approach:
            return self.text
        return f"{self.text}{'&' if '?' in self.text else '?'}approach=yes"

    def with_realtime(self) -> Self:
        """Return the address of the arm with real-time priority."""
        return replace(self, realtime=True)


def _peer(peer: str | None) -> str | None:
    """Return the cabinet's address, which is a number: names can be forged."""
    try:
        return None if peer is None else str(IPv4Address(peer))
    except ValueError as error:
        raise ConfigError(
            f"arm peer is {peer!r}; give the cabinet's IPv4 address, such as "
            "192.170.10.2"
        ) from error


def _signs(keys: Keys) -> dict[str, Literal[-1, 1]]:
    """Return the signs of torques on the wire."""
    signs: dict[str, Literal[-1, 1]] = {}
    for name, usual in _SIGNS.items():
        other = "1" if usual == "-1" else "-1"
        signs[name] = 1 if keys.choice(name, (usual, other)) == "1" else -1
    return signs


class FriArm:
    """An arm that takes torques over FRI."""

    def __init__(
        self,
        address: FriAddress,
        robot: Robot,
        settings: ControllerSettings,
        *,
        watchdog: WatchdogConfig | None = None,
        servo: "_core.ServoParams | None" = None,
        processor: int | None = None,
        log_folder: str | Path | None = "fri-logs",
        silence: float | None = None,
        cell: "Workcell | None" = None,
    ) -> None:
        """Listen for the cabinet; nothing moves before `reset`.

        Args:
            address: Where to listen, and what the cabinet is; port 0 takes a free one.
            robot: The controller's model, tool included.
            settings: Of the controller, made for the robot; the period [s] is the
                cabinet's send period x multiplier.
            watchdog: When the arm must not follow; None is as usual, with the
                address's `target_timeout`.
            servo: Filters; None is `servo_params`. What the other arguments say is put
                into it.
            processor: The servo thread stays on this one.
            log_folder: Where the last 10 s of motions that end go; None for nowhere.
            silence: Without a datagram for so long the session is over [s]; by default
                1 s, 5 s in lockstep.
            cell: What stands around the arm: a simulated cabinet with another robot or
                another cell file is refused. None is not compared.

        Raises:
            ArmError: The port is in use or not permitted.
            ConfigError: A setting is out of range.
            TorqueError: A torque limit is below what gravity takes.
        """
        check_torque(robot, settings.limits)
        self._address, self._cell = address, cell
        self._is_lockstep = address.clock == "lockstep"
        control = address.control
        self.facts = ArmFacts(
            robot=robot,
            osc=settings.osc,
            limits=settings.limits,
            task=settings.task,
            period=check_period(settings.period),
            address=f"fri://{address.host}:{address.port}",
            traits=ArmTraits(
                is_simulated=control is not None,
                is_real_time=address.is_real_time,
                places_fixture=address.places_fixture,
                measures_contact=address.measures_contact,
            ),
        )
        self._timeout = address.timeout
        self._approach = address.approach
        self._left: Vec7 | None = None  # where it was when it last followed
        self._control: CabinetControl | None = None
        if control is not None:
            self._control = CabinetControl(control, address.timeout)
        self._chain = robot.chain()
        from dovetail import _core

        loop = _core.LoopParams()
        loop.address, loop.port = address.host, address.port
        loop.peer = address.peer or ""
        loop.priority = _PRIORITY if address.realtime else 0
        loop.lock_memory = address.realtime
        loop.processor = -1 if processor is None else processor
        loop.log_folder = "" if log_folder is None else str(log_folder)
        loop.silence = silence or (5.0 if self._is_lockstep else 1.0)
        self._servo = self._make_servo(
            loop,
            servo or servo_params(settings.period),
            watchdog or WatchdogConfig(target_timeout=address.target_timeout),
        )
        self._stop_lock = threading.RLock()  # a signal may stop it within
        self._stops = 0
        self._seed: int | None = None
        self._motion = 0
        self._goal = 0
        self._row = 0
        self._begin = 0  # tick of the reset
        self._begin_time = 0.0

    def _make_servo(
        self,
        loop: "_core.LoopParams",
        servo: "_core.ServoParams",
        watchdog: WatchdogConfig,
    ) -> "_core.ServoLoop":
        from dovetail import _core

        facts = self.facts
        servo.measured_sign = self._address.measured_sign
        servo.commanded_sign = self._address.commanded_sign
        servo.external_sign = self._address.external_sign
        servo.commanded_is_total = self._address.commanded_is_total
        servo.period = facts.period
        servo.lockstep = self._is_lockstep
        servo.watchdog = watchdog.params()
        try:
            servo.version = self._address.version
            return _core.ServoLoop(
                loop,
                servo,
                self._chain,
                facts.osc.params(),
                facts.limits.params(),
                list(facts.task.modes),
            )
        except ValueError as error:
            raise ConfigError(str(error)) from error
        except OSError as error:
            raise socket_error(error, loop.address, loop.port) from error

    @property
    def port(self) -> int:
        """UDP port that it listens on."""
        return self._servo.port

    # -- Arm ---------------------------------------------------------------------

    def reset(self, q: Vec7, fixture: Pose) -> ArmState:
        """Bring the arm to q [rad], at rest; latch what is held.

        Ends a stop from before, once nothing bars the way.

        Raises:
            ArmError: No motion is commanded within the timeout, or the way is barred.
        """
        q, stops = require_configuration(q), self._stops
        if self._address.reset == "place" and self._control is not None:
            before = self._servo.state()
            if before.session == 4:
                self._servo.expect_end()
            placed = self._control.place(q, fixture, self._seed, self._cell)
            self._end_stop(stops)
            self._seed = None
            self._wait_for_motion(before.motion)
            # One that began while the request was on its way has ended, unseen as yet.
            while _is_before(self._servo.state().first, placed["sequence"]):
                self._wait_for_motion(self._motion)
        else:
            self._move_there(q, fixture, stops)
        hold = self.facts.robot.tool_pose(q)
        self._servo.hold_at(hold.position, hold.quat_wxyz)
        return self._begin_episode()

    def step(self, target: "_core.Target", duration: float = 0.05) -> ArmState:
        """Follow the target for a duration [s], a whole number of periods.

        Raises:
            ConfigError: The duration is not a whole number of periods.
            ArmError: The motion has ended, or a watchdog has stopped the arm.
        """
        cycles = round(duration / self.facts.period)
        if cycles < 1 or abs(cycles * self.facts.period - duration) > 1e-9:
            raise ConfigError(
                f"duration is {duration} s, which is not a whole number of control "
                f"periods of {self.facts.period} s"
            )
        if self._motion == 0:
            raise ArmError("the arm was not reset yet: call reset first", "reset")
        self._follow(target, cycles)
        return self._state()

    def close(self) -> None:
        """Stop listening; the cabinet then ends the motion. Harmless when repeated."""
        self._servo.close()
        if self._control is not None:
            self._control.close()

    # -- beyond Arm --------------------------------------------------------------

    def push(self, force: Vec3, duration: float) -> None:
        """Have a simulated cabinet push the TCP with a force [N] for a duration [s]."""
        self._require_control().push(force, duration)

    def move_fixture(self, fixture: Pose, velocity: Vec3) -> None:
        """Have it put the fixture at a pose and move it on at a velocity [m/s]."""
        self._require_control().move_fixture(fixture, velocity)

    def grasp(self, offset: Pose) -> None:
        """Have it displace the held part in the fingers, from the next reset on.

        Raises:
            ArmError: A reset drives the arm: the part stays as it is held.
        """
        if self._address.reset != "place":
            raise ArmError(
                "a reset that drives the arm leaves the part as it is held: give "
                "reset=place in the address, or --grasp-error 0 --grasp-turn 0",
                "no_control",
            )
        self._require_control().grasp(offset)

    def _require_control(self) -> CabinetControl:
        if self._control is None:
            raise ArmError(
                "only the control port of a simulated cabinet can push the arm or move "
                "the fixture: give control=HOST:PORT",
                "no_control",
            )
        return self._control

    def connect(self) -> None:
        """Wait until the cabinet commands torques.

        Raises:
            ArmError: It does not within the timeout: why, likely causes first. Or it is
                a simulated one of another robot.
        """
        if self._control is not None and self._cell is not None:
            self._control.agree(self._cell, self._timeout)
        self._wait_for_motion(0)

    def lean(self, q: Vec7) -> None:
        """Send positions that are off by q [rad] until told otherwise, 0.05 at most.

        Torques stay as they are: only a cabinet with a spring of its own feels it.
        """
        self._servo.lean(q)

    def stop(self) -> None:
        """Brake to rest and hold until `clear`, or a `reset` that begins later."""
        with self._stop_lock:
            self._stops += 1
            self._servo.stop()

    def clear(self) -> None:
        """End a stop; a cause that is still there stops the arm again."""
        self._servo.clear()

    def monitoring(self) -> "_core.ServoState":
        """Return what the servo loop last knew, in any state of the session."""
        return self._servo.state()

    def recent(self, seconds: float) -> Array:
        """Return the cycle log of the last seconds, across the ends of motions."""
        end = self._servo.state().rows
        cycles = round(seconds / self.facts.period)
        begin = max(self._servo.oldest_row(), end - cycles, 0)
        return self._servo.rows(begin, end, len(CYCLE_COLUMNS))

    def seed(self, seed: int) -> None:
        """Start a simulated cabinet's noise again, when it next places the arm."""
        self._seed = seed

    def statistics(self) -> dict[str, Any]:
        """Return counts, times with quantiles [s], notes and the session's state."""
        state = self._servo.state()
        return {
            "counts": self._servo.counts(),
            "times": self._servo.times(),
            "notes": self._servo.notes(),
            "session": state.session_name,
            "quality": state.quality,
            "peer": self._servo.peer,
            "last_undecodable": self._servo.last_undecodable(),
            "problem": self._servo.diagnose() or self._another_motion(state.motion),
        }

    # -- inside ------------------------------------------------------------------

    def _another_motion(self, motion: int) -> str:
        if self._motion in (0, motion):
            return ""
        return "the motion has ended, and another one has begun: reset() goes on in it"

    def _wait_for_motion(self, after: int) -> None:
        """Wait for a motion later than one, in slices that Ctrl-C can end."""
        end = time.monotonic() + self._timeout
        while not self._servo.wait_for_motion(after, _SLICE):
            if time.monotonic() > end:
                pace = f"{1e3 * self.facts.period:g} ms"
                raise connection_error(
                    self._servo,
                    self._address.host,
                    self.port,
                    self._address.version,
                    pace,
                )
        self._motion = self._servo.state().motion
        self._goal = self._servo.state().tick

    def _begin_episode(self) -> ArmState:
        state = self._servo.state()
        self._begin, self._begin_time = state.tick, state.time
        self._goal, self._row = state.tick, state.rows
        return self._state()

    def _follow(self, target: "_core.Target", cycles: int) -> None:
        servo = self._servo
        if not self._is_lockstep:
            late = servo.state().tick - self._goal
            if late > cycles // 2:  # the learner was slow: its step begins now
                self._goal += late
        self._goal += cycles
        servo.command(target, self._motion, self._goal)
        end = time.monotonic() + cycles * self.facts.period + self._timeout
        while True:
            result = servo.wait(self._goal, self._motion, _SLICE)
            if result == result.reached:
                break
            state = servo.state()
            if state.is_stopped:
                break
            if result == result.motion_ended:
                raise motion_error(servo, state)
            if time.monotonic() > end:
                raise silence_error(servo, state, self._timeout)
            servo.command(target, self._motion, self._goal)  # still there, still meant
        state = servo.state()
        if state.is_stopped:
            raise stop_error(servo, state)

    def _end_stop(self, stops: int) -> None:
        """End a stop, unless another has come since there were `stops`."""
        with self._stop_lock:
            if self._stops == stops:
                self._servo.clear()

    def _move_there(self, q: Vec7, fixture: Pose, stops: int) -> None:
        """Drive to q [rad], in the next motion where one ends on the way.

        Args:
            q: The start [rad].
            fixture: Where the fixture is.
            stops: Number of stops when the reset began: a later one holds.
        """
        end = time.monotonic() + self._timeout
        while True:
            self.connect()
            if self._control is not None:
                self._control.move_fixture(fixture)
            try:
                self._move_to(q, fixture, stops)
                return
            except ArmError as error:
                if error.reason != "motion_ended" or time.monotonic() > end:
                    raise
                self._left = self._servo.state().q

    def _move_to(self, q: Vec7, fixture: Pose, stops: int) -> None:
        """Drive to q [rad], below the limits, if it is near or this was asked for.

        Raises:
            ArmError: The arm is too far away, or does not arrive.
        """
        robot, limits, here = self.facts.robot, self.facts.limits, self._servo.state().q
        if not self._approach:
            require_near(robot, here, q, self._left)
        z_max = float(limits.x_max[2] - 2.0 * limits.delta_x)
        way = plan_reset(robot, here, q, fixture, z_max)
        self._end_stop(stops)
        cycles = max(1, round(TICK / self.facts.period))
        drive_along(way, self._servo.state, lambda target: self._follow(target, cycles))

    def _state(self) -> ArmState:
        from dovetail import _core

        state = self._servo.state()
        stamp = (state.tick - self._begin) * self.facts.period
        q, dq, log = state.q, state.dq, self._rows(state.rows)
        self._left = q
        seen = _core.summarize(self._chain, q, dq, log)  # position to flags
        tool, none = ToolState(*seen[:3]), np.full(3, np.nan)
        return ArmState(stamp, q, dq, tool, none, *seen[4:], log)

    def _rows(self, end: int) -> Array:
        begin = max(self._row, self._servo.oldest_row())
        self._row = end
        log = self._servo.rows(begin, end, len(CYCLE_COLUMNS))
        log[:, 0] -= self._begin_time
        return log


def servo_params(period: float) -> "_core.ServoParams":
    """Return the default parameters of a servo loop.

    Args:
        period: Control period [s].
    """
    from dovetail import _core

    servo = _core.ServoParams()
    servo.observer_gain = observer_gain(period)
    return servo


def _is_before(sequence: int, other: int) -> bool:
    """Return whether a message counter, of 32 bits that wrap round, is the earlier."""
    return (sequence - other) % (1 << 32) >= 1 << 31
