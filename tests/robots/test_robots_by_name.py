"""Every robot that has a name brakes with its gripper, and stands as it says."""

import warnings

import numpy as np
import pytest

from dovetail.control.config import LimitConfig
from dovetail.control.torque_limits import check_torque
from dovetail.envs.registered import find_cell
from dovetail.poses import matrix_from_quat
from dovetail.robots.find import find_robot, list_robots
from dovetail.workcell.posture import joint_origins

ROOM = 0.2  # rad from a position limit
DIRECTIONS = {"down": [0.0, 0.0, -1.0], "forward": [1.0, 0.0, 0.0]}


@pytest.fixture(params=list_robots())
def name(request):
    return request.param


@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_its_torques_hold_and_brake_it_without_a_warning(name, period):
    robot = find_cell(robot=name).loaded_robot()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_torque(robot, LimitConfig.for_period(robot, period))


@pytest.mark.parametrize("posture", DIRECTIONS)
def test_a_posture_points_the_tool_that_way_with_the_elbow_up(name, posture):
    cell = find_cell(robot=name)
    robot, q = cell.loaded_robot(), cell.robot.posture(posture)
    limits = robot.limits
    assert (q > limits.q_min + ROOM).all()
    assert (q < limits.q_max - ROOM).all()
    z = matrix_from_quat(robot.tool_pose(q).quat_wxyz)[:, 2]
    assert np.arccos(z @ DIRECTIONS[posture]) < np.deg2rad(10.0)
    shoulder, elbow, wrist = joint_origins(robot, q)[[1, 3, 5]]
    assert elbow[2] > (shoulder[2] + wrist[2]) / 2.0


def test_it_is_named_as_its_file(name):
    assert find_robot(name).name.partition("-")[0] == name
