"""One try of the adversary in contact: 5 s of a twin under the shipped controller.

The Target, pushes and reconfigurations change every 50 ms; in two quiet sections of
1.25 s nothing changes and no cycle is faulty, and `contact_growth` looks for what
vibrates.

The resting push is what the Target asks for, as a static force on the tool: the linear
part of Lambda (f* + K e), e from the pose that was latched, plus the weight that nobody
compensates, plus push and spring, at least 10 N, the largest of the last half second.
The contact force that is compared with it is a mean over 20 ms, not within 150 ms of a
first touch: that is an impact, whose peak is told apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail import _bench, _core
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS, FLAG_MASK, physics_steps
from dovetail.plants.twin import Twin
from dovetail.poses import Pose, quat_from_vector, quat_multiply, rotation_error
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.settings import values_of

from .contact_choices import Array, Choices
from .contact_growth import WINDOW, lasts, oscillation
from .contact_policies import ACTION, TASK, Commander, near_press_of
from .contact_scene import EVERYWHERE, NOWHERE, Start, make_start, walls_of

ACTIONS = 100
CHANGES = (
    "hold here",
    "hold nearby",
    "reset here",
    "reset nearby",
    "near plane",
    "joint target",
)
QUIET = (range(40, 65), range(75, 100))
LOOK_ON = 20  # actions
PHYSICS_DT = 1e-3  # s: contacts of 2 ms need it, and the judge looks as often
SPRING_MASS = 5.0  # kg, for its damping ratio
IMPLAUSIBLE, ENDED = FLAG_MASK["implausible"], FLAG_MASK["ended"]
CLEARANCE_STEP = 1e-4  # m: plants are built once each


@lru_cache(maxsize=8)
def settings_of(
    robot: str,
    period: float,
    is_hardware: bool,
    task: str,
    overrides: tuple[tuple[str, Any], ...],
    near_press: float,
) -> tuple[OscConfig, LimitConfig]:
    """Return law and limits as the environment makes them."""
    cell = replace(find_cell(robot=robot), walls=walls_of(task))
    config = EnvConfig(period=period, near_press=near_press)
    return having(*make_settings(cell, config, is_hardware=is_hardware), overrides)


def having(
    osc: OscConfig, limits: LimitConfig, overrides: tuple[tuple[str, Any], ...]
) -> tuple[OscConfig, LimitConfig]:
    """Return law and limits with other numbers, whichever of both has the name."""
    usual = values_of(osc) | values_of(limits)
    others: dict[str, Any] = {
        k: type(usual[k])(v) if k in usual and not isinstance(v, tuple) else v
        for k, v in overrides
    }
    law = {name: others.pop(name) for name in values_of(osc).keys() & others.keys()}
    return replace(osc, **law), replace(limits, **others)


@lru_cache(maxsize=16)
def plant_of(robot: str, clearance: float) -> MujocoPlant:
    """Return the scene of a robot with a clearance [m]."""
    return MujocoPlant(find_cell(robot=robot, clearance=clearance))


@dataclass(frozen=True)
class Outcome:
    """What one try came to; JSON but for the trace."""

    worst: dict[str, float]
    """The worst of each limit, see `METRICS`."""
    when: dict[str, tuple[float, int]]
    """Time [s] and axis of it."""
    counts: dict[str, int]
    cycles: int
    trace: Array
    """The cycles' log, CYCLE_COLUMNS."""
    events: list[str]
    """What was reconfigured, with its time."""


