"""A Franka behind FCI: its address, and an arm that gives its loop Targets.

Its address is `franka://HOST?KEY=VALUE&...`.
"""

import importlib.util
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np

from dovetail.arms.arm import ArmFacts, ArmState, ArmTraits, ToolState
from dovetail.arms.arm_address import ArmAddress, Keys
from dovetail.arms.franka.at_rest import Rest
from dovetail.arms.franka.load import (
    require_known_load,
    require_light_hand,
    require_true_load,
)
from dovetail.arms.franka.loop import (
    PERIOD,
    ROWS,
    Begin,
    Clear,
    Counts,
    End,
    Failed,
    Job,
    Latch,
    Order,
    Seen,
    Stop,
    share_log,
)
from dovetail.arms.franka.reflexes import (
    MODES,
    connection_lost,
    motion_ended,
    not_connected,
)
from dovetail.arms.reset_motion import TICK, drive_along, plan_reset
from dovetail.arms.start_distance import require_near
from dovetail.control.settings import ControllerSettings
from dovetail.control.torque_limits import check_torque
from dovetail.errors import (
    ArmError,
    ConfigError,
    MissingDependencyError,
    install_command,
)
from dovetail.plants.plant import COLUMN, require_configuration
from dovetail.poses import Pose
from dovetail.robots.robot import Robot
from dovetail.settings import Range, settings
from dovetail.types import Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.workcell.workcell import Workcell

_PROGRAM = (
    "import sys; from dovetail.arms.franka.loop import run; "
    "run(*map(int, sys.argv[1:]))"
)
_IMPORTS = 20.0
"""Longest time until the loop's process has imported what it needs [s]."""
_HOLD_TIME = 0.6
"""Time for which the arm is held before it is moved [s]."""
_SILENCE = 2.0
"""Longest wait for the loop's answer beyond the step itself [s]. Without commands the
control box stops the arm after 20 ms. Half as long is too short for franka-sim on a
busy machine: there 600 of its milliseconds took more than 1.6 s."""
_ABORTS = 0.5
"""Longest time in which a loop that hangs says where [s]."""
_ENDS = 2.0
"""Longest time in which a loop ends its motion [s]."""


_PORT = 1337
_KEYS = (
    *("period", "timeout", "target_timeout", "realtime", "approach", "recover"),
    *("load", "margins"),
)


@settings(owner="arm")
class FrankaAddress(ArmAddress):
    """A Franka's control box, or franka-sim."""

    measures_contact: ClassVar[bool] = False
    periods: ClassVar[tuple[float, ...]] = (1e-3,)
    period_name: ClassVar[str] = "control period of a Franka"

    host: str
    """Address of the control box."""
    timeout: Annotated[float, Range(1e-3, math.inf, "s")] = 10.0
    """Longest wait for the arm [s]."""
    target_timeout: Annotated[float, Range(1e-3, math.inf, "s")] = 0.15
    """Time without a new target after which the arm is held [s]."""
    realtime: bool = False
    """Insist on real-time priority, which libfranka takes where it may."""
    approach: bool = False
    """Move to a start that is far away, too."""
    recover: bool = False
    """End a reflex that stands from before; never while a motion runs."""
    load: bool = True
    """Tell the arm mass and centre of what it carries beyond the end effector that Desk
    knows."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read an address.

        Raises:
            ConfigError: Unknown key (lists the known ones), or a value out of range.
        """
        keys = Keys(text, _PORT, _KEYS)
        return cls(
            text=text,
            host=keys.host,
            period=keys.period(cls.periods) or cls.periods[0],
            timeout=keys.time("timeout", cls.timeout),
            target_timeout=keys.time("target_timeout", cls.target_timeout),
            realtime=keys.is_on("realtime"),
            approach=keys.is_on("approach"),
            recover=keys.is_on("recover"),
            load=keys.choice("load", ("yes", "no")) == "yes",
            margins=keys.choice("margins", ("hardware", "model")),
        )

    def build(
        self, cell: "Workcell", settings: ControllerSettings, *, ask_model: bool = False
    ) -> "FrankaArm":
        """Connect to the control box.

        Args:
            cell: What stands around the arm, and what it carries.
            settings: Made for the cell's robot and this address's margins.
            ask_model: Read the arm's own model of gravity into its `rest`.

        Raises:
            ConfigError: The cell's robot is no Franka.
            ArmError: It cannot be had; says why.
            MissingDependencyError: libfranka is not installed.
        """
        return FrankaArm(self, cell.loaded_robot(), settings, ask_model=ask_model)

    @property
    def places_fixture(self) -> bool:
        """False: the fixture is where it is."""
        return False

    def describe_ground(self) -> str:
        """Return where a result was found."""
        return f"the arm at franka://{self.host}"

    def with_approach(self) -> str:
        """Return the address of the arm where it may move to a start far away."""
        if self.approach:
            return self.text
        return f"{self.text}{'&' if '?' in self.text else '?'}approach=yes"

    def with_realtime(self) -> Self:
        """Return the address of the arm with real-time priority."""
        return replace(self, realtime=True)


