"""How well does an arm know the wrench on its tool, from its own torques alone?

On the nominal arm and each shipped twin, at two control periods: what is told in free
air with nothing there; 20 N pushes on the held tool along each axis, both ways; and the
tool pressed on the block by f*. Truth is the simulation's. What was told before a push
is taken off, as a scale is tared.

    python benchmarks/wrench_accuracy.py
"""

import argparse
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.address import parse_address
from dovetail.arms.local_address import LocalAddress
from dovetail.arms.local_arm import LocalArm
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.plant import COLUMN
from dovetail.plants.twin import list_twins
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.types import Array, Vec3

PERIODS = (0.001, 0.005)
PUSH = 20.0
"""Force of a push [N]."""
NEAR = 0.1
"""A push is known when the estimate is this near, over its force [1]."""
PRESSES = (4.0, 8.0)
"""f* onto the block [m/s2]."""
Q = (50, 100)
"""Percentiles of the times."""
FIXTURE = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
FREE = np.array([0.6, 0.0, 0.25])
BESIDE_HOLE = np.array([0.635, 0.0, 0.105])
"""Just above the block [m]."""
_WRENCH = slice(COLUMN["wrench_fx"], COLUMN["wrench_mz"] + 1)
_TRUE = slice(COLUMN["fx"], COLUMN["fz"] + 1)


class Told(NamedTuple):
    """What was found at one place and period."""

    rest: Vec3
    """Force that is told in free air [N]."""
    noise: float
    """Its largest standard deviation [N]."""
    errors: Array
    """Of the force once a push has settled [N], shape (pushes, 3)."""
    rises: list[float]
    """Until a push was known [s]; NaN where it never was."""
    presses: list[tuple[float, float]]
    """True and told normal force on the block [N]."""


def measure(name: str, period: float) -> Told:
    """Push and press one arm."""
    cell = find_cell()
    address = parse_address(name)
    assert isinstance(address, LocalAddress)
    plant = address.make_plant(cell)
    robot = cell.loaded_robot()
    settings = make_settings(cell, EnvConfig(period=period))
    task = TaskSpec.parse("XYZ:force A:pose BC:hold")
    arm = LocalArm(plant, robot, *settings, task, period)

    def start(position: Vec3) -> _core.Target:
        pose = Pose(position, tool_down(0.0))
        arm.reset(robot.inverse_kinematics(pose, robot.posture("rest")), FIXTURE)
        target = _core.Target(quat_wxyz_d=pose.quat_wxyz)
        target.stay = 0b111  # held where it is
        return target

    tail = round(0.1 / period)
    rests, noises, errors, rises, presses = [], [], [], [], []
    for axis in range(3):
        for push in (PUSH, -PUSH):
            target = start(FREE)
            quiet = arm.step(target, 0.5).log[-tail:, _WRENCH]
            rest = quiet.mean(axis=0)[:3]
            rests.append(rest)
            noises.append(quiet[:, :3].std(axis=0).max())
            force = push * np.eye(3)[axis]
            arm.push(force, 0.5)
            told = arm.step(target, 0.4).log[:, _WRENCH][:, :3] - rest
            errors.append(told[-tail:].mean(axis=0) - force)
            known = np.flatnonzero(np.abs(told[:, axis] - push) < NEAR * PUSH)
            rises.append(period * known[0] if len(known) else np.nan)
    for press in PRESSES:
        target = start(BESIDE_HOLE)
        rest = arm.step(target, 0.5).log[-tail:, _WRENCH].mean(axis=0)
        target.stay = 0
        target.f_star = np.array([0.0, 0.0, -press, 0.0, 0.0, 0.0])
        log = arm.step(target, 1.0).log[-tail:]
        told = log[:, _WRENCH].mean(axis=0) - rest
        presses.append((float(log[:, _TRUE][:, 2].mean()), float(told[2])))
    arm.close()
    mean = np.mean(rests, axis=0)
    return Told(mean, float(max(noises)), np.array(errors), rises, presses)


def lines(arms: list[str], periods: list[float]) -> Iterator[str]:
    """Yield the table."""
    yield (
        "| arm, period | told in free air x y z; noise [N] | push of 20 N: error RMS; "
        "worst [N] | told after, p50; max [ms] | pressed, told [N] |"
    )
    yield "|---|---|---|---|---|"
    for name in arms:
        for period in periods:
            told = measure(name, period)
            rest = " ".join(f"{force:.1f}" for force in told.rest)
            rms = np.sqrt((told.errors**2).mean())
            worst = np.abs(told.errors).max()
            rises = "; ".join(f"{1e3 * t:.0f}" for t in np.percentile(told.rises, Q))
            presses = "; ".join(
                f"{true:.1f}, {said:.1f}" for true, said in told.presses
            )
            yield (
                f"| {name} {1e3 * period:g} ms | {rest}; {told.noise:.1f} | {rms:.2f}; "
                f"{worst:.1f} | {rises} | {presses} |"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    usual = ["mujoco", *(f"twin:{twin}" for twin in list_twins())]
    parser.add_argument("--arms", nargs="+", default=usual)
    parser.add_argument("--periods", nargs="+", type=float, default=list(PERIODS))
    asked = parser.parse_args()
    for line in lines(asked.arms, asked.periods):
        print(line, flush=True)
