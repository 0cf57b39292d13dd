"""A policy that wants to break the limits, against an exact rigid arm.

Episodes of 5 s start at rest at random postures inside joint limits and walls. Twenty
times a second the adversary chooses a corner of the f* range: at random, at random and
held for a second, or so that a joint is driven to its nearer limit; and it turns the
desired rotation about the vertical to any angle. The true state is compared with the
true limits (no margin) every millisecond or less.

``--mismatch`` makes everything wrong at once: link masses +-20 % at random each episode
(so gravity is compensated wrongly), 80 % of damping and rotor inertia modelled, 0.3 Nm
of dry friction, noise on the measured speed, a delay (``--delay``), pushes of 30 N
on the TCP for a quarter of a second, in steps or with ``--push-rise``.

``--contact`` attacks in contact, on random twins with delay: `contact_adversary`.
"""

import argparse
import sys
import time
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.limits import BOUNDS, SCHEMES
from dovetail.envs.registered import find_cell
from dovetail.poses import quat_about_z, quat_multiply
from dovetail.robots.robot import Robot

TASK = "XYZ:force A:pose BC:hold"
EPISODE = 5.0  # s
ACTION = 0.05  # s
HELD = 1.0  # s
CHECK = 1e-3  # s between two looks at the plant
PUSH, PUSH_TIME = 30.0, 0.25  # N, s; on half of the time
SPEED_NOISE = 1e-3  # rad/s, standard deviation
MASS_SPREAD, MODELLED, COULOMB = 0.2, 0.8, 0.3  # share, share, Nm
START_ROOM = 0.02  # m from the walls
RATE_ROUNDING = 1e-6  # Nm/s
LOST = 1e3  # rad or rad/s: the arm has blown up

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What is attacked, and how."""

    robot: str | None = None
    period: float = 1e-3
    scheme: str = "qp"
    bounds: str = "viability"
    f_star: float = 30.0
    walls: bool = True
    mismatch: bool = False
    pushes: bool = True
    delay: float = 1e-3
    estimate_rate: float | None = None
    last_line: bool = False
    delta_x: float | None = None
    delta_v: float | None = None
    push_rise: float = 0.0
    exact_sjs: bool = False
    home: bool = False


@dataclass
class Excess:
    """How often and how far one limit was exceeded."""

    count: int = 0
    worst: float = 0.0
    axes: set[int] = field(default_factory=set)
    """Joints or TCP axes that were over it, from 1."""

    def add(self, over: Array) -> None:
        """Count the looks of an episode, one row each, whose largest excess is > 0."""
        highest = over.max(axis=1)
        self.count += int((highest > 0).sum())
        self.worst = max(self.worst, float(highest.max()))
        self.axes.update((np.flatnonzero((over > 0).any(axis=0)) + 1).tolist())


@dataclass
class Report:
    """Totals of all episodes."""

    cycles: int = 0
    looks: int = 0
    blown_up: int = 0
    flags: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(("unsafe", "qp_early", "displaced"), 0)
    )
    position: Excess = field(default_factory=Excess)
    speed: Excess = field(default_factory=Excess)
    torque: Excess = field(default_factory=Excess)
    tapered_speed: Excess = field(default_factory=Excess)
    torque_rate: Excess = field(default_factory=Excess)
    wall: Excess = field(default_factory=Excess)
    tcp_speed: Excess = field(default_factory=Excess)
    episodes: list[int] = field(default_factory=list)

    def violations(self) -> int:
        """Return the looks at which a joint, a motor or a wall was over its limit."""
        limits = (
            self.position,
            self.speed,
            self.torque,
            self.tapered_speed,
            self.torque_rate,
            self.wall,
        )
        return sum(limit.count for limit in limits) + self.blown_up


def limits_of(robot: Robot, settings: Settings) -> LimitConfig:
    """Return the limits: the shipped values for the period, or for mismatch."""
    overrides: dict[str, object] = {
        "scheme": settings.scheme,
        "bounds": settings.bounds,
        "walls": settings.walls,
        "exact_sjs": settings.exact_sjs,
        "last_line": settings.last_line,
    }
    if settings.mismatch:
        motors = robot.motors
        overrides |= {
            "damping": MODELLED * motors.damping,
            "armature": MODELLED * motors.armature,
        }
    for name in ("estimate_rate", "delta_x", "delta_v"):
        if getattr(settings, name) is not None:
            overrides[name] = getattr(settings, name)
    return LimitConfig.for_period(
        robot, settings.period, hardware=settings.mismatch, **overrides
    )


class Adversary:
    """Runs episodes and keeps the totals in `report`."""

    def __init__(self, settings: Settings, seed: int) -> None:
        self.settings = settings
        self.seed = seed
        name = settings.robot
        cell = find_cell(robot=name) if name else find_cell()
        self.robot = cell.robot if name else cell.loaded_robot()
        self.chain = self.robot.chain()
        self.limits = limits_of(self.robot, settings)
        self.controller = make_controller(
            self.robot,
            OscConfig.for_period(settings.period),
            self.limits,
            TASK,
            settings.period,
        )
        self.report = Report()

    def run(self, cycles: int) -> Report:
        """Run at least this many control cycles."""
        per_episode = min(cycles, round(EPISODE / self.settings.period))
        for episode in range(-(-cycles // per_episode)):
            before = self.report.violations()
            self.run_episode(episode, per_episode)
            if self.report.violations() > before:
                self.report.episodes.append(episode)
        return self.report

    def run_episode(self, episode: int, cycles: int) -> None:
        """Run one episode, the same whatever ran before, and add it to the report."""
        self.rng = np.random.default_rng([self.seed, episode])
        settings, rng = self.settings, self.rng
        q = self.start()
        pose = self.robot.tool_pose(q)
        self.controller.reset(q, pose.position, pose.quat_wxyz)
        plant = self.plant()
        plant.reset(q, np.zeros(7))
        kind = int(rng.integers(3))
        per_action = round(ACTION / settings.period)
        self.last_push, self.next_push = np.zeros(3), np.zeros(3)
        looks = max(1, round(settings.period / CHECK))
        states: list[tuple[Array, Array]] = []
        motor, overlay = np.empty((cycles, 7)), np.zeros((cycles + 1, 7))
        target = _core.Target()
        late = round(settings.delay / settings.period) if settings.mismatch else 0
        sent = deque([np.zeros(7)] * late)
        done = cycles
        for k in range(cycles):
            q, dq = plant.read()
            if not (np.abs(q).max() < LOST and np.abs(dq).max() < LOST):
                self.report.blown_up += 1
                done = k
                break
            if k % per_action == 0:
                is_new = kind != 1 or k % round(HELD / settings.period) == 0
                self.choose(target, kind, q, pose.quat_wxyz, is_new)
            measured = dq
            if settings.mismatch:
                measured = dq + rng.normal(0.0, SPEED_NOISE, 7)
                plant.set_external_force(self.force(k))
            result = self.controller.step(q, measured, target)
            motor[k] = result.tau + self.chain.gravity(q)
            overlay[k + 1] = result.tau
            self.count_flags(result.flags)
            sent.append(result.tau)
            tau = sent.popleft()
            for _ in range(looks):
                plant.apply(tau, settings.period / looks)
                states.append(plant.read())
        self.inspect(states, motor[:done], overlay[: done + 1])

    def start(self) -> Array:
        """Return a posture inside joint limits and, where they are on, walls [rad]."""
        tool = self.limits
        if self.settings.home:
            return np.array([0.0, 0.6, 0.0, -1.55, 0.0, 0.99, 0.0])
        margin = 0.05  # rad
        while True:
            q = self.rng.uniform(self.limits.q_min + margin, self.limits.q_max - margin)
            p = self.chain.pose(q)[0]
            room = np.minimum(p - tool.x_min, tool.x_max - p).min()
            if not tool.walls or room > START_ROOM:
                return q

    def plant(self) -> _core.RigidPlant:
        """Return the arm: exactly the controller's model, or wrong in everything."""
        motors = self.robot.motors
        if not self.settings.mismatch:
            return _core.RigidPlant(
                self.chain, damping=motors.damping, armature=motors.armature
            )
        scale = self.rng.uniform(1 - MASS_SPREAD, 1 + MASS_SPREAD, 7)
        links = self.robot.links
        links = replace(
            links,
            mass=links.mass * scale,
            inertia=links.inertia * scale[:, None, None],
        )
        actual = replace(self.robot, links=links)
        return _core.RigidPlant(
            actual.chain(),
            damping=motors.damping,
            armature=motors.armature,
            coulomb=np.full(7, COULOMB),
            nominal=self.chain,
        )

    def choose(
        self, target: _core.Target, kind: int, q: Array, quat: Array, is_new: bool
    ) -> None:
        """Set the next action; kind 2 drives a joint to its nearer limit."""
        if is_new:
            signs = self.rng.choice([-1.0, 1.0], 3)
            if kind == 2:
                joint = self.rng.integers(7)
                limits = self.limits
                middle = 0.5 * (limits.q_min + limits.q_max)
                signs = np.sign(self.chain.jacobian(q)[:3, joint])
                signs = signs * (1.0 if q[joint] > middle[joint] else -1.0)
            target.f_star = np.append(self.settings.f_star * signs, np.zeros(3))
        turn = quat_about_z(self.rng.uniform(-np.pi, np.pi))
        target.quat_wxyz_d = quat_multiply(turn, quat)

    def force(self, k: int) -> Array:
        """Return the push on the TCP in cycle k [N]: steps, or linear rises."""
        settings, rng = self.settings, self.rng
        since = k % round(PUSH_TIME / settings.period)  # cycles
        if settings.pushes and since == 0:
            direction = rng.normal(size=3)
            on = float(rng.random() < 0.5)
            self.last_push = self.next_push
            self.next_push = on * PUSH * direction / np.linalg.norm(direction)
        share = 1.0
        if since * settings.period < settings.push_rise:
            share = since * settings.period / settings.push_rise
        return self.last_push + share * (self.next_push - self.last_push)

    def count_flags(self, flags: _core.Flags) -> None:
        """Count the cycles in which something had to give."""
        counts = self.report.flags
        counts["unsafe"] += flags.unsafe
        counts["qp_early"] += flags.qp_early
        counts["displaced"] += flags.wall_displaced != 0

    def inspect(
        self, states: list[tuple[Array, Array]], motor: Array, overlay: Array
    ) -> None:
        """Compare an episode with the limits, margins not taken off."""
        report = self.report
        report.cycles += len(motor)
        q = np.array([s[0] for s in states])
        dq = np.array([s[1] for s in states])
        keep = (np.abs(q) < LOST).all(axis=1) & (np.abs(dq) < LOST).all(axis=1)
        q, dq = q[keep], dq[keep]
        report.looks += len(q)
        own = self.robot.limits
        low, high = own.q_min + own.room_at(0.0), own.q_max - own.room_at(0.0)
        report.position.add(np.maximum(q - high, low - q))
        report.speed.add(np.abs(dq) - self.limits.dq_max)
        report.torque.add(np.abs(motor) - self.limits.tau_max)
        if np.isfinite(own.taper_brake).any():
            for room, speed in ((own.q_max - q, dq), (q - own.q_min, -dq)):
                falls = np.sqrt(2.0 * own.taper_brake * np.maximum(room, 0.0))
                most = np.maximum(falls - own.taper_offset, 0.0)
                report.tapered_speed.add(speed - most)
        if np.isfinite(own.dtau_max).any():
            rate = np.abs(np.diff(overlay, axis=0)) / self.settings.period
            report.torque_rate.add(rate - own.dtau_max - RATE_ROUNDING)
        if not self.limits.walls:
            return
        p = np.array([self.chain.pose(row)[0] for row in q])
        J = [self.chain.jacobian(row)[:3] for row in q]
        dx = np.array([j @ v for j, v in zip(J, dq, strict=True)])
        report.wall.add(np.maximum(p - self.limits.x_max, self.limits.x_min - p))
        report.tcp_speed.add(np.abs(dx) - self.limits.dx_max)


