"""The judge sees what the true state does, and its spring pulls as said."""

import numpy as np
import pytest

from dovetail import _bench
from dovetail.control.config import LimitConfig
from dovetail.envs.registered import find_cell
from dovetail.robots.fr3 import fr3

H = 1e-3
HOME = np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0])


@pytest.fixture
def robot():
    return find_cell().loaded_robot()


@pytest.fixture
def limits(robot):
    return LimitConfig.for_period(robot, 0.001)


@pytest.fixture
def judge(robot, limits):
    return _bench.ContactJudge(robot.chain(), limits.params())


def look(judge, q=HOME, dq=None, force=0.0, h=H):
    dq = np.zeros(7) if dq is None else dq
    judge.look(q, dq, np.array([0.0, 0.0, force]), h)


def test_a_joint_past_its_limit_is_told_without_the_margin(judge, limits):
    look(judge, np.where(np.arange(7) == 3, limits.q_min - 1e-4, HOME))
    assert judge.position.value == pytest.approx(1e-4)
    assert (judge.position.axis, judge.position.count) == (3, 1)
    look(judge, np.where(np.arange(7) == 3, limits.q_min + 1e-4, HOME))
    assert (judge.position.count, judge.looks) == (1, 2)


def test_speed_is_told_as_a_share_of_its_limit(judge, limits):
    look(judge, dq=-1.25 * np.eye(7)[5] * limits.dq_max)
    assert judge.speed.value == pytest.approx(1.25)
    assert judge.speed.axis == 5
    assert judge.speed.time == pytest.approx(H)


@pytest.mark.parametrize("joint", [1, 3, 5])
@pytest.mark.parametrize("room", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_the_falling_speed_is_the_makers(joint, room, way):
    """It falls from position limits at which no speed is allowed any more."""
    arm, one = fr3(), np.eye(7)[joint]
    own = arm.limits
    low, high = own.q_min + own.room_at(0.0), own.q_max - own.room_at(0.0)
    limits = LimitConfig.for_period(arm, H, walls=False, q_min=low, q_max=high)
    judge = _bench.ContactJudge(arm.chain(), limits.params())
    end = (own.q_max if way > 0.0 else own.q_min)[joint]
    q = arm.posture("down") * (1.0 - one) + (end - way * room) * one
    most = np.sqrt(2.0 * own.taper_brake * room) - own.taper_offset
    look(judge, q, 0.99 * way * most * one)
    assert judge.tapered_speed.count == 0
    look(judge, q, 1.01 * way * most * one)
    assert judge.tapered_speed.count == 1
    assert judge.tapered_speed.axis == joint
    assert judge.tapered_speed.value == pytest.approx(0.01 * most[joint])


def test_walls_and_tcp_speed_are_those_of_the_true_tool(judge, robot, limits):
    pose = robot.tool_pose(HOME)
    dq = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    look(judge, dq=dq)
    v = robot.chain().jacobian(HOME)[:3] @ dq
    tool = limits
    room = np.minimum(pose.position - tool.x_min, tool.x_max - pose.position)
    assert judge.wall.value == pytest.approx(-room.min())
    assert judge.tcp_speed.value == pytest.approx((np.abs(v) - tool.dx_max).max())


@pytest.mark.parametrize("hertz", [30.0, 8.0, 3.0, 1.0])
def test_vibration_is_what_lies_above_eight_hertz(judge, hertz):
    """The power that Butterworth's high pass of second order lets through."""
    for k in range(4000):
        if k == 2000:
            judge.take_vibration()
        dq = np.sin(2.0 * np.pi * hertz * k * H) * np.eye(7)[2]
        look(judge, dq=dq)
    power = judge.take_vibration() ** 2 / 0.5
    assert power == pytest.approx(1.0 / (1.0 + (8.0 / hertz) ** 4), abs=0.01)


def test_the_spring_pulls_towards_its_anchor_and_against_the_motion(judge, robot):
    p = robot.tool_pose(HOME).position
    judge.set_spring(p + np.array([0.01, 0.0, 0.0]), 2000.0, 30.0)
    judge.set_push(np.array([0.0, 5.0, 0.0]))
    assert judge.force(HOME, np.zeros(7)) == pytest.approx([20.0, 5.0, 0.0], abs=1e-9)
    dq = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    look(judge, dq=dq)
    v = robot.chain().jacobian(HOME)[:3] @ dq
    expected = np.array([20.0, 5.0, 0.0]) - 30.0 * v
    assert judge.force(HOME, dq) == pytest.approx(expected, abs=1e-9)


def test_contact_is_compared_with_the_resting_push_once_the_impact_is_over(judge):
    judge.set_resting(20.0)
    for _ in range(300):
        look(judge)
    for _ in range(30):
        look(judge, force=1000.0)
    assert judge.contact.value == -np.inf  # still the impact
    assert judge.peak.value == 1000.0
    for _ in range(300):
        look(judge, force=60.0)
    assert judge.contact.value == pytest.approx(3.0, rel=0.05)
    for _ in range(100):
        look(judge, force=120.0)
    assert judge.contact.value == pytest.approx(6.0, rel=0.05)
    assert 0 < judge.contact.count < 100


def test_what_the_spring_pulls_with_is_part_of_what_rests(judge, robot):
    p = robot.tool_pose(HOME).position
    judge.set_resting(20.0)
    judge.set_spring(p + np.array([0.02, 0.0, 0.0]), 2000.0, 0.0)
    for _ in range(500):
        judge.force(HOME, np.zeros(7))
        look(judge, force=60.0)
    assert judge.contact.value == pytest.approx(1.0, rel=0.05)
