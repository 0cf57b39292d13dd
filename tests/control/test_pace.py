"""The way to a pose that jumps goes no faster than the joints can follow."""

import numpy as np
import pytest

from dovetail import _core, poses
from dovetail.control.config import LimitConfig, OscConfig

STEP = np.repeat([0.05, 0.3], 3)  # m, rad


@pytest.mark.parametrize("hardware", [False, True])
@pytest.mark.parametrize("period", [1e-3, 2e-3, 2.5e-3, 5e-3])
@pytest.mark.parametrize("axis", range(6))
def test_a_jump_takes_no_joint_to_its_speed_limit(
    robot, rest_at, q_home, period, axis, hardware
):
    limits = LimitConfig.for_period(
        robot, period, hardware=hardware, x_min=-2.0, x_max=2.0
    )
    osc = OscConfig.for_period(period)
    controller, plant, start = rest_at(q_home, osc, limits, "XYZABC:pose", period)
    move = STEP * np.eye(6)[axis]
    quat = poses.quat_multiply(poses.quat_from_vector(move[3:]), start.quat_wxyz)
    target = _core.Target(position_d=start.position + move[:3], quat_wxyz_d=quat)
    most = 0.9 * (1.0 - limits.delta_v) * limits.dq_max
    for _ in range(round(1.5 / period)):
        q, dq = plant.read()
        result = controller.step(q, dq, target)
        assert not result.flags.joint_velocity
        assert (np.abs(dq) < most).all()
        plant.apply(result.tau, period)
    now = robot.tool_pose(plant.read()[0])
    assert now.position == pytest.approx(target.position_d, abs=1e-4)  # there
    turn = poses.rotation_error(quat, now.quat_wxyz)
    assert turn == pytest.approx(np.zeros(3), abs=1e-3)


def test_a_path_of_its_own_speed_is_not_slowed(robot, rest_at, q_home):
    """What the joints cannot give is then the limits' business."""
    period = 1e-3
    limits = LimitConfig.for_period(robot, period, x_min=-2.0, x_max=2.0)
    osc = OscConfig.for_period(period)
    controller, plant, start = rest_at(q_home, osc, limits, "XYZABC:pose", period)
    speed = np.array([0.0, 0.2, 0.0])  # m/s
    for cycle in range(500):
        target = _core.Target(
            position_d=start.position + cycle * period * speed,
            quat_wxyz_d=start.quat_wxyz,
        )
        target.velocity_d = np.append(speed, np.zeros(3))
        q, dq = plant.read()
        plant.apply(controller.step(q, dq, target).tau, period)
    late = target.position_d - robot.tool_pose(plant.read()[0]).position
    assert np.abs(late).max() < 5e-3  # m
