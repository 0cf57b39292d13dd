"""The Franka of the rehearsals: its arm and walls, and where it stays."""

import os

import numpy as np
from beside_franka_sim import HOST

from dovetail.arms.address import parse_address
from dovetail.arms.franka.arm import FrankaAddress, FrankaArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.poses import Pose
from dovetail.robots.fr3 import fr3

WALLS = (0.30, -0.40, 0.10), (0.70, 0.40, 0.75)  # m
AWAY = Pose(np.array([0.6, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))


def make_arm(
    kind: str, *, realtime: bool, host: str = HOST, processor: int | None = None
) -> FrankaArm:
    """Return the arm, its axes commanded as a behaviour needs it.

    Args:
        kind: The behaviour.
        realtime: Insist on real-time priority.
        host: Of franka-sim.
        processor: Where the arm's loop stays; None is any.
    """
    robot = fr3()
    is_posed = kind in ("jumps", "reaches")
    task = "XYZ:pose ABC:pose" if is_posed else "XYZ:force A:pose BC:hold"
    low, high = WALLS
    settings = ControllerSettings(
        osc=OscConfig.for_period(1e-3),
        limits=LimitConfig.for_period(robot, 1e-3, x_min=low, x_max=high),
        task=TaskSpec.parse(task),
        period=1e-3,
    )
    keys = f"approach=yes&recover=yes&realtime={'yes' if realtime else 'no'}"
    address = parse_address(f"franka://{host}?{keys}")
    assert isinstance(address, FrankaAddress)
    before = os.sched_getaffinity(0)
    if processor is not None:
        os.sched_setaffinity(0, {processor})  # the loop's process inherits it
    try:
        return FrankaArm(address, robot, settings)
    finally:
        os.sched_setaffinity(0, before)


def on(processor: int | None) -> str:
    """Return the command that lets another one stay on a processor."""
    return "" if processor is None else f"taskset -c {processor}"
