"""A twin at a standstill is quiet, with speeds made of positions, as behind FRI.

With the noise of the disturbance estimate fed back, A2 of `hard` had 2.0 to 2.1 Nm RMS,
and `doctor` called the loop broken.
"""

from typing import cast

import numpy as np
import pytest
from encoder_plant import EncoderPlant

from dovetail.arms.local_arm import LocalArm
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor.standstill import check_as_configured
from dovetail.envs.arm_setup import build_local_arm
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.plant import Plant
from dovetail.poses import Pose

TASK = TaskSpec.parse("XYZABC:hold")
PLACE = Pose(np.array([0.58, 0.02, 0.13]), np.array([0.0, 1.0, 0.0, 0.0]))  # free air
FAR = Pose(np.array([0.5, 0.35, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])


@pytest.mark.parametrize("period", [0.001, 0.0025, 0.005])
def test_doctor_finds_the_hard_twin_quiet(period):
    cell = find_cell()
    arm = build_local_arm(cell, TASK, EnvConfig(twin="hard", period=period))
    body, facts = cast("Plant", EncoderPlant(arm.plant, period)), arm.facts
    arm = LocalArm(body, facts.robot, facts.osc, facts.limits, TASK, period)
    arm.reset(cell.loaded_robot().inverse_kinematics(PLACE, Q_SEED), FAR)
    check = check_as_configured(arm)
    assert check.status == "ok", check.detail
