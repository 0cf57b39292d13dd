"""Tare: the f* that holds the weight, against the model's own gravity torque."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from dovetail.envs.tare import SPEED, TRAVEL, measure_tare
from dovetail.errors import ArmError, ConfigError
from dovetail.identify.parameters import nominal_model
from dovetail.plants.plant import COLUMN
from dovetail.poses import Pose, rotation_error
from dovetail.tasks.fixture_pose import FixturePose

from .fake_arm import FakeArm

RESIDUAL = (0.2, -0.1, 0.4)
NEAR_NOTHING = np.array([0.0, 0.0, 1.0, -np.inf])


def make(tare=True, task="XYZ:force A:pose BC:hold", **changes):
    model = replace(nominal_model(), **changes)
    name = "dovetail/PegInHole-v0"
    return gym.make(name, twin=model, tare=tare, task=task).unwrapped


def holding_f_star(env, q):
    """J M^-1 g of the residual gravity alone: what must be pulled against it."""
    chain = env.arm.facts.robot.chain(gravity=RESIDUAL)
    M = chain.inertia_matrix(q) + np.diag(nominal_model().armature)
    return chain.jacobian(q) @ np.linalg.solve(M, chain.gravity(q))


def test_nothing_is_measured_where_nothing_is_missing():
    env = make()
    tare = env.reset(seed=3)[1]["tare"]
    assert np.abs(tare).max() < 0.05
    env.close()


@pytest.mark.parametrize("seed", range(4))
def test_a_known_weight_is_measured_to_the_models_own_figure(seed):
    env = make(gravity_residual=RESIDUAL)
    tare = env.reset(seed=seed)[1]["tare"]
    expected = holding_f_star(env, env.state.q)
    np.testing.assert_allclose(tare[:3], expected[:3], atol=0.1)
    np.testing.assert_allclose(tare[3:], expected[3:], rtol=0.2, atol=0.2)
    assert np.linalg.norm(tare[:3]) > 0.3
    assert np.linalg.norm(tare[3:]) > 0.3
    env.close()


def test_friction_is_not_taken_for_weight():
    rubbing = {"coulomb": (0.5, 0.5, 0.4, 0.4, 0.3, 0.15, 0.1)}
    env = make(gravity_residual=RESIDUAL, **rubbing)
    for seed in range(4):
        tare = env.reset(seed=seed)[1]["tare"]
        expected = holding_f_star(env, env.state.q)
        np.testing.assert_allclose(tare[:3], expected[:3], atol=0.4)
    env.close()


def drift(env, steps=20):
    """Speed of the tool where almost nothing is asked for [m/s], world axes."""
    env.reset(seed=1)
    for _ in range(steps):
        env.step(np.full(4, 1e-6))  # at 0 an axis is held
    return env.state.tool.velocity[:3]


def test_without_a_push_the_tool_stands_still_with_it_and_drifts_without():
    stands, drifts = (make(tare, gravity_residual=RESIDUAL) for tare in (True, False))
    assert np.abs(drift(stands)).max() < 0.001
    assert np.abs(drift(drifts)).max() > 0.01
    stands.close()
    drifts.close()


def test_at_action_zero_an_axis_is_held_whatever_weight_is_missed():
    env = make(False, gravity_residual=RESIDUAL)
    env.reset(seed=1)
    for _ in range(10):
        env.step(np.zeros(4))
    start = env.state.tool.position.copy()
    for _ in range(100):
        env.step(np.zeros(4))
    assert np.linalg.norm(env.state.tool.position - start) < 0.005
    env.step(np.array([1.0, 0.0, 0.0, 0.0]))
    assert env.state.tool.velocity[0] > 0.01  # let go at once
    env.close()


def test_a_tool_that_was_led_is_back_at_its_start_and_all_of_the_way_is_counted():
    led, placed = make(True), make(False)
    led.reset(seed=5)
    placed.reset(seed=5)
    np.testing.assert_allclose(
        led.state.tool.position, placed.state.tool.position, atol=5e-4
    )
    heights = led.state.log[:, COLUMN["z"]]
    assert heights.max() - heights[0] == pytest.approx(TRAVEL, rel=0.1)
    assert heights.min() > heights[0] - 5e-4  # never down, where a table may be
    assert np.abs(led.state.log[:, COLUMN["vz"]]).max() < 2.0 * SPEED
    assert len(led.state.log) == round(led.state.stamp / led.arm.facts.period)
    led.close()
    placed.close()


@pytest.mark.parametrize("seed", range(3))
def test_the_same_seed_measures_the_same(seed):
    env = gym.make("dovetail/PegInHole-v0", twin="medium", tare=True).unwrapped
    first = env.reset(seed=seed)[1]["tare"]
    np.testing.assert_array_equal(env.reset(seed=seed)[1]["tare"], first)
    env.close()


def sag(name, axes, *, tare):
    """Largest position error of held axes [m] after a second at action 0."""
    large = tuple(2.0 * g for g in RESIDUAL)  # the law itself takes 0.3 m/s2 off
    model = replace(nominal_model(), gravity_residual=large)
    env = gym.make(name, twin=model, tare=tare).unwrapped
    env.reset(seed=1)
    start = env.state.tool
    for _ in range(20):
        env.step(np.zeros(env.action_space.shape))
    moved = env.state.tool.position - start.position
    tilt = rotation_error(env._goal.quat_wxyz, env.state.tool.quat_wxyz)
    env.close()
    return np.abs(np.append(moved, tilt)[axes]).max()


@pytest.mark.parametrize(
    ("name", "axes"),
    [("dovetail/RailClip-v0", [2]), ("dovetail/PegInHole-v0", [3, 4])],
)
def test_held_axes_do_not_sag_with_it(name, axes):
    without = sag(name, axes, tare=False)
    assert without > 1e-3
    assert sag(name, axes, tare=True) < 0.3 * without


def test_free_axes_are_left_alone():
    task = "XYZ:force A:pose B:hold C:free"
    env = make(task=task, gravity_residual=RESIDUAL)
    tare = env.reset(seed=0)[1]["tare"]
    assert tare[3] == 0.0
    assert tare[4] != 0.0
    env.close()


def test_a_tool_that_something_holds_is_an_error():
    arm = FakeArm()  # stays where it is
    with pytest.raises(ArmError, match="something is in the way") as error:
        measure_tare(arm, arm.state, (0, 1, 2), np.zeros(6), np.ones(3), NEAR_NOTHING)
    assert error.value.reason == "tare"
    assert len(error.value.state.log) > 20 * len(arm.state.log)  # the way, not its end


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"task": "XYZ:pose ABC:hold"}, "needs a force axis among X Y Z"),
        ({"force_damping": 0.0}, "needs at least 20"),
        ({"force_damping": (40.0, 40.0, 10.0)}, "force_damping is 10 1/s"),
        ({"near_press": 0.0}, "near_press is 0"),
    ],
)
def test_what_cannot_be_measured_is_refused_before_anything_moves(settings, message):
    with pytest.raises(ConfigError, match=message):
        gym.make("dovetail/PegInHole-v0", tare=True, **settings)


def test_below_a_block_in_a_wall_it_leads_the_tool_down():
    core = gym.make("dovetail/PegInHole-v0", facing="robot", tare=True).unwrapped
    facing = core.task.trial_poses[0].facing
    fixture = FixturePose.given((0.87, 0.0, 0.42, 0.0), facing).pose()
    low = float(core.cell.fixture.corners[:, 2].min())
    half = float(np.abs(core.cell.fixture.corners[:, :2]).max())
    peg = float(np.abs(core.cell.held.corners[:, :2]).max())
    beside = np.array([0.87 - 0.5 * low, 0.0, 0.42 - half - peg - 0.004])
    robot = core.arm.facts.robot
    q = robot.inverse_kinematics(
        Pose(beside, core.task.goal(fixture).quat_wxyz), robot.posture("forward")
    )
    core.reset(options={"fixture": fixture, "start": q})
    forces = core.state.log[:, [COLUMN[name] for name in ("fx", "fy", "fz")]]
    assert np.abs(forces).max() == 0.0
