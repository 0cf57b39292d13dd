"""Checks of a simulated arm of this process, as of one behind a cabinet."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from dovetail import _core
from dovetail.arms.local_arm import LocalArm
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor.check import Check
from dovetail.doctor.diagnosis import check_dynamics, check_period_proven
from dovetail.doctor.excitation import excitation_gains, simulated_step
from dovetail.doctor.standstill import (
    check_as_configured,
    check_standstill,
    measure_standstill,
    watch,
)
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.plants.plant import Plant
from dovetail.poses import Pose, tool_down
from dovetail.workcell.workcell import Workcell

_ABOVE = 0.10
"""Height of the tool over the fixture [m]."""


def above_fixture(cell: Workcell) -> Pose:
    """Return the pose of the tool over the fixture at its usual place."""
    return Pose(cell.place.position + np.array([0.0, 0.0, _ABOVE]), tool_down(0.0))


def run_simulated_checks(
    plant: Plant, period: float, declared: dict[str, Any]
) -> Iterator[Check]:
    """Yield every check of a simulated arm, over the table, as soon as it is done.

    Args:
        plant: The simulation; closed in the end.
        period: Control period [s].
        declared: Largest declared errors of model and loop.

    Raises:
        PlantError: The simulation diverged.
    """
    yield check_period_proven(period)
    cell, task = plant.cell, TaskSpec.parse("XYZABC:hold")
    config = EnvConfig(period=period, force_damping=0.0, **declared)
    osc, limits = make_settings(cell, config)
    robot = cell.loaded_robot()
    q = robot.inverse_kinematics(above_fixture(cell), robot.posture("rest"))
    arm = LocalArm(plant, robot, osc, limits, task, period)
    held = LocalArm(plant, robot, *excitation_gains(osc, limits), task, period)
    try:
        held.reset(q, cell.place)
        hold = _core.Target(joint_mode=True, q_d=q)
        yield check_standstill(measure_standstill(watch(held, hold), period))
        step = simulated_step(period)
        yield from check_dynamics(held, q, declared, integration_step=step)
        arm.reset(q, cell.place)
        yield check_as_configured(arm)
    finally:
        arm.close()