def print_report(settings: Settings, report: Report, seconds: float) -> None:
    """Print the settings and one row per limit."""
    print(settings)
    print(f"{report.cycles} cycles, {report.looks} looks, {seconds:.0f} s of computing")
    print(f"{'limit':16s} {'over':>9s} {'share':>9s}  worst")
    rows = (
        ("joint position", report.position, 1.0, "rad"),
        ("joint speed", report.speed, 1.0, "rad/s"),
        ("motor torque", report.torque, 1.0, "Nm"),
        ("tapered speed", report.tapered_speed, 1.0, "rad/s"),
        ("torque rate", report.torque_rate, 1.0, "Nm/s"),
        ("wall", report.wall, 1e3, "mm"),
        ("TCP speed", report.tcp_speed, 1e3, "mm/s"),
    )
    for name, excess, factor, unit in rows:
        share = excess.count / report.looks
        worst = f"{factor * excess.worst:.3g} {unit}"
        at = f", axes {sorted(excess.axes)}" if excess.axes else ""
        print(f"{name:16s} {excess.count:9d} {share:9.2%}  {worst}{at}")
    flags = ", ".join(f"{name} {count}" for name, count in report.flags.items())
    print(f"cycles flagged: {flags}; episodes blown up: {report.blown_up}")
    print(f"episodes with violations: {len(report.episodes)} {report.episodes[:10]}")