class Trial:
    """One try."""

    def __init__(
        self,
        choices: Choices,
        period: float,
        seed: tuple[int, ...],
        *,
        robot: str = DEFAULT_ROBOT,
        is_hardware: bool = True,
        overrides: tuple[tuple[str, Any], ...] = (),
    ) -> None:
        """Build twin and controller.

        Args:
            choices: The try.
            period: Control period [s].
            seed: Of all that is random in it.
            robot: The arm by name.
            is_hardware: Margins for an arm that is not as the model says.
            overrides: Other numbers in LimitConfig or OscConfig.
        """
        self.choices, self.period = choices, period
        self.rng = np.random.default_rng(seed)
        twin = choices.twin(robot)
        clearance = CLEARANCE_STEP * round(choices.clearance / CLEARANCE_STEP)
        self.plant = plant = plant_of(robot, clearance)
        plant.configure(replace(twin.dynamics(), physics_dt=PHYSICS_DT))
        self.osc, self.limits = settings_of(
            robot, period, is_hardware, choices.task, overrides, near_press_of(choices)
        )
        self.robot, self.chain = plant.robot, plant.robot.chain()
        self.true_chain = _true_chain(robot, twin)
        self.controller = _core.Controller(
            self.chain,
            self.osc.params(),
            self.limits.params(),
            list(TaskSpec.parse(TASK).modes),
            period,
        )
        own = self.robot.limits
        low, high = own.q_min + own.room_at(0.0), own.q_max - own.room_at(0.0)
        judged = replace(self.limits, q_min=low, q_max=high)  # the robot's, not ours
        self.judge = _bench.ContactJudge(self.chain, judged.params())
        self.start: Start = make_start(self.rng, plant, self.limits, choices)
        plant.attach_channel(
            _core.Channel(
                delay=twin.command_delay,
                torque_noise=twin.torque_noise,
                position_noise=twin.position_noise,
                velocity_noise=twin.velocity_noise,
                seed=int(self.rng.integers(1 << 31)),
            )
        )
        plant.reset(self.start.q, self.start.hole)
        self.loop = plant._loop
        self.loop.attach_probe(self.judge, plant._pushed)
        self.steps = physics_steps(period, PHYSICS_DT)
        plant.model.opt.timestep = period / self.steps
        self.hold = self.start.hold
        self._attach_spring()
        q, _ = plant.read()
        self.controller.reset(q, *self.hold)
        self.latched, self.latched_q = self.robot.tool_pose(self.start.q), self.start.q
        self.at_start = self._statics(self.start.q)
        self.commander = Commander(choices, self.start, self.robot, self.rng)
        if choices.is_tared:
            self.commander.tare = np.append(-self.at_start[0][:3], np.zeros(3))
        self.asked: list[float] = []
        self.joint_actions = 0
        self.events: list[str] = []

    def _attach_spring(self) -> None:
        choices = self.choices
        if choices.task != "spring":
            return
        k = choices.spring
        anchor = self.robot.tool_pose(self.start.q).position
        anchor = anchor + np.array(choices.spring_pull) / k
        damping = 2.0 * choices.spring_ratio * np.sqrt(k * SPRING_MASS)
        self.judge.set_spring(anchor, k, damping)

    def run(self, hold_on: float = 0.0) -> Outcome:
        """Run the try to its end, or until the simulation diverges.

        Args:
            hold_on: How long it goes on after that [s], with nothing new.
        """
        more = [ACTIONS - 1] * round(hold_on / ACTION)
        trace, vibration, diverged = self._run([*range(ACTIONS), *more])
        return self._outcome(trace, vibration, diverged)

    def look_on(self, quiet: range) -> float:
        """Run the try until a second after a quiet section, with nothing new in it.

        Returns:
            RMS [rad/s] of what grew in the section and lasted, see `contact_growth`; 0
            where what seemed to grow had risen by chance.
        """
        more = [quiet[-1]] * LOOK_ON
        trace, vibration, diverged = self._run([*range(quiet.stop), *more])
        grown, _ = oscillation(vibration[quiet.start : quiet.stop])
        flags = trace[:, COLUMN["flags"]].astype(np.int64)
        before = None
        if (flags & ENDED).any():
            action = int(np.argmax(flags & ENDED)) // round(ACTION / self.period)
            is_here = action >= quiet.start
            section = slice(quiet.start, quiet.stop)
            last = slice(action - WINDOW, action)
            before = vibration[last if is_here else section]
        is_one = lasts(grown, vibration[quiet.stop :], before, self.controller.end[0])
        return grown if diverged or is_one else 0.0

    def _run(self, numbers: Sequence[int]) -> tuple[Array, Array, int]:
        """Return the cycles' log, what vibrated per action [rad/s], if it diverged."""
        per_action = round(ACTION / self.period)
        trace = np.zeros((len(numbers) * per_action, len(CYCLE_COLUMNS)))
        target = _core.Target()
        vibration = np.zeros(len(numbers))
        done, diverged = 0, 0
        for i, number in enumerate(numbers):
            is_quiet = any(number in quiet for quiet in QUIET)
            is_first = any(i == quiet[0] for quiet in QUIET)
            q, dq = self.plant.read()
            if not is_quiet or is_first:
                self._command(target, number, q, dq)
            faults = self._faults(per_action) if not is_quiet else _NO_FAULTS
            faults = faults[:per_action]
            self._expect(target)
            log = trace[done : done + per_action]
            try:
                self.loop.run_faulty(self.controller, target, self.steps, faults, log)
            except RuntimeError:
                diverged = 1
                break
            done += per_action
            vibration[i] = self.judge.take_vibration()
        self.loop.attach_probe(None, 0)
        return trace[:done], vibration, diverged

    def _command(self, target: _core.Target, number: int, q: Array, dq: Array) -> None:
        """Change what a new action changes: Target, push, sometimes more."""
        choices, rng = self.choices, self.rng
        if choices.push and number % max(1, round(choices.push_time / ACTION)) == 0:
            direction = rng.normal(size=3)
            on = float(rng.random() < 0.5)
            self.push = on * choices.push * direction / np.linalg.norm(direction)
            self.judge.set_push(self.push)
        self.joint_actions = max(0, self.joint_actions - 1)
        if target.joint_mode and not self.joint_actions:
            target.joint_mode = False
            self.events.append(f"{number * ACTION:.2f} s: task again")
        if rng.random() < choices.change_rate * ACTION:
            kind = self._reconfigure(target, q, dq)
            self.events.append(f"{number * ACTION:.2f} s: {kind}")
        self.commander.fill(target, number, q, dq)

    def _reconfigure(self, target: _core.Target, q: Array, dq: Array) -> str:
        """Change what is held, where the near plane is, or go for a configuration."""
        rng, controller = self.rng, self.controller
        pose = self.robot.tool_pose(q)
        turn = quat_from_vector(rng.normal(0.0, 0.05, 3))
        moved = Pose(
            pose.position + rng.normal(0.0, 0.02, 3),
            quat_multiply(turn, pose.quat_wxyz),
        )
        limits = self.limits
        near_q = np.clip(q + rng.normal(0.0, 0.1, 7), limits.q_min, limits.q_max)
        self.latched, self.latched_q = pose, q
        kind = CHANGES[rng.integers(len(CHANGES))]
        if kind.startswith("hold"):
            self.hold = pose if kind == "hold here" else moved
            controller.hold_at(*self.hold)
        elif kind.startswith("reset"):
            self.hold = pose if kind == "reset here" else moved
            controller.reset(q, *self.hold, dq)
        elif kind == "near plane":
            planes = (NOWHERE, EVERYWHERE, self.start.near_plane)
            self.commander.near_plane = planes[rng.integers(3)]
        else:
            target.joint_mode = True
            target.q_d = near_q
            self.joint_actions = int(rng.integers(2, 11))
        return kind

    def _faults(self, cycles: int) -> NDArray[np.int8]:
        """Return bursts of up to five lost, repeated or late cycles."""
        faults = np.zeros(cycles, dtype=np.int8)
        rate = self.choices.fault_rate
        if rate == 0.0:
            return faults
        for i in np.flatnonzero(self.rng.random(cycles) < rate):
            length = int(self.rng.integers(1, 6))
            burst = (
                np.full(length, -1),  # lost, and told
                np.full(length, -2),  # lost
                np.arange(1, length + 1),  # one state again and again
                np.full(length, length),  # late
            )[self.rng.integers(4)]
            faults[i : i + length] = burst[: cycles - i]
        return faults

    def _statics(self, q: Array) -> tuple[Array, Array, Array]:
        """Return the missed weight as f*, Lambda and J, rotations scaled by L."""
        J = self.chain.jacobian(q)
        J[3:] *= self.osc.length_scale
        M = self.chain.inertia_matrix(q)
        M[np.diag_indices(7)] += self.robot.motors.armature
        Minv_JT = np.linalg.solve(M, J.T)
        values, vectors = np.linalg.eigh(J @ Minv_JT)
        Lambda = (vectors / np.maximum(values, self.osc.s0)) @ vectors.T
        missed = self.chain.gravity(q) - self.true_chain.gravity(q)
        return Minv_JT.T @ missed, Lambda, J

    def _expect(self, target: _core.Target) -> None:
        """Tell the judge the resting push."""
        joint, f = np.zeros(7), np.zeros(6)
        if target.joint_mode:
            joint = self.osc.joint_stiffness * (target.q_d - self.latched_q)
            ddq_max = self.limits.ddq_max
            joint = np.clip(joint, -ddq_max, ddq_max)
        else:
            e = rotation_error(self.hold.quat_wxyz, self.latched.quat_wxyz)
            e[2] = rotation_error(target.quat_wxyz_d, self.latched.quat_wxyz)[2]
            clamp = self.osc.error_clamp_rotation
            e *= min(1.0, clamp / max(float(np.linalg.norm(e)), 1e-9))
            f = np.array(target.f_star)
            f[3:] = self.osc.length_scale * self.osc.stiffness[3:] * e
        forces = []
        for weight, Lambda, J in (self._statics(self.plant.data.qpos), self.at_start):
            asked = J @ joint if target.joint_mode else f
            parts = (Lambda @ asked)[:3], (Lambda @ weight)[:3]
            forces.append(sum(float(np.linalg.norm(part)) for part in parts))
        # A thrown arm asks for much near singular postures: no excuse for contact.
        force = min(forces[0], 2.0 * forces[1]) + self.choices.push
        self.asked.append(force)
        self.judge.set_resting(max(self.asked[-10:]))

    def _end(self) -> list[str]:
        """Return why the last line ended the motion, if it did."""
        cause, joint, value, limit = self.controller.end
        if cause == "none":
            return []
        return [f"ended: {cause}, joint {joint + 1}, {value:.3g} over {limit:.3g}"]

    def _outcome(self, trace: Array, vibration: Array, diverged: int) -> Outcome:
        judge = self.judge
        seen = {
            "position": judge.position,
            "speed": judge.speed,
            "taper": judge.tapered_speed,
            "wall": judge.wall,
            "tcp_speed": judge.tcp_speed,
            "torque": judge.torque,
            "contact": judge.contact,
            "peak": judge.peak,
            "load": judge.load,
        }
        grown, sustained = _oscillations(vibration)
        tau = trace[:, COLUMN["tau1"] : COLUMN["tau7"] + 1]
        rates = np.abs(np.diff(tau, axis=0)) / self.period
        rate = float((rates / self.robot.limits.dtau_max).max(initial=0.0))
        flags = trace[:, COLUMN["flags"]].astype(np.int64)
        unsafe, early, bad = judge.flagged
        return Outcome(
            worst={name: w.value for name, w in seen.items()}
            | {
                "rate": rate,
                "grown": grown,
                "sustained": sustained,
                "touch": judge.touch_speed,
            },
            when={name: (w.time, w.axis) for name, w in seen.items()},
            counts={name: w.count for name, w in seen.items()}
            | {
                "diverged": diverged,
                "ended": int((flags & ENDED).any()),
                f"ended: {self.controller.end[0]}": int((flags & ENDED).any()),
                "implausible": int((flags & IMPLAUSIBLE).any()),
                "unsafe": unsafe,
                "qp_early": early,
                "bad_input": bad,
                "looks": judge.looks,
            },
            cycles=len(trace),
            trace=trace,
            events=[*self.events, *self._end()],
        )


_NO_FAULTS: NDArray[np.int8] = np.zeros(1000, dtype=np.int8)


def _oscillations(vibration: Array) -> tuple[float, float]:
    """Return the largest RMS [rad/s] of one that grew, and of one that stayed."""
    found = [oscillation(vibration[quiet.start : quiet.stop]) for quiet in QUIET]
    grown, sustained = np.max(found, axis=0)
    return float(grown), float(sustained)


def _true_chain(name: str, twin: Twin) -> _core.Chain:
    """Return the chain of a robot's twin, whose gravity is the true one."""
    robot = find_cell(robot=name).loaded_robot(twin.inertia)
    scale = np.array(twin.mass_scale)
    inertia = robot.links.inertia * scale[:, None, None]
    links = replace(robot.links, mass=robot.links.mass * scale, inertia=inertia)
    actual: Any = replace(robot, links=links)
    residual = np.array(twin.gravity_residual)
    return actual.chain(np.array([0.0, 0.0, -9.81]) + residual)
