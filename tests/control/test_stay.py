"""Target.stay: a force axis of which nothing is asked is held where it is."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig

TASK = "XYZ:force ABC:hold"
PUSH = np.array([2.4, -2.0, 2.0])  # N: 4 mm by K = 400 1/s2 and 1.6 kg at the tool
ALL = 0b111


def run(robot, q, period, plan, *, push=PUSH, dq=None):
    """TCP positions [m] and force-axis torques under a plan of (time, stay bits)."""
    limits = LimitConfig.for_period(
        robot, period, hardware=False, x_min=-2.0, x_max=2.0
    )
    osc = OscConfig.for_period(period, force_damping=[16.0] * 3 + [0.0] * 3)
    controller = make_controller(robot, osc, limits, TASK, period)
    plant = _core.RigidPlant(
        robot.chain(),
        damping=limits.damping,
        armature=limits.armature,
    )
    plant.reset(q, np.zeros(7) if dq is None else dq)
    plant.set_external_force(push)
    pose = robot.tool_pose(q)
    controller.reset(q, pose.position, pose.quat_wxyz, dq=plant.read()[1])
    positions, asked = [], []
    for time, bits in plan:
        target = _core.Target()
        target.stay = bits
        for _ in range(round(time / period)):
            state = plant.read()
            result = controller.step(*state, target)
            positions.append(robot.tool_pose(state[0]).position)
            asked.append((robot.chain().jacobian(state[0]) @ result.a0)[:3])
            plant.apply(result.tau, period)
    return np.array(positions), np.array(asked)


@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_an_axis_that_stays_is_held_under_a_constant_push(robot, q_home, period):
    held, _ = run(robot, q_home, period, [(4.0, ALL)])
    free, _ = run(robot, q_home, period, [(4.0, 0)])
    assert np.abs(held - held[0]).max() < 5.2e-3  # before the push is known
    assert np.abs(held[-1] - held[0]).max() < 4.2e-3
    assert (np.abs(held[-1] - held[-2]) < 1e-6).all()  # and it rests
    assert np.abs(free[-1] - free[0]).min() > 20e-3


def test_the_way_back_is_bounded_so_that_a_hand_can_lead_the_arm(robot, q_home):
    """The spring alone would hold 25 N after 40 mm; it gives way at 20 mm."""
    push = np.array([0.0, 25.0, 0.0])
    positions, _ = run(robot, q_home, 2e-3, [(2.0, ALL)], push=push)
    assert positions[-1, 1] - positions[0, 1] > 0.1


@pytest.mark.parametrize("axis", range(3))
def test_each_bit_is_one_axis(robot, q_home, axis):
    held, _ = run(robot, q_home, 2e-3, [(2.0, 1 << axis)])
    moved = np.abs(held[-1] - held[0])
    assert moved[axis] < 5e-3
    assert np.delete(moved, axis).min() > 20e-3


def test_it_lets_go_at_once_when_the_bit_is_cleared(robot, q_home):
    period = 2e-3
    positions, asked = run(robot, q_home, period, [(2.0, ALL), (0.3, 0)])
    last = round(2.0 / period) - 1
    # Held, the springs stand against the push; the cycle after they are gone.
    assert np.abs(asked[last]).max() < 0.01
    free = asked[last + 1]
    assert (np.sign(free) == np.sign(PUSH)).all()
    assert np.abs(free).min() > 0.1
    assert (np.sign(positions[-1] - positions[last]) == np.sign(PUSH)).all()


def test_it_is_held_where_it_came_to_rest_not_where_it_was_asked(robot, q_home):
    J = robot.chain().jacobian(q_home)
    dq = np.linalg.pinv(J) @ (0.2 * np.eye(6)[0])
    positions, _ = run(robot, q_home, 2e-3, [(2.0, ALL)], push=np.zeros(3), dq=dq)
    x = positions[:, 0]
    assert x[-1] - x[0] > 0.2 / 16.0 * 0.5  # damping alone stops it
    assert x.max() - x[-1] < 1e-3  # and nothing pulls it back


@pytest.mark.parametrize("task", ["XYZABC:hold", "XYZ:pose ABC:hold", "ABC:hold"])
def test_the_bits_mean_nothing_on_other_axes(robot, q_home, task):
    limits = LimitConfig.for_period(robot, 1e-3, hardware=False)
    pose = robot.tool_pose(q_home)
    torques = []
    for bits in (0, ALL):
        controller = make_controller(robot, OscConfig(), limits, task, 1e-3)
        controller.reset(q_home, pose.position, pose.quat_wxyz)
        target = _core.Target(position_d=pose.position, quat_wxyz_d=pose.quat_wxyz)
        target.stay = bits
        for step in range(5):
            q = q_home + 1e-4 * step
            torques.append(controller.step(q, np.full(7, 0.1), target).tau)
    np.testing.assert_array_equal(torques[:5], torques[5:])
