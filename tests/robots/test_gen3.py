"""The Kinova Gen3: its geometry and weight are the maker's, and its limits hold."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.control.config import LimitConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import TorqueError
from dovetail.poses import matrix_from_quat
from dovetail.robots.gen3 import gen3
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.workcell.tool import ROBOTIQ_2F85

ROBOT = gen3()
BASE = 1.697  # kg, ros2_kortex
# The user guide's classical DH parameters: alpha [rad], d [m] and what is added to the
# joint's angle [rad]; every a is 0. The first row leads from the base to joint 1.
DH = (
    (np.pi, 0.0, None),
    (np.pi / 2, -(0.1564 + 0.1284), 0.0),
    (np.pi / 2, -(0.0054 + 0.0064), np.pi),
    (np.pi / 2, -(0.2104 + 0.2104), np.pi),
    (np.pi / 2, -(0.0064 + 0.0064), np.pi),
    (np.pi / 2, -(0.2084 + 0.1059), np.pi),
    (np.pi / 2, 0.0, np.pi),
    (np.pi, -(0.1059 + 0.0615), np.pi),
)


def by_the_user_guide(q):
    """Return the flange's pose by the user guide, as a matrix."""
    T = np.eye(4)
    for (alpha, d, offset), angle in zip(DH, (0.0, *q), strict=True):
        theta = angle + (offset or 0.0)
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        T = T @ np.array(
            [
                [c, -ca * s, sa * s, 0.0],
                [s, ca * c, -sa * c, 0.0],
                [0.0, sa, ca, d],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
    return T


def test_the_flange_is_where_the_user_guide_has_it(rng):
    for q in rng.uniform(ROBOT.limits.q_min, ROBOT.limits.q_max, (100, 7)):
        pose, T = ROBOT.tool_pose(q), by_the_user_guide(q)
        np.testing.assert_allclose(pose.position, T[:3, 3], atol=5e-4)  # m
        np.testing.assert_allclose(
            matrix_from_quat(pose.quat_wxyz), T[:3, :3], atol=1e-5
        )


def test_it_weighs_what_the_data_sheet_says():
    assert ROBOT.links.mass.sum() + BASE == pytest.approx(8.2, abs=0.05)


def test_it_carries_a_2f85():
    cell = find_cell(robot="gen3")
    assert cell.tool.name == ROBOTIQ_2F85.name
    assert cell.tool.mass == pytest.approx(0.9)


@pytest.mark.parametrize(("large", "small"), [(39.0, 9.0), (32.0, 13.0)])
def test_with_the_torques_of_other_sources_it_could_not_brake_its_gripper(large, small):
    tau_max = np.array([large] * 4 + [small] * 3)
    weak = replace(ROBOT, limits=replace(ROBOT.limits, tau_max=tau_max))
    robot = PegInHole().workcell(weak).loaded_robot()
    with pytest.raises(TorqueError) as refused:
        LimitConfig.for_period(robot, 1e-3)
    assert refused.value.joint == "A2"
