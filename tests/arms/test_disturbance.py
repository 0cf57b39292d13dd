"""Pushes and a moving hole during the steps of an arm in this process."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import build_arm
from dovetail.envs.registered import find_cell
from dovetail.poses import Pose, quat_about_z, quat_multiply

HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
DOWN = quat_multiply(quat_about_z(0.0), np.array([0.0, 1.0, 0.0, 0.0]))
SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])


@pytest.fixture
def arm():
    arm = build_arm(None, find_cell(), TaskSpec.parse("XYZ:force A:pose BC:hold"))
    yield arm
    arm.close()


def start(arm, z=0.20):
    q = arm.facts.robot.inverse_kinematics(Pose(np.array([0.60, 0.0, z]), DOWN), SEED)
    arm.reset(q, HOLE)
    target = _core.Target()
    target.position_d, target.quat_wxyz_d = np.array([0.60, 0.0, z]), DOWN
    return target


def test_a_push_moves_the_tool_its_way_and_ends_with_its_time(arm):
    target = start(arm)
    forces = []
    plain = arm.plant.push
    arm.plant.push = lambda force: (forces.append(np.array(force)), plain(force))
    arm.push(np.array([0.0, 30.0, 0.0]), 0.062)
    moved = arm.step(target).tool.position[1]
    assert moved > 1e-4
    arm.step(target)
    arm.step(target)
    assert len(forces) == 14  # 62 ms are 13 control periods of 5 ms, then none
    assert all(force[1] == 30.0 for force in forces[:-1])
    assert not forces[-1].any()


def test_a_step_under_a_push_logs_every_cycle_once(arm):
    target = start(arm)
    arm.step(target)
    arm.push(np.array([10.0, 0.0, 0.0]), 0.02)
    state = arm.step(target)
    np.testing.assert_allclose(state.log[:, 0], 0.05 + 0.005 * np.arange(10))
    assert state.stamp == pytest.approx(0.1)


def test_a_step_cycle_by_cycle_is_the_step_at_once(arm):
    target = start(arm)
    target.f_star = np.array([1.0, -1.0, -2.0, 0, 0, 0])
    whole = [arm.step(target).log for _ in range(5)]
    start(arm)
    arm.move_fixture(HOLE, np.zeros(3))
    pieces = []
    for _ in range(5):
        arm.push(np.zeros(3), 0.05)
        pieces.append(arm.step(target).log)
    np.testing.assert_array_equal(np.vstack(pieces), np.vstack(whole))


def test_a_hole_moves_in_every_control_period(arm):
    target = start(arm)
    places = []
    plain = arm.plant.move_fixture
    arm.plant.move_fixture = lambda hole: (places.append(hole.position), plain(hole))
    velocity = np.array([0.02, 0.0, 0.0])
    arm.move_fixture(HOLE, velocity)
    arm.step(target)
    steps = np.diff(np.array(places), axis=0)
    np.testing.assert_allclose(steps, np.tile(0.005 * velocity, (10, 1)), atol=1e-12)
    np.testing.assert_allclose(places[-1], HOLE.position + 0.05 * velocity)


def test_reset_ends_pushes_and_the_holes_motion(arm):
    target = start(arm)
    quiet = arm.step(target).log
    start(arm)
    arm.push(np.array([0.0, 30.0, 0.0]), 10.0)
    arm.move_fixture(HOLE, np.array([0.02, 0.0, 0.0]))
    arm.step(target)
    start(arm)
    np.testing.assert_array_equal(arm.step(target).log, quiet)
