"""The default of `tare`: on for every arm whose gravity compensation may be wrong."""

import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import dovetail  # noqa: F401  (registers the environments)
from dovetail.cockpit.choice import Choice, build
from dovetail.envs.dynamics_randomisation import DynamicsRandomisation, RandomDynamics
from dovetail.envs.registered import make_env
from dovetail.evaluation.config import EvaluationConfig, environment_options
from dovetail.identify.parameters import nominal_model
from dovetail.learn.algorithms import make_vec_env
from dovetail.learn.config import TrainConfig
from dovetail.plants.plant import DynamicsConfig
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.tasks.peg_in_hole.task import PegInHole
from extras import need

from .fake_arm import FakeArm

ID = "dovetail/PegInHole-v0"
HEAVY = replace(nominal_model(), gravity_residual=(0.0, 0.0, 0.4))
PLACES = [
    ({}, False),
    ({"arm": "mujoco"}, False),
    ({"twin": "easy"}, True),
    ({"arm": "twin:hard"}, True),
    ({"twin": nominal_model()}, False),
    ({"twin": HEAVY}, True),
    ({"dynamics": DynamicsConfig(mass_scale=(1.0,) * 6 + (1.1,))}, True),
    ({"dynamics": DynamicsConfig(coulomb=(0.1,) * 7)}, False),
]


@pytest.mark.parametrize(("place", "is_tared"), PLACES)
def test_it_is_usual_where_weight_may_be_missed(place, is_tared):
    env = gym.make(ID, **place).unwrapped
    assert env.is_tared is is_tared
    env.close()


@pytest.mark.parametrize("asked", [True, False])
@pytest.mark.parametrize("place", [{}, {"twin": HEAVY}])
def test_what_is_asked_for_is_obeyed(asked, place):
    env = gym.make(ID, tare=asked, **place).unwrapped
    assert env.is_tared is asked
    env.close()


def test_it_is_usual_on_the_same_arms_in_a_training():
    need("sbx")

    def is_tared(**settings):
        vec = make_vec_env(TrainConfig(num_envs=1, **settings))
        core = vec.envs[0].unwrapped
        vec.close()
        return core.is_tared

    assert not is_tared()
    assert is_tared(tare=True)
    assert is_tared(arm="twin:easy")
    assert is_tared(randomise_dynamics=True)
    assert not is_tared(randomise_dynamics=True, tare=False)


@pytest.mark.parametrize(("trained", "asked", "told"), [
    (None, None, None),
    (None, True, True),
    (None, False, False),
    (False, None, False),
    (False, True, True),
    (True, None, True),
    (True, False, False),
])  # fmt: skip
def test_an_evaluation_does_what_it_is_told_or_else_as_in_training(
    trained, asked, told
):
    metadata = {"env_id": ID, "env": {} if trained is None else {"tare": trained}}
    config = EvaluationConfig(policy="peg_square", twin="easy", tare=asked)
    assert environment_options(config, metadata).get("tare") is told


@pytest.mark.parametrize("policy", ["none", "corner"])
@pytest.mark.parametrize(
    ("place", "is_tared"), [("mujoco", False), ("twin:easy", True)]
)
def test_it_is_usual_on_the_same_arms_in_the_cockpit(policy, place, is_tared):
    env, _ = build(Choice(policy=policy, place=place))
    assert env.unwrapped.is_tared is is_tared
    env.close()


def test_dynamics_that_are_drawn_are_tared():
    env = RandomDynamics(gym.make(ID), DynamicsRandomisation())
    assert np.abs(env.reset(seed=1)[1]["tare"]).max() > 0.05
    env.close()


def test_weight_that_cannot_be_measured_is_said():
    with pytest.warns(UserWarning, match="force_damping is 0"):
        env = make_env(PegInHole, twin="medium", force_damping=0.0)
    assert not env.is_tared
    env.close()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        quiet = {"tare": False, "force_damping": 0.0}, {"task": "XYZ:pose ABC:hold"}
        for settings in quiet:  # asked for, or held by the controller's own law
            make_env(PegInHole, twin=HEAVY, **settings).close()


def test_a_constant_push_of_half_the_range_arrives():
    """It hovered 20 mm above the block for ever: the weight was not held."""
    env = gym.make(ID, twin="medium", disable_env_checker=True)
    fixture = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
    robot = env.unwrapped.arm.facts.robot
    above = Pose(np.array([0.63, 0.0, 0.13]), tool_down(0.0))
    q = robot.inverse_kinematics(above, robot.posture("down"))
    env.reset(seed=0, options={"fixture": fixture, "start": q})
    down = np.array([0.0, 0.0, -0.5, 0.0], dtype=np.float32)
    pressed = [env.step(down)[4]["contact_force_max"] for _ in range(100)]
    env.close()
    assert pressed[-1] > 5.0


SEEN = {"easy": 2.0, "medium": 6.0, "hard": 16.0}  # N


@pytest.mark.parametrize("name", SEEN)
def test_the_wrench_of_a_tared_arm_is_contact_within_friction(name):
    env = gym.make(ID, twin=name, also=("wrench",), disable_env_checker=True).unwrapped
    seen, rng = [], np.random.default_rng(0)
    for seed in range(3):
        env.reset(seed=seed)
        seen.append(env.state.wrench[:3])
        for _ in range(12):
            action = rng.uniform(-0.5, 0.5, 4).astype(np.float32)
            action[2] = abs(action[2])
            raw = env.step(action)[4]["observation_raw"]
            assert not env.state.contact_force.any()
            np.testing.assert_array_equal(raw[-6:], env.state.wrench)
            seen.append(env.state.wrench[:3])
    env.close()
    assert np.abs(seen).max() < SEEN[name]
    assert np.abs(np.mean(seen, axis=0)).max() < 0.4 * SEEN[name]


def test_without_a_tare_the_wrench_is_the_arms():
    arm = FakeArm()
    arm.place(wrench=(1.0, 2.0, 3.0, 0.0, 0.0, 0.0))
    env = make_env(PegInHole, arm)
    env.reset(seed=0)
    assert env.state.wrench.tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]
    env.close()
