"""The 1 kHz loop of a Franka, in a process of its own: nothing else takes its time.

It reads the arm's state, runs the controller, and sends torques. Orders and states go
through a pipe, the log through memory that both ends share. Without orders it holds the
arm. If the learner's process is gone, it brakes and ends the motion.

One thread does all of it: libfranka gives it real-time priority where it may, and
another one would come to run once in seconds.
"""

import faulthandler
import gc
import mmap
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dovetail.arms.franka.at_rest import look
from dovetail.arms.franka.load import load_beyond
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.types import Array, Vec3, Vec4, Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.control.settings import ControllerSettings
    from dovetail.robots.robot import Payload, Robot

PERIOD = 1e-3
"""Period of the protocol [s]."""
_REST_SPEED = 0.02  # rad/s: an arm that is slower is held where it is
# s: the hold target is where the arm was this long ago, so that stiffness brakes as
# well as damping
_BEHIND = 0.2
_LONGEST_END = 0.5  # s to come to rest before the motion is ended all the same
ROWS = 20_000
"""Cycles that the shared log holds; the learner reads at most the last half of them,
while the loop writes on."""
COLUMNS = (*CYCLE_COLUMNS, "loop_time")
"""Columns of the shared log: the last is the time from the arm's message to the
command [s]."""
PRIORITY = 80
"""Real-time priority of the loop."""


class Order(NamedTuple):
    """A Target to follow, and for how long."""

    values: dict[str, Any]
    cycles: int
    """Periods of the arm's clock, those whose messages are lost included."""
    timeout: int
    """Periods after its end for which it is followed on."""

    @classmethod
    def of(cls, target: "_core.Target", cycles: int, timeout: int) -> "Order":
        """Return the order to follow a Target."""
        values = {
            "f_star": target.f_star,
            "position_d": target.position_d,
            "quat_wxyz_d": target.quat_wxyz_d,
            "velocity_d": target.velocity_d,
            "acceleration_d": target.acceleration_d,
            "age": target.age,
            "near_plane": target.near_plane,
            "f_tare": target.f_tare,
            "stay": target.stay,
            "joint_mode": target.joint_mode,
            "q_d": target.q_d,
        }
        return cls(values, cycles, timeout)

    def target(self) -> "_core.Target":
        """Return its Target."""
        from dovetail import _core

        target = _core.Target()
        for name, value in self.values.items():
            setattr(target, name, value)
        return target


class Latch(NamedTuple):
    """A pose to hold from now on."""

    position: Vec3
    quat_wxyz: Vec4


class Stop(NamedTuple):
    """Hold until `Clear`."""


class Clear(NamedTuple):
    """End a stop: only a new order moves the arm."""


class End(NamedTuple):
    """Come to rest and end the motion."""


class Seen(NamedTuple):
    """State of the arm after some cycles, for the learner."""

    tick: int
    """Cycles since the motion began."""
    time: float
    """Time since then until q was measured, by the arm's clock [s]."""
    q: Vec7
    dq: Vec7
    first: int
    """First cycle of the log that the learner has not seen."""
    counts: "Counts"
    problem: str = ""
    """Reason why the arm does not follow; empty if it does."""


class Failed(NamedTuple):
    """The end of the loop, and why."""

    kind: str
    """ "connection", "mode" or "motion"."""
    text: str
    success_rate: float


@dataclass
class Counts:
    """Counts of a loop."""

    cycles: int = 0
    lost: int = 0
    """Cycles of the arm that had no command."""
    held: int = 0
    """Cycles without a fresh order."""
    success_rate: float = 1.0


class Begin(NamedTuple):
    """Begin the motion: the checks at rest have passed."""


class Job(NamedTuple):
    """The arm to connect to, and its controller."""

    host: str
    """Address of the control box."""
    robot: "Robot"
    """The controller's model, tool included."""
    settings: "ControllerSettings"
    is_realtime: bool
    """Run with real-time priority."""
    may_recover: bool
    """End a reflex that stands from before."""
    payload: "Payload | None"
    """All that the flange carries, by the cell; None leaves Desk's load."""
    ask_model: bool
    """Read the arm's own model at rest."""


def share_log(handle: int) -> Array:
    """Return the log in a memory file, shape (ROWS, columns of COLUMNS).

    Args:
        handle: File descriptor of the file, which is made as large as the log.
    """
    shape = ROWS, len(COLUMNS)
    size = 8 * shape[0] * shape[1]
    os.ftruncate(handle, size)
    return np.ndarray(shape, buffer=mmap.mmap(handle, size))


