"""Measure the servo loop against a simulated cabinet in another process.

    python benchmarks/fri_loop.py --clock lockstep     speed over real time
    python benchmarks/fri_loop.py --clock wall         reply times and commands in time

Everything runs on this machine, over loopback UDP.
"""

import argparse
import multiprocessing
import time
from multiprocessing.connection import Connection

import numpy as np

from dovetail import _core
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.cabinet.cabinet import Cabinet
from dovetail.cabinet.config import CabinetConfig, Endpoint
from dovetail.cabinet.realtime import request_realtime
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z
from dovetail.robots.robot import Robot

TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
LOOPBACK = "127.0.0.1"


def run_cabinet(options: argparse.Namespace, pipe: Connection) -> None:
    """Be the cabinet until the other end of the pipe closes."""
    if options.realtime:
        print(f"cabinet: {request_realtime()}", flush=True)
    cell = find_cell()
    if options.plant in ("mujoco", "bullet"):
        plant = make_plant(options.plant, cell, DynamicsConfig())
    else:
        plant = make_twin(load_twin(options.plant), cell)
    plant.reset(Q_SEED, HOLE)
    config = CabinetConfig(
        clock=options.clock,
        period=options.period,
        client=Endpoint(LOOPBACK, pipe.recv()),
        bind=Endpoint(LOOPBACK, 0),
        control=Endpoint(LOOPBACK, 0),
    )
    with Cabinet(plant, config) as cabinet:
        pipe.send(str(cabinet.control_address))
        pipe.poll(None)
        pipe.send(cabinet.request({"do": "status"}))


def damped_settings(robot: Robot, period: float) -> ControllerSettings:
    """Return a controller whose force axes are damped a little."""
    return ControllerSettings(
        osc=OscConfig.for_period(period, force_damping=[16.0] * 3 + [0.0] * 3),
        limits=LimitConfig.for_period(robot, period),
        task=TaskSpec.parse("XYZ:force A:pose BC:hold"),
        period=period,
    )


def main() -> None:
    """Print speed, reply times and misses."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plant", default="medium")
    parser.add_argument("--clock", default="lockstep")
    parser.add_argument("--period", type=float, default=0.005)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--realtime", action="store_true")
    parser.add_argument("--port", type=int, default=30209)
    options = parser.parse_args()
    here, there = multiprocessing.Pipe()
    process = multiprocessing.Process(
        target=run_cabinet, args=(options, there), daemon=True
    )
    process.start()
    here.send(options.port)
    robot = find_cell().loaded_robot()
    address = FriAddress(
        host=LOOPBACK,
        port=options.port,
        clock=options.clock,
        control=here.recv(),
        realtime=options.realtime,
    )
    settings = damped_settings(robot, options.period)
    arm = FriArm(address, robot, settings, log_folder=None)
    start = robot.inverse_kinematics(Pose(np.array([0.6, 0.0, 0.2]), TOOL_DOWN), Q_SEED)
    arm.reset(start, HOLE)
    rng = np.random.default_rng(0)
    steps = round(options.seconds / 0.05)
    begin = time.perf_counter()
    for _ in range(steps):
        f_star = np.array([*rng.uniform(-1.0, 1.0, 3), 0.0, 0.0, 0.0])
        arm.step(_core.Target(f_star=f_star, quat_wxyz_d=TOOL_DOWN))
    wall = time.perf_counter() - begin
    statistics = arm.statistics()
    here.send("end")
    status = here.recv()
    arm.close()
    cycles = steps * 0.05 / options.period
    print(
        f"{options.plant}, {options.clock}, {1e3 * options.period:g} ms: "
        f"{steps * 0.05:.0f} s in {wall:.2f} s, {steps * 0.05 / wall:.1f} x real time, "
        f"{1e6 * wall / cycles:.0f} us per cycle; quality {status['quality']}, "
        f"while active due {status['counts']['active_due']}, missed "
        f"{status['counts']['active_missed']}, "
        f"motions {status['motion']}"
    )
    for name, times in statistics["times"].items():
        if times["count"]:
            figures = ", ".join(
                f"{key} {1e6 * times[key]:.0f}" for key in ("p50", "p99", "p999", "max")
            )
            print(f"  {name} [us]: {figures} ({times['count']})")
    for note in statistics["notes"]:
        print(f"  note: {note}")


if __name__ == "__main__":
    main()