class FrankaArm:
    """An arm that takes torques over FCI."""

    def __init__(
        self,
        address: FrankaAddress,
        robot: Robot,
        settings: ControllerSettings,
        *,
        ask_model: bool = False,
    ) -> None:
        """Connect, look at the arm at rest, and hold it where it is.

        Args:
            address: Where it is.
            robot: The controller's model, tool included. Its payload is what the
                flange carries; without one Desk's load stays.
            settings: Of the controller, made for the robot.
            ask_model: Read the arm's own model of gravity into `rest`.

        Raises:
            ConfigError: The robot is no Research 3: its torques may change at once, or
                its speed limit does not fall towards position limits.
            ArmError: It cannot be had; says why.
            LoadError: It does not carry what the robot's payload says.
            MissingDependencyError: libfranka is not installed.
            TorqueError: A torque limit is below what gravity takes.
        """
        if importlib.util.find_spec("pylibfranka") is None:
            raise MissingDependencyError(
                "an arm at franka:// needs libfranka, which is not installed: "
                f"{install_command('franka')}"
            )
        limits = settings.limits
        if not np.isfinite([limits.dtau_max, limits.taper_brake]).all():
            raise ConfigError(
                f"the robot is {robot.name}, and the arm at franka:// is a Research 3, "
                "which ends a motion whose torque jumps or that is fast beside a "
                "position limit: give --robot fr3"
            )
        check_torque(robot, settings.limits)
        self._address = address
        self.facts = ArmFacts(
            robot=robot,
            osc=settings.osc,
            limits=settings.limits,
            task=settings.task,
            period=PERIOD,
            address=f"franka://{address.host}",
            traits=ArmTraits(
                is_simulated=False,
                is_real_time=True,
                places_fixture=False,
                measures_contact=False,
            ),
        )
        self._settings, self._ask_model = settings, ask_model
        self._payload = robot.payload if address.load else None
        self._chain = robot.chain()
        self._left: Vec7 | None = None
        self._begin = 0.0
        self._problem = ""
        self._stop_lock = threading.RLock()  # a signal may stop it within
        self._stops, self._is_stopped = 0, False
        self._start()

    def _start(self) -> None:
        """Start the loop, and wait until it has the arm; a stop outlives it."""
        self._counts: Counts | None = None  # of this loop: none, it has no arm yet
        self._has_begun = False
        self._is_starting = True  # it takes no stop, and holds the arm where it is
        address = self._address
        job = Job(
            host=address.host,
            robot=self.facts.robot,
            settings=self._settings,
            is_realtime=address.realtime,
            may_recover=address.recover,
            payload=self._payload,
            ask_model=self._ask_model,
        )
        self._pipe, theirs = multiprocessing.Pipe()
        memory = os.memfd_create("franka log")
        self._log = share_log(memory)
        handles = theirs.fileno(), memory
        # Not multiprocessing's own: it would run the user's script again.
        self._loop = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, *map(str, handles)],
            pass_fds=handles,
            stdin=subprocess.DEVNULL,
        )
        theirs.close()
        os.close(memory)
        try:
            self._order(job)
            self._begin_motion()
            with self._stop_lock:
                self._is_starting = False
                if self._is_stopped:
                    self._order(Stop())
        except BaseException:  # Ctrl-C, too: nobody else ends the loop
            self.close()
            raise

    def _begin_motion(self) -> None:
        """Judge the load at rest, let the motion begin, and judge it once more.

        Raises:
            ArmError: It has ended, or says nothing.
            LoadError: The arm does not carry what the robot's payload says.
        """
        robot, error = self.facts.robot, self.facts.limits.payload_error
        self.rest: Rest = self._answer(_IMPORTS + self._address.timeout)
        if self._payload is not None:
            require_light_hand(robot, self.rest)
        require_known_load(robot, self.rest, error)
        require_true_load(robot, self.rest, self.rest.external, error)
        self._order(Begin())
        self._seen = self._receive(self._address.timeout)
        # Without sensors the torque that holds the arm tells the load.
        held = self._hold()
        self.rest = self.rest._replace(held=held)
        require_true_load(robot, self.rest, held, error)

    def _hold(self) -> Vec7:
        """Hold the arm where it is; return the mean torque of the last third [Nm]."""
        from dovetail import _core

        target = _core.Target(joint_mode=True, q_d=self._seen.q)
        self._follow(target, round(_HOLD_TIME / PERIOD))
        last = np.arange(
            self._seen.tick - round(_HOLD_TIME / PERIOD / 3), self._seen.tick
        )
        tau = self._log[last % ROWS, COLUMN["tau1"] : COLUMN["tau7"] + 1]
        return np.asarray(tau.mean(axis=0))

    # -- Arm ---------------------------------------------------------------------

    def reset(self, q: Vec7, fixture: Pose) -> ArmState:
        """Drive to q [rad], below the limits, at rest; latch what is held.

        Begins a motion anew where one has ended. Ends a stop from before, once nothing
        bars the way.

        Raises:
            ArmError: It is too far away, does not arrive, or the motion ended.
        """
        q, stops = require_configuration(q), self._stops
        if not self._is_alive():
            self._start()
        robot, limits, here = self.facts.robot, self.facts.limits, self._seen.q
        if not self._address.approach:
            require_near(robot, here, q, self._left)
        z_max = float(limits.x_max[2] - 2.0 * limits.delta_x)
        way = plan_reset(robot, here, q, fixture, z_max)
        with self._stop_lock:
            if self._stops == stops:  # a later one holds
                self._end_stop()
        cycles = round(TICK / PERIOD)
        drive_along(
            way, lambda: self._seen, lambda target: self._follow(target, cycles)
        )
        hold = self.facts.robot.tool_pose(q)
        self._order(Latch(hold.position, hold.quat_wxyz))
        self._begin, self._has_begun = self._seen.time, True
        return self._state(self._seen._replace(first=self._seen.tick))

    def step(self, target: "_core.Target", duration: float = 0.05) -> ArmState:
        """Follow the target for a duration [s], a whole number of periods.

        Raises:
            ConfigError: The duration is not a whole number of periods.
            ArmError: The arm has ended the motion, or was stopped.
        """
        cycles = round(duration / PERIOD)
        if cycles < 1 or abs(cycles * PERIOD - duration) > 1e-9:
            raise ConfigError(
                f"duration is {duration} s, which is not a whole number of control "
                f"periods of {PERIOD} s"
            )
        if not self._has_begun:
            raise ArmError("the arm was not reset yet: call reset first", "reset")
        self._follow(target, cycles)
        return self._state(self._seen)

    def seed(self, seed: int) -> None:
        """Do nothing: a real arm's noise is its own."""

    def stop(self) -> None:
        """Brake to rest and hold until `clear`, or a `reset` that begins later."""
        with self._stop_lock:
            self._stops += 1
            self._is_stopped = True
            if not self._is_starting:
                self._order(Stop())

    def clear(self) -> None:
        """End a stop; the arm is held until the next step or `reset`."""
        with self._stop_lock:
            self._end_stop()

    def statistics(self) -> dict[str, Any]:
        """Return counts and times of the loop, and what a person should read."""
        notes: list[str] = []
        found: dict[str, Any] = {"notes": notes, "problem": self._problem}
        if (counts := self._counts) is None or not counts.cycles:
            return found
        if counts.lost:
            notes.append(
                f"{counts.lost} of {counts.cycles} cycles had no command in time; see "
                "docs/franka.md, Before the first motion"
            )
        times = self._log[: min(counts.cycles, ROWS), -1]
        quantiles = dict(zip(("p50", "p99", "max"), (0.5, 0.99, 1.0), strict=True))
        found["times"] = {n: float(np.quantile(times, q)) for n, q in quantiles.items()}
        return found | {"counts": vars(counts)}

    def close(self) -> None:
        """Come to rest, end the motion and leave the arm; harmless when repeated."""
        if self._is_alive():
            self._order(End())
        self._wait()
        self._pipe.close()

    # -- inside ------------------------------------------------------------------

    def _end_stop(self) -> None:
        self._is_stopped = False
        if not self._is_starting:
            self._order(Clear())

    def _is_alive(self) -> bool:
        return self._loop.poll() is None

    def _wait(self, timeout: float = _ENDS) -> None:
        """Wait [s] for the loop's end; one that hangs is killed: the arm stops."""
        try:
            self._loop.wait(timeout)
        except subprocess.TimeoutExpired:
            self._loop.kill()
            self._loop.wait()

    def _order(self, order: Any) -> None:
        try:
            self._pipe.send(order)
        except OSError:
            return  # the loop has ended: the next answer says why

    def _follow(self, target: "_core.Target", cycles: int) -> None:
        timeout = round(self._address.target_timeout / PERIOD)
        self._order(Order.of(target, cycles, timeout))
        wait = min(self._address.timeout, _SILENCE)
        self._seen = self._receive(cycles * PERIOD + wait)
        if self._seen.problem:
            raise ArmError(
                f"the arm is held: {self._seen.problem}; reset() goes on", "stopped"
            )

    def _receive(self, timeout: float) -> Seen:
        """Wait for the arm's state [s].

        Raises:
            ArmError: The loop has ended, or says nothing.
        """
        seen: Seen = self._answer(timeout)
        self._counts = seen.counts
        self._problem = seen.problem
        return seen

    def _answer(self, timeout: float) -> Any:
        """Wait for what the loop sends [s].

        Raises:
            ArmError: It has ended, or says nothing.
        """
        end = time.monotonic() + timeout
        try:
            while not self._pipe.poll(0.05):
                if not self._is_alive() and not self._pipe.poll():
                    raise EOFError
                # Where this process had no time, the answer may be there by now.
                if time.monotonic() > end and not self._pipe.poll():
                    raise self._abort(timeout)
            answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise self._fail("has ended", "loop_ended") from error
        if isinstance(answer, Failed):
            raise self._failed(answer)
        return answer

    def _abort(self, timeout: float) -> ArmError:
        """End a loop that was silent for so long [s]; it prints where it hangs."""
        self._loop.send_signal(signal.SIGABRT)
        self._wait(_ABORTS)
        return self._fail(
            f"has said nothing for {timeout:g} s: it was ended", "silence"
        )

    def _fail(self, text: str, reason: str) -> ArmError:
        self._problem = (
            f"the arm's loop {text}. The control box stops the arm, as no command "
            "arrives; reset() begins anew, with recover=yes in the address"
        )
        return ArmError(self._problem, reason)

    def _failed(self, answer: Failed) -> ArmError:
        """Return the error of a loop that has ended."""
        self._wait()
        if answer.kind == "mode":
            reason, remedy = MODES.get(answer.text, MODES["Other"])
            error = ArmError(f"the arm's mode is {answer.text}: {remedy}", reason)
        elif answer.kind == "priority":
            error = ArmError(
                "no permission for real-time priority: allow it in "
                "/etc/security/limits.conf (rtprio 99), or leave realtime out",
                "no_permission",
            )
        elif answer.kind == "connection" and self._counts is None:
            error = not_connected(answer.text, self._address.host)
        elif answer.kind == "connection":
            error = connection_lost(answer.text, self._address.host)
        else:
            error = motion_ended(answer.text, answer.success_rate)
        self._problem = str(error)
        return error

    def _state(self, seen: Seen) -> ArmState:
        from dovetail import _core

        rows = np.arange(seen.first, seen.tick) % ROWS
        log = self._log[rows, :-1]
        log[:, 0] -= self._begin
        self._left = seen.q
        found = _core.summarize(self._chain, seen.q, seen.dq, log)
        tool, none = ToolState(*found[:3]), np.full(3, np.nan)
        return ArmState(
            seen.time - self._begin, seen.q, seen.dq, tool, none, *found[4:], log
        )