def main() -> None:
    """Run the command line."""
    if "--contact" in sys.argv[1:]:
        from attacks import contact_adversary

        contact_adversary.main([a for a in sys.argv[1:] if a != "--contact"])
        return
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--robot", help="one by name, without a tool; or the cell's")
    parser.add_argument("--cycles", type=int, default=1_000_000)
    parser.add_argument("--period", type=float, default=1e-3, help="[s]")
    parser.add_argument("--scheme", choices=SCHEMES, default="qp")
    parser.add_argument("--bounds", choices=BOUNDS, default="viability")
    parser.add_argument("--f-star", type=float, help="[m/s2]; 30, mismatch 10")
    parser.add_argument("--no-walls", action="store_true")
    parser.add_argument("--mismatch", action="store_true")
    parser.add_argument("--delay", type=float, help="of the mismatch [s]; a period")
    parser.add_argument("--no-pushes", action="store_true")
    parser.add_argument(
        "--estimate-rate", type=float, help="rate of the disturbance estimate [1/s]"
    )
    parser.add_argument("--delta-x", type=float, help="wall margin [m]")
    parser.add_argument("--delta-v", type=float, help="speed margin, as a share")
    parser.add_argument("--push-rise", type=float, default=0.0, help="[s], 0 a step")
    parser.add_argument("--exact-sjs", action="store_true")
    parser.add_argument("--home", action="store_true", help="start tool down")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--contact", action="store_true", help="attack in contact; has its own --help"
    )
    args = parser.parse_args()
    settings = Settings(
        robot=args.robot,
        period=args.period,
        scheme=args.scheme,
        bounds=args.bounds,
        f_star=args.f_star or (10.0 if args.mismatch else 30.0),
        walls=not args.no_walls,
        mismatch=args.mismatch,
        pushes=not args.no_pushes,
        delay=args.period if args.delay is None else args.delay,
        estimate_rate=args.estimate_rate,
        delta_x=args.delta_x,
        delta_v=args.delta_v,
        push_rise=args.push_rise,
        exact_sjs=args.exact_sjs,
        home=args.home,
    )
    begin = time.perf_counter()
    report = Adversary(settings, args.seed).run(args.cycles)
    print_report(settings, report, time.perf_counter() - begin)


if __name__ == "__main__":
    main()
