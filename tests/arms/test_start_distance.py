"""An arm goes to its start unasked only where that is near."""

import numpy as np
import pytest

from dovetail.arms.address import parse_address
from dovetail.arms.reset_motion import TICK, plan_reset
from dovetail.arms.start_distance import require_near
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import SPEED_MAX
from dovetail.errors import ArmError, ConfigError
from dovetail.plants.plant import COLUMN
from dovetail.poses import Pose

from .loopback import free_port
from .test_fri_session import CELL, HOLE, START, TOOL_DOWN, make_arm

ROBOT = CELL.loaded_robot()
CANDLE = np.array([0.0, 0.02, 0.0, -0.05, 0.0, 0.05, 0.0])


def at(y, z=0.2):
    return ROBOT.inverse_kinematics(Pose(np.array([0.6, y, z]), TOOL_DOWN), START)


def test_near_is_near_and_far_is_refused_with_the_distance():
    require_near(ROBOT, at(0.1), START, None)
    with pytest.raises(ArmError, match=r"is 0\.18 m from its start.*--approach") as far:
        require_near(ROBOT, at(0.18), START, None)
    assert far.value.reason == "far"
    turned = START + 0.6 * np.eye(7)[6]
    with pytest.raises(ArmError, match=r"A7 0\.60 rad; unasked it moves 0\.15 m"):
        require_near(ROBOT, turned, START, None)


def test_where_the_arm_was_left_it_goes_back_from():
    far = at(0.2)
    require_near(ROBOT, far, START, far + 0.05)
    with pytest.raises(ArmError):
        require_near(ROBOT, far, START, far + 0.2)


@pytest.mark.parametrize("begin", [CANDLE, at(-0.2, 0.25), START + 0.5 * np.eye(7)[0]])
def test_the_tool_never_moves_faster_than_t1_allows(begin):
    """0.25 m/s are those of the velocity's norm; the arm follows with some ripple."""
    path = [begin, *plan_reset(ROBOT, begin, START, HOLE, 0.29)]
    points = np.array([ROBOT.tool_pose(q).position for q in path])
    speeds = np.linalg.norm(np.diff(points, axis=0), axis=1) / TICK
    assert speeds.max() < 0.2


def test_on_a_robot_all_axes_together_keep_the_speed_of_t1():
    limits = LimitConfig.for_period(ROBOT, 0.005, dx_max=[SPEED_MAX] * 3)

    settings = ControllerSettings(
        osc=OscConfig(), limits=limits, task=TaskSpec.parse("XYZABC:hold"), period=0.005
    )

    def speed(keys):
        address = parse_address(f"fri://127.0.0.1:{free_port()}{keys}")
        arm = address.build(CELL, settings)
        arm.close()
        return arm.facts.limits.dx_max

    assert np.linalg.norm(speed("")) == pytest.approx(0.25)
    assert speed("?control=127.0.0.1:30301").max() == pytest.approx(0.25)


def test_from_the_candle_an_arm_is_asked_for_its_way_and_then_goes_slowly():
    arm = make_arm(reset="move")
    arm._control.place(CANDLE, HOLE)
    with pytest.raises(ArmError, match="from its start") as refused:
        arm.reset(START, HOLE)
    assert refused.value.reason == "far"
    assert len(arm.recent(20.0)) == 0  # nothing was commanded
    arm._approach = True
    arm.reset(START, HOLE)
    log = arm.recent(10.0)
    speed = np.linalg.norm(log[:, COLUMN["vx"] : COLUMN["vz"] + 1], axis=1)
    assert speed.max() < 0.25
    np.testing.assert_allclose(arm.monitoring().q, START, atol=0.03)
    arm.close()


def test_an_arm_that_was_brought_somewhere_goes_on_from_there_unasked():
    arm = make_arm(reset="move")
    arm.reset(START, HOLE)
    far = at(-0.1)
    arm._approach = True
    arm.reset(far, HOLE)
    arm._approach = False
    arm.reset(at(0.1), HOLE)
    arm.close()


def test_approach_is_a_key_of_the_address():
    assert not parse_address("fri://0.0.0.0").approach
    assert parse_address(parse_address("fri://0.0.0.0").with_approach()).approach
    period = parse_address("fri://h?period=1ms").with_approach()
    assert period == "fri://h?period=1ms&approach=yes"
    assert parse_address(period).with_approach() == period
    for text, words in (
        ("mujoco", "leave --approach out"),
        ("grpc://localhost", "serve"),
    ):
        with pytest.raises(ConfigError, match=words):
            parse_address(text).with_approach()
