"""The wrench on the tool, against the force that a simulation knows."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.local_arm import LocalArm
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.find import make_plant
from dovetail.plants.plant import COLUMN, DynamicsConfig
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z, tool_down
from extras import need

FIXTURE = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
FREE = np.array([0.6, 0.0, 0.25])
BESIDE_HOLE = np.array([0.635, 0.0, 0.105])
TASK = TaskSpec.parse("XYZ:force A:pose BC:hold")
WRENCH = slice(COLUMN["wrench_fx"], COLUMN["wrench_mz"] + 1)
TRUE = slice(COLUMN["fx"], COLUMN["fz"] + 1)
# Largest error of a push of 20 N and of a press [N]: dry friction hides as much.
EXACT, EASY, MEDIUM, HARD = (0.1, 0.2), (1.5, 1.0), (4.0, 2.0), (12.0, 4.0)
PLACES = [
    ("mujoco", EXACT),
    pytest.param("bullet", EXACT, marks=pytest.mark.bullet),
    *(("easy", EASY), ("medium", MEDIUM), ("hard", HARD)),
]


def build(place, period, kind=LocalArm):
    cell = find_cell()
    if place == "bullet":
        need("pybullet")
    if place in ("mujoco", "bullet"):
        plant = make_plant(place, cell, DynamicsConfig())
    else:
        plant = make_twin(load_twin(place), cell)
    settings = make_settings(cell, EnvConfig(period=period))
    if kind is not LocalArm:
        return kind(plant, *settings, TASK, period)
    return LocalArm(plant, cell.loaded_robot(), *settings, TASK, period)


def start(arm, position):
    robot = arm.facts.robot
    pose = Pose(position, tool_down(0.0))
    arm.reset(robot.inverse_kinematics(pose, robot.posture("rest")), FIXTURE)
    target = _core.Target(quat_wxyz_d=pose.quat_wxyz)
    target.stay = 0b111
    return target


@pytest.mark.parametrize("period", [0.001, 0.005])
@pytest.mark.parametrize(("place", "allowed"), PLACES)
def test_a_push_and_a_press_are_told(place, allowed, period):
    arm = build(place, period)
    tail = round(0.1 / period)
    for force in (np.array([20.0, 0.0, 0.0]), np.array([0.0, -14.0, 14.0])):
        target = start(arm, FREE)
        rest = arm.step(target, 0.3).log[-tail:, WRENCH].mean(axis=0)
        arm.push(force, 1.0)
        told = arm.step(target, 0.3).log[-tail:, WRENCH].mean(axis=0) - rest
        np.testing.assert_allclose(told[:3], force, atol=allowed[0])
    target = start(arm, BESIDE_HOLE)
    rest = arm.step(target, 0.3).log[-tail:, WRENCH].mean(axis=0)
    target.stay = 0
    target.f_star = np.array([0.0, 0.0, -8.0, 0.0, 0.0, 0.0])
    log = arm.step(target, 0.6).log[-tail:]
    true, told = log[:, TRUE].mean(axis=0), log[:, WRENCH].mean(axis=0) - rest
    assert true[2] > 30.0
    assert told[2] == pytest.approx(true[2], abs=allowed[1])
    arm.close()


@pytest.mark.parametrize("period", [0.001, 0.005])
def test_a_push_is_told_as_quickly_as_the_estimates_bandwidth_says(period):
    arm = build("mujoco", period)
    target = start(arm, FREE)
    arm.step(target, 0.1)
    arm.push(np.array([0.0, 0.0, 20.0]), 1.0)
    told = arm.step(target, 0.2).log[:, WRENCH][:, 2]
    passed = period * np.arange(len(told))
    rate = arm.facts.limits.estimate_rate
    expected = 20.0 * (1.0 - np.exp(-rate * passed))
    np.testing.assert_allclose(told, expected, atol=0.2)
    arm.close()


def test_the_wrench_is_that_of_the_tool_centre_point():
    """By mathematics: Lambda J M^-1 r at the state of the last cycle."""
    arm = build("medium", 0.001)
    target = start(arm, FREE)
    arm.push(np.array([5.0, -8.0, 3.0]), 1.0)
    state = arm.step(target, 0.2)
    controller, q = arm.controller, arm.facts.robot.chain()
    joints = state.log[-1, COLUMN["q1"] : COLUMN["q7"] + 1]
    speed = state.log[-1, COLUMN["dq1"] : COLUMN["dq7"] + 1]
    middle = joints + 0.0005 * speed  # the model is half a period ahead
    J = q.jacobian(middle)
    M = q.inertia_matrix(middle) + np.diag(arm.facts.limits.armature)
    Minv = np.linalg.inv(M)
    expected = np.linalg.solve(J @ Minv @ J.T, J @ Minv @ controller.disturbance)
    np.testing.assert_allclose(controller.wrench, expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(state.wrench, controller.wrench)
    np.testing.assert_array_equal(state.wrench, state.log[-1, WRENCH])
    arm.close()


def test_over_fri_the_cabinets_torques_tell_it():
    from .loopback import CabinetArm

    arm = build("mujoco", 0.005, CabinetArm)
    target = start(arm, FREE)
    assert np.isnan(arm.step(target, 0.3).contact_force).all()
    arm.push(np.array([0.0, 12.0, 16.0]), 1.0)
    state = arm.step(target, 0.5)
    np.testing.assert_allclose(state.wrench[:3], [0.0, 12.0, 16.0], atol=0.5)
    J = arm.facts.robot.chain().jacobian(state.q)
    told = np.linalg.lstsq(J.T, arm.monitoring().tau_external, rcond=None)[0]
    np.testing.assert_allclose(state.wrench, told, atol=0.1)
    arm.close()


def test_before_the_first_cycle_it_is_zero_and_without_the_estimate_unknown():

    arm = build("mujoco", 0.005)
    target = start(arm, FREE)
    robot = arm.facts.robot
    limits = replace(arm.facts.limits, estimate_rate=0.0)
    blind = LocalArm(arm.plant, robot, arm.facts.osc, limits, TASK, 0.005)
    q = robot.posture("rest")
    np.testing.assert_array_equal(blind.reset(q, FIXTURE).wrench, np.zeros(6))
    assert np.isnan(blind.step(target).wrench).all()
    arm.close()


def test_a_policy_may_see_it():
    from dovetail.envs.registered import make_env
    from dovetail.tasks.peg_in_hole.task import PegInHole

    env = make_env(PegInHole, period=0.005, also=("wrench",))
    env.reset(seed=1)
    observation, *_ = env.step(np.zeros(len(env.commands), dtype=np.float32))
    wrench = env.state.wrench
    place = env.scaling.places["wrench"]
    size = np.log1p(np.abs(wrench) / [1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    np.testing.assert_allclose(observation[place], np.copysign(size, wrench), rtol=1e-6)
    assert np.abs(wrench).max() > 0.0
    assert env.scaling.columns[place][-1].name == "obs_wrench_mz"
    assert env.scaling.columns[place][-1].unit == "Nm"
    env.close()