def run(handle: int, log_handle: int) -> None:
    """Take a job, and serve orders until one says End or the other end is gone.

    The arm at rest is the first answer. The motion begins with `Begin`.

    Args:
        handle: File descriptor of a pipe: orders in, `Rest`, `Seen` and `Failed` out.
        log_handle: File descriptor of the log, see `share_log`.
    """
    faulthandler.enable()  # the learner aborts a loop that hangs: it says where
    pipe, log = Connection(handle), share_log(log_handle)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the learner says when it ends
    import pylibfranka

    job: Job = pipe.recv()
    rate = 1.0
    try:
        arm = pylibfranka.Robot(job.host, pylibfranka.RealtimeConfig.kIgnore)
        if not _prepare(arm, job, pipe):
            return
        loop = Loop(pipe, job.robot, job.settings, log)
        loop.begin(np.array(arm.read_once().q))
        pipe.send(loop.seen())
        if job.is_realtime and os.sched_getscheduler(0) != os.SCHED_FIFO:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        gc.collect()
        gc.disable()
        control = arm.start_torque_control()
        for share in loop.cycles(control, pylibfranka.Torques):
            rate = share
        if loop.is_left:
            _log("the arm was braked and its motion ended")
    except pylibfranka.NetworkException as error:
        _send(pipe, Failed("connection", str(error), rate))
    except (pylibfranka.ControlException, pylibfranka.CommandException) as error:
        _send(pipe, Failed("motion", str(error), rate))
    except PermissionError:
        _send(pipe, Failed("priority", "", rate))


def _prepare(arm: Any, job: Job, pipe: Connection) -> bool:
    """Send what the arm is at rest; return whether its motion may begin."""
    state = arm.read_once()
    if job.may_recover and state.robot_mode.name in ("Reflex", "Other"):
        arm.automatic_error_recovery()
        state = arm.read_once()
    if state.robot_mode.name != "Idle":
        pipe.send(Failed("mode", state.robot_mode.name, 1.0))
        return False
    if job.payload is not None:
        inertia = np.reshape(state.I_ee, (3, 3), order="F")
        hand = state.m_ee, np.array(state.F_x_Cee), inertia
        mass, com, inertia = load_beyond(job.payload, hand)
        arm.set_load(mass, com.tolist(), inertia.ravel(order="F").tolist())
    most = job.robot.limits.tau_max.tolist()
    arm.set_collision_behavior(most, most, [100.0] * 6, [100.0] * 6)
    pipe.send(look(arm, ask_model=job.ask_model))
    try:
        return isinstance(pipe.recv(), Begin)
    except EOFError:
        return False  # the learner has gone


def _send(pipe: Connection, message: Failed) -> None:
    try:
        pipe.send(message)
    except OSError:  # the learner has gone
        _log(f"the arm's motion has ended: {message.text}")


def _log(text: str) -> None:
    """Write to the standard error how a motion ended without a learner."""
    with suppress(OSError):
        sys.stderr.write(
            f"learner_gone: the program that commanded the arm has ended; {text}\n"
        )


