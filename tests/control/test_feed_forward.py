"""The feed-forward of a Target: a path is followed without lag, and ends by itself."""

from dataclasses import replace

import numpy as np
import pytest
from reference import NEAR_TIME

from dovetail import _core, poses
from dovetail.arms.local_arm import LocalArm
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.cycle_loop import run_cycles
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.poses import Pose

POSE = "XYZABC:pose"
STEP = 0.05  # s, of the policy
PATH_TIME = 0.1  # s, as in osc.hpp
RADIUS, SPEED, TURN = 0.05, 0.1, 0.2  # m, m/s, rad
RATE = SPEED / RADIUS  # rad/s
WIDE = {"x_min": -2.0, "x_max": 2.0}
AWAY = Pose(np.array([0.6, 0.3, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))


def circle(start, time):
    """Pose, velocity and acceleration on a level circle, the tool turning about z."""
    phase = RATE * time
    s, c = np.sin(phase), np.cos(phase)
    position = start.position + RADIUS * np.array([s, 1.0 - c, 0.0])
    turn = poses.quat_about_z(TURN * (1.0 - c))
    velocity = [SPEED * c, SPEED * s, 0.0, 0.0, 0.0, TURN * RATE * s]
    acceleration = RATE * np.array([-SPEED * s, SPEED * c, 0, 0, 0, TURN * RATE * c])
    quat = poses.quat_multiply(turn, start.quat_wxyz)
    return position, quat, np.array(velocity), acceleration


def follow_circle(robot, rest_at, q, period, share):
    """Largest distance [m] and angle [rad] from the circle, after its first 0.5 s."""
    limits = LimitConfig.for_period(robot, period, **WIDE)
    osc = OscConfig.for_period(period)
    controller, plant, start = rest_at(q, osc, limits, POSE, period)
    errors = []
    for cycle in range(round(2.0 / period)):
        time = cycle * period
        if cycle % round(STEP / period) == 0:
            position, quat, velocity, acceleration = circle(start, time)
            target = _core.Target(position_d=position, quat_wxyz_d=quat)
            target.velocity_d = share * velocity
            target.acceleration_d = share * acceleration
        q, dq = plant.read()
        now, wanted = robot.tool_pose(q), circle(start, time)
        angle = poses.rotation_error(wanted[1], now.quat_wxyz)
        away = np.linalg.norm(now.position - wanted[0])
        errors.append((away, np.linalg.norm(angle)))
        plant.apply(controller.step(q, dq, target).tau, period)
        target.age += period
    return np.array(errors)[round(0.5 / period) :].max(axis=0)


@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_a_circle_is_followed_without_lag(robot, rest_at, q_home, period):
    late, late_turn = follow_circle(robot, rest_at, q_home, period, 0.0)
    away, turn = follow_circle(robot, rest_at, q_home, period, 1.0)
    assert late > 9e-3  # 2 v / sqrt(K) is 10 mm, and 50 ms of the path
    assert late_turn > 0.05
    assert away < 0.5e-3
    assert turn < 0.1 * late_turn  # the rest is what the wrist's friction costs


@pytest.fixture
def limits(robot):
    return LimitConfig.for_period(robot, 1e-3, **WIDE)


def controller_at(robot, limits, task, q, **osc):
    controller = make_controller(robot, OscConfig(**osc), limits, task, 1e-3)
    start = robot.tool_pose(q)
    controller.reset(q, start.position, start.quat_wxyz)
    return controller


def target_at(robot, q, **fields):
    start = robot.tool_pose(q)
    target = _core.Target(position_d=start.position, quat_wxyz_d=start.quat_wxyz)
    for name, value in fields.items():
        setattr(target, name, value)
    return target


def torque(robot, limits, task, q, target, **osc):
    dq = np.linspace(-0.1, 0.2, 7)
    result = controller_at(robot, limits, task, q, **osc).step(q, dq, target)
    assert result.flags.packed == 0
    return result.tau


def test_without_feed_forward_the_age_of_a_target_changes_nothing(
    robot, limits, q_home, rng
):
    for _ in range(20):
        q = q_home + rng.normal(0.0, 0.1, 7)
        aside = robot.tool_pose(q).position + rng.normal(0.0, 0.003, 3)
        fresh = target_at(robot, q, position_d=aside)
        tau = torque(robot, limits, POSE, q, fresh)
        for age in (0.02, 0.1, 5.0, 1e9):
            old = target_at(robot, q, position_d=aside, age=age)
            np.testing.assert_array_equal(tau, torque(robot, limits, POSE, q, old))


def test_the_torque_is_affine_in_the_feed_forward(robot, limits, q_home, rng):
    for task in (POSE, "XYZ:force ABC:pose"):
        osc = {"force_damping": 16.0}
        first, second = rng.uniform(-0.05, 0.05, (2, 2, 6))
        share = rng.uniform(-1.0, 2.0)
        mixed = share * first + (1.0 - share) * second
        tau = [
            torque(
                robot, limits, task, q_home,
                target_at(robot, q_home, velocity_d=v, acceleration_d=a), **osc,
            )
            for v, a in (first, second, mixed)
        ]  # fmt: skip
        wanted = share * tau[0] + (1.0 - share) * tau[1]
        np.testing.assert_allclose(tau[2], wanted, atol=1e-8)


def test_held_and_free_axes_have_no_path(robot, limits, q_home):
    motion = {"velocity_d": np.full(6, 0.1), "acceleration_d": np.full(6, 0.5)}
    for task in ("XYZABC:hold", "XYZ:hold ABC:free"):
        still = torque(robot, limits, task, q_home, target_at(robot, q_home))
        for age in (0.0, 0.06):
            moving = target_at(robot, q_home, age=age, **motion)
            np.testing.assert_array_equal(
                still, torque(robot, limits, task, q_home, moving)
            )


def run(robot, limits, task, q, target, seconds, **osc):
    """Hold one Target; return the tool's positions [m] and its last twist."""
    controller = controller_at(robot, limits, task, q, **osc)
    plant = _core.RigidPlant(
        robot.chain(),
        damping=limits.damping,
        armature=limits.armature,
    )
    plant.reset(q, np.zeros(7))
    way = []
    for _ in range(round(seconds / 1e-3)):
        q, dq = plant.read()
        way.append(robot.tool_pose(q).position)
        plant.apply(controller.step(q, dq, target).tau, 1e-3)
        target.age += 1e-3
    return np.array(way), robot.chain().jacobian(q) @ dq


def test_a_target_that_gets_no_successor_does_not_run_away(robot, limits, q_home):
    velocity = np.array([0.1, 0.0, -0.05, 0.0, 0.0, 0.3])
    target = target_at(robot, q_home, velocity_d=velocity)
    way, twist = run(robot, limits, POSE, q_home, target, 1.5)
    end = way[0] + PATH_TIME * velocity[:3]
    assert np.abs(way[-1] - end).max() < 2e-4  # m
    assert np.abs(twist).max() < 1e-3
    assert (way[:, 0] - end[0]).max() < 5e-3  # braked, not past it


def test_damping_of_force_axes_pulls_towards_the_velocity(robot, limits, q_home):
    target = target_at(robot, q_home, velocity_d=0.1 * np.eye(6)[1])
    damped = {"force_damping": [50.0] * 3 + [0.0] * 3}
    task = "XYZ:force ABC:hold"
    _, twist = run(robot, limits, task, q_home, target, PATH_TIME, **damped)
    assert twist[1] == pytest.approx(0.1, abs=5e-3)
    _, twist = run(robot, limits, task, q_home, target, 0.3, **damped)
    assert np.abs(twist[:3]).max() < 1e-3  # its path has ended


@pytest.mark.parametrize("surface", [0.0, 0.04, 0.1, 0.3])
def test_near_contact_the_tool_may_go_along_with_the_surface(
    robot, limits, q_home, surface
):
    """Up to 0.1 m/s: whoever is wrong about the surface has no more than that."""
    limits = replace(limits, near_speed=0.02)
    height = robot.tool_pose(q_home).position[2]
    velocity = surface * np.eye(6)[1]
    for sign in (1.0, -1.0):
        target = target_at(robot, q_home, velocity_d=velocity)
        target.f_star = 2.0 * sign * np.eye(6)[1]
        target.near_plane = np.array([0.0, 0.0, 1.0, height + 0.1])
        task = "XYZ:force ABC:hold"
        _, twist = run(robot, limits, task, q_home, target, PATH_TIME)
        most = max(sign, 0.0) * min(surface, 0.1) + 0.02
        come = 1.0 - np.exp(-PATH_TIME / NEAR_TIME)  # the time in which it is corrected
        assert sign * twist[1] == pytest.approx(most * come, abs=3e-3)


def moved_by(roads):
    """Where each road brings the arm that follows a path for 50 ms."""
    ends = []
    plant = MujocoPlant(find_cell())
    period = 5e-3
    limits = LimitConfig.for_period(plant.robot, period, **WIDE)
    arm = LocalArm(
        plant, plant.robot, OscConfig.for_period(period), limits, POSE, period
    )
    q = np.array([0.0, 0.6, 0.0, -1.55, 0.0, 0.99, 0.0])
    velocity = 0.2 * np.eye(6)[1]
    for road in roads:
        arm.reset(q, AWAY)
        target = target_at(plant.robot, q, velocity_d=velocity)
        for _ in range(2):
            road(arm, target)
            target.position_d += STEP * velocity[:3]
        assert target.age == 0.0  # a Target belongs to who made it
        ends.append(arm.plant.read()[0])
    arm.close()
    return ends


def test_every_loop_counts_the_age_of_the_target_it_holds():
    def cycle_by_cycle(arm, target):
        for k in range(10):
            older = _core.Target(target)
            older.age = k * arm.facts.period
            arm.plant.run_cycles(arm.controller, older, 1, arm.facts.period)

    def disturbed(arm, target):
        arm.push(np.zeros(3), 1.0)
        arm.step(target, STEP)

    def in_python(arm, target):
        run_cycles(arm.plant, arm.controller, target, 10, arm.facts.period, 0.0)

    def in_cpp(arm, target):
        arm.step(target, STEP)

    ends = moved_by([cycle_by_cycle, in_cpp, disturbed, in_python])
    assert np.abs(ends[0]).max() > 0.01
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], atol=1e-12)
