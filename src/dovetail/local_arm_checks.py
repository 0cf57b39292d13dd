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
from dovetail.arms.address import PlantAddress, TwinAddress
from dovetail.arms.local_arm import LocalArm
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor import Check
from dovetail.envs.arm_setup import build_local_arm
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.feel.gains import quiet, simulated_step
from dovetail.feel.resting import measure_rest
from dovetail.feel_checks import check_rest
from dovetail.poses import Pose, quat_about_z, tool_down

FIXTURE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
START = Pose(np.array([0.60, 0.0, 0.20]), tool_down(0.0))


def run_local_checks(
    address: PlantAddress | TwinAddress, period: float, declared: dict[str, float]
) -> Iterator[Check]:
    """Yield every check of a simulated arm, over the table, as soon as it is done.

    Args:
        address: The plant or twin.
        period: Control period [s].
        declared: What is said of the arm.

    Raises:
        DovetailError: The arm cannot be built, or its simulation diverged.
    """
    yield check_period_proven(period)
    arm = _build(address, period)
    q = arm.robot.inverse_kinematics(START, arm.robot.posture("rest"))
    limits = arm.limits
    felt = LocalArm(
        arm.plant,
        arm.robot,
        *quiet(arm.osc, limits),
        arm.task,
        period,
    )
    try:
        felt.reset(q, FIXTURE)
        hold = _core.Target(joint_mode=True, q_d=q)
        yield check_rest(measure_rest(watch(felt, hold), period))
        yield from feel_checks(
            felt,
            q,
            limits,
            declared,
            sends_position=False,
            integration_step=simulated_step(period),
        )
        arm.reset(q, FIXTURE)
        yield check_as_configured(arm)
    finally:
        arm.close()


def _build(address: PlantAddress | TwinAddress, period: float) -> LocalArm:
    is_twin = isinstance(address, TwinAddress)
    return build_local_arm(
        find_cell(),
        TaskSpec.parse("XYZABC:hold"),
        EnvConfig.of(
            plant="mujoco" if is_twin else address.engine,
            twin=address.twin if is_twin else None,
            period=period,
            force_damping=0.0,
        ),
    )