class Loop:
    """Controller, orders and log of a motion."""

    def __init__(
        self,
        pipe: Connection,
        robot: "Robot",
        settings: "ControllerSettings",
        log: Array,
    ) -> None:
        """Build the controller.

        Args:
            pipe: Orders in, `Seen` out.
            robot: The controller's model, tool included.
            settings: Of the controller.
            log: Where the cycles go, see `share_log`.
        """
        from dovetail.control.build import make_controller

        self._pipe, self._robot = pipe, robot
        self._controller = make_controller(
            robot, settings.osc, settings.limits, settings.task, settings.period
        )
        self._chain = robot.chain()
        self._log = log
        self._sent = 0  # rows that the learner has
        self._tick = 0  # rows of the log
        self._now = 0  # periods by the arm's clock, also those without a message
        self._goal = 0
        self._until = 0
        self._target: _core.Target | None = None
        self._is_asked = False
        self._is_stopped = False
        self._problem = ""
        self._end: int | None = None
        self._is_at_rest = False
        self._hold = np.zeros(7)
        self.counts = Counts()
        self.is_left = False
        """True once the learner has gone."""
        self._q, self._dq = np.zeros(7), np.zeros(7)

    def begin(self, q: Vec7) -> None:
        """Begin at q [rad], at rest."""
        pose = self._robot.tool_pose(q)
        self._controller.reset(q, pose.position, pose.quat_wxyz)
        self._q, self._hold = q, q

    def cycles(self, control: Any, torques: Any) -> Iterator[float]:
        """Run the motion to its end; yields the share of commands that arrived."""
        controller, counts = self._controller, self.counts
        while True:
            state, duration = control.readOnce()
            begin = time.perf_counter()
            self._q, self._dq = np.array(state.q), np.array(state.dq)
            passed = 1
            if counts.cycles:
                passed = max(1, round(duration.to_sec() / PERIOD))
                counts.lost += passed - 1
                self._now += passed
            step = passed * PERIOD
            self._take_orders()
            target, is_late = self._choose(step)
            controller.had(np.array(state.tau_J_d))
            result = controller.step(self._q, self._dq, target, step)
            if result.flags.ended and not self._is_stopped:
                self._is_stopped = True
                self._problem = (
                    "the controller's last line ended the motion: "
                    f"{controller.end_text}"
                )
            command = torques(result.tau.tolist())
            if is_last := self._is_over():
                command.motion_finished = True
            control.writeOnce(command)
            took = time.perf_counter() - begin
            counts.success_rate = state.control_command_success_rate
            counts.held += is_late
            self._answer()  # it takes longer than a torque may
            self._note(result, target, took)
            counts.cycles += 1
            if is_last:
                return
            yield counts.success_rate

    def seen(self) -> Seen:
        """Return what the learner has not seen yet."""
        first = max(self._sent, self._tick - len(self._log) // 2)
        self._sent = self._tick
        return Seen(
            self._tick,
            self._now * PERIOD,
            self._q,
            self._dq,
            first,
            self.counts,
            self._problem,
        )

    def _take_orders(self) -> None:
        try:
            while self._pipe.poll():
                self._take(self._pipe.recv())
        except (EOFError, OSError):
            self._leave()

    def _answer(self) -> None:
        """Send the state once the order that the learner waits for is done."""
        if not self._is_asked or (self._now < self._goal and not self._is_stopped):
            return
        self._is_asked = False
        try:
            self._pipe.send(self.seen())
        except OSError:
            self._leave()

    def _leave(self) -> None:
        self.is_left = True
        self._finish()

    def _take(self, order: Any) -> None:
        match order:
            case Order():
                late = self._now - self._goal
                if late > order.cycles // 2:  # the learner was slow: it begins now
                    self._goal += late
                self._goal += order.cycles
                self._until = self._goal + order.timeout
                self._target = order.target()
                self._is_asked = True
            case Latch():
                self._controller.hold_at(order.position, order.quat_wxyz)
                self._goal = self._now
            case Stop():
                self._is_stopped, self._problem = True, "it was told to stop"
            case Clear():
                self._is_stopped, self._problem = False, ""
                self._target, self._goal = None, self._now
                pose = self._robot.tool_pose(self._q)
                self._controller.reset(self._q, pose.position, pose.quat_wxyz, self._dq)
            case End():
                self._finish()

    def _finish(self) -> None:
        if self._end is None:
            self._end = self._now + round(_LONGEST_END / PERIOD)

    def _is_over(self) -> bool:
        return self._end is not None and (self._is_at_rest or self._now >= self._end)

    def _choose(self, step: float) -> tuple["_core.Target", bool]:
        """Return the Target of this cycle, and whether it is the hold.

        Args:
            step: Time since the last cycle [s].
        """
        is_wanted = self._target is not None and self._now < self._until
        if is_wanted and not self._is_stopped and self._end is None:
            self._is_at_rest = False
            assert self._target is not None
            self._target.age += step
            return self._target, False
        from dovetail import _core

        if not self._is_at_rest:
            self._hold = self._q - _BEHIND * self._dq
            self._is_at_rest = bool(np.abs(self._dq).max() < _REST_SPEED)
        return _core.Target(joint_mode=True, q_d=self._hold), True

    def _note(self, result: Any, target: "_core.Target", took: float) -> None:
        from dovetail import _core
        from dovetail.poses import quat_from_matrix

        position, rotation = self._chain.pose(self._q)
        row = self._log[self._tick % len(self._log)]
        row[-1] = took
        row[:-1] = _core.cycle_row(
            time=self._now * PERIOD,
            q=self._q,
            dq=self._dq,
            tau=result.tau,
            position=position,
            quat_wxyz=quat_from_matrix(rotation),
            twist=self._chain.jacobian(self._q) @ self._dq,
            contact_force=np.full(3, np.nan),
            f_star=target.f_star[:3],
            flags=result.flags,
            wrench=self._controller.wrench,
        )
        self._tick += 1
