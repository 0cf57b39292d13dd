"""The Franka Research 3: its geometry, and its own limits under attack."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import find_cell
from dovetail.robots.fr3 import fr3
from dovetail.robots.panda import panda
from dovetail.workcell.tool import FRANKA_HAND

ROBOT = fr3()
READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])


def test_the_flange_of_the_ready_pose_is_where_the_maker_has_it():
    # O_T_EE of the maker's examples, without the hand's 103.4 mm to the fingertips.
    assert ROBOT.tool_pose(READY).position == pytest.approx(
        [0.3069, 0.0, 0.4869 + 0.1034], abs=5e-4
    )


def test_it_carries_the_franka_hand():
    cell = find_cell(robot="fr3")
    assert cell.tool.name == FRANKA_HAND.name
    assert cell.tool.mass == pytest.approx(0.73)
    assert cell.tool.length == pytest.approx(0.1121 - 0.020 + cell.tool.reach)


def fastest(q, limits):
    """Return the speed limits of an arm at q [rad/s]: upwards, downwards."""
    rooms = np.array([limits.q_max - q, q - limits.q_min])
    falls = np.sqrt(2.0 * limits.taper_brake * np.maximum(rooms, 0.0))
    return np.clip(falls - limits.taper_offset, 0.0, limits.dq_max)


@pytest.mark.parametrize("hardware", [True, False])
def test_at_the_position_bounds_a_push_still_has_room(hardware):
    limits = LimitConfig.for_period(ROBOT, 1e-3, hardware=hardware)
    for q, way in ((limits.q_max, 0), (limits.q_min, 1)):
        assert fastest(q, ROBOT.limits)[way] == pytest.approx(np.ones(7))
    assert (limits.q_min < ROBOT.posture("down") - 0.2).all()
    assert (limits.q_max > ROBOT.posture("down") + 0.2).all()


@pytest.mark.parametrize("robot", [ROBOT, panda()], ids=["fr3", "panda"])
@pytest.mark.parametrize("seed", range(3))
def test_it_keeps_what_ends_a_motion_of_a_franka(seed, robot):
    limits = LimitConfig.for_period(robot, 1e-3, hardware=False)
    task = "XYZ:force A:pose BC:hold"
    controller = make_controller(robot, OscConfig(), limits, task, 1e-3)
    motors, rng = robot.motors, np.random.default_rng(seed)
    plant = _core.RigidPlant(
        robot.chain(), damping=motors.damping, armature=motors.armature
    )
    q = robot.posture("down")
    pose = robot.tool_pose(q)
    plant.reset(q, np.zeros(7))
    controller.reset(q, pose.position, pose.quat_wxyz)
    target = _core.Target(quat_wxyz_d=pose.quat_wxyz)
    joint, last, is_slow = int(rng.integers(7)), np.zeros(7), False
    for k in range(3000):
        q, dq = plant.read()
        if k % 50 == 0:  # a joint is driven to its limit, in every other second
            signs = np.sign(controller_row(q, joint))
            if k // 1000 % 2:
                signs = rng.choice([-1.0, 1.0], 3)
            target.f_star = np.append(30.0 * signs, np.zeros(3))
        result = controller.step(q, dq, target)
        assert not result.flags.ended
        change = np.abs(result.tau - last).max()
        assert change < 1.0  # Nm in a cycle: 1000 Nm/s
        is_slow |= change > 0.98
        last = result.tau
        plant.apply(result.tau, 1e-3)
        up, down = fastest(plant.read()[0], robot.limits)
        assert (plant.read()[1] <= up).all()
        assert (-plant.read()[1] <= down).all()
    assert is_slow  # or nothing was tried


def controller_row(q, joint):
    return ROBOT.chain().jacobian(q)[:3, joint]
