"""Feel a simulated arm of this process, as the doctor feels one behind a cabinet."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from dovetail import _core
from dovetail.arm_feel import (
    check_as_configured,
    check_period_proven,
    feel_checks,
    watch,
)
from dovetail.arms.local_arm import LocalArm
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor import Check
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.feel.gains import quiet, simulated_step
from dovetail.feel.resting import measure_rest
from dovetail.feel_checks import check_rest
from dovetail.plants.plant import Plant
from dovetail.poses import Pose, quat_about_z, tool_down

FIXTURE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
START = Pose(np.array([0.60, 0.0, 0.20]), tool_down(0.0))


def run_local_checks(
    plant: Plant, period: float, declared: dict[str, Any]
) -> Iterator[Check]:
    """Yield every check of a simulated arm, over the table, as soon as it is done.

    Args:
        plant: The simulation; closed in the end.
        period: Control period [s].
        declared: What is said of the arm.

    Raises:
        PlantError: The simulation diverged.
    """
    yield check_period_proven(period)
    cell, task = plant.cell, TaskSpec.parse("XYZABC:hold")
    config = EnvConfig(period=period, force_damping=0.0, **declared)
    osc, limits = make_settings(cell, config)
    robot = cell.loaded_robot()
    q = robot.inverse_kinematics(START, robot.posture("rest"))
    arm = LocalArm(plant, robot, osc, limits, task, period)
    felt = LocalArm(plant, robot, *quiet(osc, limits), task, period)
    try:
        felt.reset(q, FIXTURE)
        hold = _core.Target(joint_mode=True, q_d=q)
        yield check_rest(measure_rest(watch(felt, hold), period))
        yield from feel_checks(
            felt,
            q,
            limits,
            declared,
            spring=None,
            integration_step=simulated_step(period),
        )
        arm.reset(q, FIXTURE)
        yield check_as_configured(arm)
    finally:
        arm.close()
