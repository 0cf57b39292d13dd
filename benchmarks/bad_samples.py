"""Wrong joint positions in single messages: what one does to the torque.

    python benchmarks/bad_samples.py [--spikes 10000] [--period 0.001 0.005]

The arm of peg in hole rests, moves freely, and presses on the block beside the hole, on
the plain MuJoCo plant and on the twins. Its measured position is wrong by 1 to 100 mrad
in one joint, or in all of them, for one message or for a burst of up to five; its
measured velocity is not, or where it is made of positions (`observed`, as behind FRI)
as wrong as they make it. Printed is the largest change of a torque from one cycle to
the next from the first wrong sample to 20 cycles after the last, and beside it the
largest without wrong samples. Cycles in which the Target changes are left out of both.
"""

import argparse
import itertools
import time

import numpy as np
from numpy.typing import NDArray

from dovetail import _core
from dovetail.control.limits import ApproachLimits
from dovetail.control.observer import observer_gain
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import build_local_arm
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import PlantError
from dovetail.poses import Pose, quat_about_z

TASK = "XYZ:force A:pose BC:hold"
PLANTS = ("mujoco", "easy", "medium", "hard")
SCENES = ("rest", "motion", "contact")
PATHS = ("measured", "observed")
TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
IN_AIR, ON_BLOCK = np.array([0.58, 0.02, 0.20]), np.array([0.634, 0.0, 0.101])  # m
NEAR, NEAR_SPEED = 0.01, 0.02  # m, m/s
F_MOTION, F_PRESS = 4.0, 1.5  # m/s2
FORCE_DAMPING = 40.0  # 1/s
SMALLEST, LARGEST = 1e-3, 0.1  # rad
LONGEST = 5  # messages of a burst
ALL_JOINTS = 0.2  # share of spikes in all joints
ACTION = 0.05  # s
SETTLE, EPISODE = 0.5, 2.0  # s before the first spike, s
SPACING = (0.06, 30)  # s, cycles: at least, between two spikes
AFTER = 20  # cycles after the last wrong sample that still count

Array = NDArray[np.float64]


class Tally:
    """What the spikes of one case did."""

    spikes = broken = blown_up = 0
    step = step_clean = 0.0  # largest change of a torque in a cycle [Nm]
    push = 0.0  # largest contact force [N]
    worst = ""


