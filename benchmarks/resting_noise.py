"""Torque noise of an arm that rests: standard deviation per joint, drift taken off.

    python benchmarks/resting_noise.py [--period 0.001 0.002 0.005] [--standstill]

Zero actions in free air, on the plain plant and on every twin: with the measured
velocity, and with the one observed from positions, as an arm behind FRI has it
(`observed`; `--fri` runs the whole servo loop in lockstep against a simulated cabinet,
for the same numbers). `--standstill` holds the joints, as a stop does. From each torque
its mean over a quarter of a second is taken off.
"""

import argparse
import itertools
import multiprocessing
import socket
from typing import cast

import numpy as np
from encoder_plant import EncoderPlant
from fri_loop import HOLE, LOOPBACK, Q_SEED, TOOL_DOWN, run_cabinet
from numpy.typing import NDArray

from dovetail import _core
from dovetail.arms.arm import Arm
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.arms.local_arm import LocalArm
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import build_local_arm, make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.plant import COLUMN, Plant
from dovetail.poses import Pose
from dovetail.workcell.workcell import Workcell

TASK = TaskSpec.parse("XYZ:force A:pose BC:hold")
PLANTS = ("mujoco", "easy", "medium", "hard")
PLACE = np.array([0.58, 0.02, 0.13])  # m, in free air; twins drift by up to 0.15 m
FORCE_DAMPING, NEAR_SPEED = 40.0, 0.02  # 1/s, m/s: of peg in hole
SETTLE, SECONDS, WINDOW = 0.5, 1.5, 0.25  # s
ACTION = 0.05  # s
GOAL = 2.0  # Nm

Array = NDArray[np.float64]


def build(
    plant: str, path: str, period: float
) -> tuple[Arm, multiprocessing.Process | None]:
    """Return the arm, and the process of its cabinet where it has one."""
    cell = find_cell()
    if path == "fri":
        return build_behind_fri(plant, cell, period)
    twin = None if plant == "mujoco" else plant
    arm = build_local_arm(cell, TASK, EnvConfig(twin=twin, period=period))
    if path == "measured":
        return arm, None
    body = cast("Plant", EncoderPlant(arm.plant, period))
    facts = arm.facts
    return LocalArm(body, facts.robot, facts.osc, facts.limits, TASK, period), None


def build_behind_fri(
    plant: str, cell: Workcell, period: float
) -> tuple[Arm, multiprocessing.Process]:
    """Return an arm in lockstep with a simulated cabinet in another process."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        port = probe.getsockname()[1]
    options = argparse.Namespace(
        plant=plant, clock="lockstep", period=period, realtime=False
    )
    here, there = multiprocessing.Pipe()
    process = multiprocessing.Process(
        target=run_cabinet, args=(options, there), daemon=True
    )
    process.start()
    here.send(port)
    osc, limits = make_settings(cell, EnvConfig(period=period))
    settings = ControllerSettings(osc=osc, limits=limits, task=TASK, period=period)
    address = FriAddress(
        host=LOOPBACK, port=port, clock="lockstep", control=here.recv()
    )
    arm = FriArm(address, cell.loaded_robot(), settings, log_folder=None)
    return arm, process


def resting_torques(arm: Arm, period: float, *, standstill: bool) -> Array:
    """Return the torques of an arm that is asked for nothing [Nm], shape (n, 7)."""
    robot = find_cell().loaded_robot()
    start = robot.inverse_kinematics(Pose(PLACE, TOOL_DOWN), Q_SEED)
    arm.reset(start, HOLE)
    columns = slice(COLUMN["tau1"], COLUMN["tau7"] + 1)
    target = _core.Target(joint_mode=standstill, q_d=start, quat_wxyz_d=TOOL_DOWN)
    logs = [
        arm.step(target, ACTION).log[:, columns]
        for _ in range(round((SETTLE + SECONDS) / ACTION))
    ]
    return np.vstack(logs)[round(SETTLE / period) :]


def noise(tau: Array, period: float) -> Array:
    """Return the standard deviation of each torque about its moving mean [Nm]."""
    width = round(WINDOW / period)
    sums = np.cumsum(np.vstack([np.zeros(7), tau]), axis=0)
    mean = (sums[width:] - sums[:-width]) / width
    first = width // 2
    return np.sqrt(np.mean((tau[first : first + len(mean)] - mean) ** 2, axis=0))


def main() -> None:
    """Print a row per plant, period and source of the velocity."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--period", type=float, nargs="+", default=[1e-3, 2e-3, 5e-3])
    parser.add_argument("--plants", nargs="+", default=PLANTS)
    parser.add_argument("--fri", action="store_true", help="the whole servo loop, too")
    parser.add_argument("--standstill", action="store_true", help="by joint targets")
    args = parser.parse_args()
    paths = ("measured", "observed", "fri") if args.fri else ("measured", "observed")
    print(f"{'':24s}" + "".join(f"{f'A{i}':>8s}" for i in range(1, 8)) + "  [Nm RMS]")
    worst = 0.0
    for period, plant, path in itertools.product(args.period, args.plants, paths):
        name = f"{1e3 * period:g} ms {plant} {path}"
        if path == "fri" and not (1e3 * period).is_integer():
            print(f"{name:24s} not on the wire, which has whole milliseconds")
            continue
        arm, process = build(plant, path, period)
        try:
            sigma = noise(
                resting_torques(arm, period, standstill=args.standstill), period
            )
        except Exception as error:  # the arm may be beyond measuring
            print(f"{name:24s} {type(error).__name__}: {str(error)[:100]}")
            continue
        finally:
            arm.close()
            if process is not None:
                process.terminate()
        worst = max(worst, float(sigma.max()))
        print(f"{name:24s}" + "".join(f"{s:8.2f}" for s in sigma))
    print(f"worst {worst:.2f} Nm RMS, to be reached: {GOAL:g}")


if __name__ == "__main__":
    main()
