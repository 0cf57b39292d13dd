"""An arm that says little of itself gets what its task needs, and nothing wider."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.control.config import LimitConfig
from dovetail.errors import TorqueError
from dovetail.poses import Pose
from dovetail.robots.fr3 import fr3
from dovetail.robots.gen3 import gen3
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot import ANY_GRIPPER
from dovetail.tasks.insert.task import HEXAGON, Insert
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.workcell.posture import find_posture, joint_origins, mount_turn
from extras import need


def bare(robot, **limits):
    """A robot as a file gives one: no postures, and no word of a gripper."""
    limits = replace(robot.limits, **limits)
    return replace(robot, postures={}, gripper=ANY_GRIPPER, limits=limits)


@pytest.fixture(scope="module")
def task():
    return PegInHole()


def goals(task):
    return [task.goal(place.pose()) for place in task.trial_poses]


def test_a_robot_of_ours_stays_as_it_is(task):
    robot = iiwa14()
    assert task.workcell(robot).robot is robot


@pytest.mark.parametrize("arm", [iiwa14, fr3, gen3])
def test_a_posture_is_found_from_which_the_task_is_reached(task, arm):
    robot = task.workcell(bare(arm())).robot
    loaded = task.workcell(robot).loaded_robot()
    q = robot.posture("down")
    limits = robot.limits
    assert (q > limits.q_min + 0.2).all()
    assert (q < limits.q_max - 0.2).all()
    shoulder, elbow, wrist = joint_origins(loaded, q)[[1, 3, 5]]
    assert elbow[2] > (shoulder[2] + wrist[2]) / 2.0
    for goal in goals(task):
        pose = Pose(goal.position, goal.quat_wxyz)
        near = loaded.inverse_kinematics(pose, q, seeds=1)
        assert np.abs(near - q).max() < 0.8


def test_what_is_found_is_found_once(task):
    robot = bare(iiwa14())
    assert task.workcell(robot).robot is PegInHole().workcell(robot).robot


def test_what_is_found_is_of_all_of_a_task():
    need("shapely")
    robot = bare(iiwa14())
    Insert(facing="up").workcell(robot)
    found = Insert(facing="robot").workcell(robot).robot
    assert "forward" in found.postures


def test_a_heavy_part_of_the_same_name_is_another():
    need("shapely")
    arm = bare(fr3())
    tools = [
        Insert(part=HEXAGON.replace("{", f'{{"density": {density}, ', 1))
        .workcell(arm)
        .robot.gripper
        for density in (500, 14_000)
    ]
    assert tools == ["wsg50", "franka_hand"]


def test_a_strong_arm_gets_the_usual_gripper_and_a_weak_one_a_light_one(task):
    strong = task.workcell(bare(iiwa14())).robot
    assert strong.gripper == "wsg50"
    assert any("gets a wsg50: its file says nothing" in note for note in strong.notes)
    np.testing.assert_array_equal(strong.limits.dq_max, iiwa14().limits.dq_max)
    weak = task.workcell(bare(fr3())).robot
    assert weak.gripper == "franka_hand"
    assert any("wsg50 joint A2 needs" in note for note in weak.notes)


def test_an_arm_that_cannot_brake_at_full_speed_is_slowed(task):
    fast = fr3().limits.dq_max * 2.0
    cell = task.workcell(bare(fr3(), dq_max=fast))
    share = cell.robot.limits.dq_max / fast
    assert share.max() < 1.0
    assert np.ptp(share) == pytest.approx(0.0)
    assert any("speed limits are used" in note for note in cell.robot.notes)
    LimitConfig.for_period(cell.loaded_robot(), 1e-3)


def test_nothing_is_widened_for_a_weak_arm(task):
    own = fr3().limits
    robot = task.workcell(bare(fr3(), tau_max=0.85 * own.tau_max)).robot
    assert (robot.limits.q_min >= own.q_min).all()
    assert (robot.limits.q_max <= own.q_max).all()
    assert (robot.limits.dq_max <= own.dq_max).all()
    assert any("stay within" in note for note in robot.notes)


def test_an_arm_that_is_too_weak_for_anything_is_refused_with_its_joint(task):
    with pytest.raises(TorqueError) as refused:
        task.workcell(bare(fr3(), tau_max=0.4 * fr3().limits.tau_max))
    assert refused.value.joint == "A2"
    assert refused.value.cause == "gravity"


def test_a_tool_is_turned_by_what_the_last_joint_turns_back():
    robot, q = iiwa14(), np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 2.9])
    turn = mount_turn(robot, q)
    assert turn == pytest.approx(np.pi)
    assert abs(q[6] - turn) < np.pi / 8


def test_no_posture_is_made_up_for_what_is_out_of_reach():
    robot = iiwa14()
    assert find_posture(robot, [Pose(np.array([2.0, 0, 0]), np.eye(4)[0])]) is None
