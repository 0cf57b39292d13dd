"""Feel a simulated arm of this process, as the doctor feels one behind a cabinet."""

from collections.abc import Iterator

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
from dovetail.envs.arm_setup import (
    NEAR_SPEED,
    WALLS_MAX,
    WALLS_MIN,
    make_settings,
)
from dovetail.envs.randomisation import tool_down
from dovetail.feel.gains import quiet, simulated_step
from dovetail.feel.resting import measure_rest
from dovetail.feel_checks import check_rest
from dovetail.plants.plant import Plant
from dovetail.poses import Pose, quat_about_z

HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
START = Pose(np.array([0.60, 0.0, 0.20]), tool_down(0.0))
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])


def run_local_checks(
    plant: Plant, period: float, declared: dict[str, float]
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
    robot, task = plant.scene.robot(), TaskSpec.parse("XYZABC:hold")
    osc, limits = make_settings(
        plant.scene, period, 0.0, NEAR_SPEED, (WALLS_MIN, WALLS_MAX), "qp"
    )
    q = robot.inverse_kinematics(START, Q_SEED)
    arm = LocalArm(plant, robot, osc, limits, task, period)
    felt = LocalArm(plant, robot, *quiet(osc, limits), task, period)
    try:
        felt.reset(q, HOLE)
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
        arm.reset(q, HOLE)
        yield check_as_configured(arm)
    finally:
        arm.close()