class Case:
    """One arm in one situation."""

    def __init__(self, plant: str, scene: str, path: str, period: float) -> None:
        """Build the arm as peg in hole has it."""
        self.cell, self.period = scene, period
        self.arm = build_local_arm(
            find_cell(),
            TaskSpec.parse(TASK),
            EnvConfig(
                twin=None if plant == "mujoco" else plant,
                period=period,
                force_damping=FORCE_DAMPING,
                near_speed=NEAR_SPEED,
                near_press=ApproachLimits.near_press,
            ),
        )
        self.observer = None
        if path == "observed":
            self.observer = _core.VelocityObserver(period, observer_gain(period))
        self.name = f"{plant}, {scene}, {path}"
        robot = self.arm.facts.robot
        self.chain = robot.chain()
        place = ON_BLOCK if scene == "contact" else IN_AIR
        self.start = robot.inverse_kinematics(Pose(place, TOOL_DOWN), Q_SEED)
        self.tally = Tally()

    def target(self, action: int) -> _core.Target:
        """Return the Target of an action."""
        target = _core.Target(quat_wxyz_d=TOOL_DOWN)
        target.near_plane = np.array([0.0, 0.0, 1.0, HOLE.position[2] + NEAR])
        if self.cell == "motion":
            phase = 2.0 * np.pi * action * ACTION * np.array([0.7, 0.9, 1.1])
            target.f_star = np.append(F_MOTION * np.cos(phase), np.zeros(3))
        elif self.cell == "contact":
            target.f_star = np.array([0.0, 0.0, -F_PRESS, 0.0, 0.0, 0.0])
        return target

    def episode(self, rng: np.random.Generator, *, is_clean: bool) -> None:
        """Run one episode with spikes, or the same without them."""
        self.arm.seed(int(rng.integers(2**31)))
        self.arm.reset(self.start, HOLE)
        cycles = round(EPISODE / self.period)
        errors = np.zeros((cycles, 7)) if is_clean else self.errors(rng, cycles)
        try:
            self.run(errors, is_clean=is_clean)
        except PlantError:
            self.tally.blown_up += 1

    def errors(self, rng: np.random.Generator, cycles: int) -> Array:
        """Return the error of each position in each cycle [rad]."""
        errors = np.zeros((cycles, 7))
        k = round(SETTLE / self.period)
        space = max(round(SPACING[0] / self.period), SPACING[1])
        while k + space < cycles:
            size = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST)))
            count = 1 if rng.random() < 0.5 else rng.integers(2, LONGEST + 1)
            joints = np.zeros(7)
            joints[rng.integers(7)] = rng.choice([-1.0, 1.0])
            if rng.random() < ALL_JOINTS:
                joints = rng.choice([-1.0, 1.0], 7)
            signs = rng.choice([-1.0, 1.0], count) if rng.random() < 0.3 else 1.0
            errors[k : k + count] = size * np.outer(np.ones(count) * signs, joints)
            self.tally.spikes += 1
            k += space + int(rng.integers(space))
        return errors

    def run(self, errors: Array, *, is_clean: bool) -> None:
        """Run the cycles of an episode, and keep the largest steps."""
        arm, tally = self.arm, self.tally
        per_action = round(ACTION / self.period)
        settled = round(SETTLE / self.period)
        if self.observer is not None:
            self.observer.reset(arm.plant.read()[0])
        target = self.target(0)
        tau, a, left = np.zeros(7), np.zeros(7), 0
        for k, error in enumerate(errors):
            if k % per_action == 0:
                target = self.target(k // per_action)
            q, dq = arm.plant.read()
            seen = q + error
            if self.observer is not None:
                dq = self.observer.update(seen, a) if k else self.observer.dq
            result = arm.controller.step(seen, dq, target)
            if self.observer is not None and result.flags.implausible:
                self.observer.doubt()
            step = float(np.abs(result.tau - tau).max())
            tau, a = result.tau, result.a
            is_bad = bool(error.any())
            left = AFTER + 1 if is_bad else left - 1
            if k >= settled and k % per_action:
                if is_clean:
                    tally.step_clean = max(tally.step_clean, step)
                elif left > 0 and step > tally.step:
                    tally.step = step
                    tally.worst = self.describe(errors, k, left, result.flags)
            arm.plant.apply(tau, self.period)
            tally.push = max(
                tally.push, float(np.linalg.norm(arm.plant.contact_force_peak()))
            )
            tally.broken += self.is_broken()

    def describe(self, errors: Array, k: int, left: int, flags: _core.Flags) -> str:
        """Say which spike it was, how long ago, and what the controller thought."""
        last = k - (AFTER + 1 - left)
        bad = errors[max(0, last - LONGEST) : last + 1].any(axis=1)
        count = int(bad.sum())
        size = 1e3 * float(np.abs(errors[last]).max())
        names = [n for n in ("implausible", "bad_input", "ended") if getattr(flags, n)]
        return f"{size:.1f} mrad x {count}, {k - last} later {' '.join(names)}"

    def is_broken(self) -> bool:
        """Return whether the arm is outside a limit, margins not taken off."""
        tool = self.arm.facts.limits
        q, dq = self.arm.plant.read()
        p = self.chain.pose(q)[0]
        return bool(
            (q > self.arm.facts.limits.q_max).any()
            or (q < self.arm.facts.limits.q_min).any()
            or (np.abs(dq) > self.arm.facts.limits.dq_max).any()
            or (p > tool.x_max).any()
            or (p < tool.x_min).any()
        )


def main() -> None:
    """Print a row per plant, situation and source of the velocity."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--spikes", type=int, default=10_000, help="per period")
    parser.add_argument("--period", type=float, nargs="+", default=[1e-3, 5e-3])
    parser.add_argument("--plants", nargs="+", default=PLANTS)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    kinds = list(itertools.product(args.plants, SCENES, PATHS))
    for period in args.period:
        begin = time.perf_counter()
        print(
            f"{1e3 * period:g} ms: plant, situation, velocity    spikes  "
            "step [Nm]  without    broken  contact [N]  worst step"
        )
        total = 0
        for plant, scene, path in kinds:
            case = Case(plant, scene, path, period)
            rng = np.random.default_rng([args.seed, *map(ord, case.name)])
            case.episode(rng, is_clean=True)
            while case.tally.spikes < args.spikes / len(kinds):
                case.episode(rng, is_clean=False)
            tally = case.tally
            total += tally.spikes
            blown_up = f" (blown up {tally.blown_up})" if tally.blown_up else ""
            print(
                f"{case.name:38s} {tally.spikes:6d} {tally.step:10.1f} "
                f"{tally.step_clean:8.1f} {tally.broken:9d} {tally.push:12.0f}  "
                f"{tally.worst}{blown_up}"
            )
            case.arm.close()
        print(f"{total} spikes, {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
