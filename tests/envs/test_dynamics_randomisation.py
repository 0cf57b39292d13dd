"""Dynamics randomisation: what is drawn, from which range, and that it matters."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import dovetail  # noqa: F401  (registers the environments)
from dovetail.envs.dynamics_randomisation import DynamicsRandomisation, RandomDynamics
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig
from dovetail.settings import values_of
from extras import need
from facts import about

NOTHING = DynamicsRandomisation(
    gravity=0.0, mass=(1.0, 1.0), damping=(1.0, 1.0), friction=(0.3, 0.3)
)
USUAL = DynamicsRandomisation()
FIELDS = {  # field: what it draws, and its range about a base of 1, or of zero gravity
    "gravity": ("gravity_residual", -0.5, 0.5),
    "mass": ("mass_scale", 0.8, 1.2),
    "damping": ("damping", 0.5, 2.0),
    "friction": ("contact_friction", 0.1, 0.6),
}


def only(field):
    return replace(NOTHING, **{field: getattr(USUAL, field)})


def make(ranges, **options):
    env = gym.make("dovetail/PegInHole-v0", disable_env_checker=True, **options)
    return RandomDynamics(env, ranges)


def rollout(env, seed, steps=30):
    """Press down beside the hole and return where the joints went."""
    env.reset(seed=seed)
    action = np.array([0.3, 0.2, -1.0, 0.5], dtype=np.float32)
    return np.array([env.step(action)[4]["observation_raw"] for _ in range(steps)])


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_fills_its_range_and_leaves_the_others_alone(field):
    name, low, high = FIELDS[field]
    rng = np.random.default_rng(0)
    base = DynamicsConfig(damping=(1.0,) * 7)
    draws = [only(field).sample(rng, base) for _ in range(300)]
    values = np.array([np.atleast_1d(values_of(draw)[name]) for draw in draws])
    assert values.min() >= low
    assert values.max() <= high
    np.testing.assert_allclose(values.min(axis=0), low, atol=0.05 * (high - low))
    np.testing.assert_allclose(values.max(axis=0), high, atol=0.05 * (high - low))
    same = {name: values_of(base)[name]}
    assert {replace(draw, **same) for draw in draws} == {base}


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_changes_the_motion(field):
    # Friction shows in contact only: start where the peg soon stands on the block.
    env = make(only(field), near_speed=0.2, force_damping=20.0)
    plain = rollout(make(NOTHING, near_speed=0.2, force_damping=20.0), seed=5, steps=60)
    assert np.abs(rollout(env, seed=5, steps=60) - plain).max() > 1e-5


def test_damping_is_as_often_halved_as_doubled():
    rng = np.random.default_rng(1)
    base = DynamicsConfig(damping=(1.0,) * 7)
    values = np.array([USUAL.sample(rng, base).damping for _ in range(300)])
    assert np.median(values) == pytest.approx(1.0, abs=0.05)


def test_draws_lie_about_the_model_and_not_about_the_last_draw():
    env = make(USUAL, twin="medium")
    model = env.plant.dynamics
    scales = []
    for seed in range(60):
        env.reset(seed=seed)
        scales.append(np.divide(env.plant.dynamics.mass_scale, model.mass_scale))
    assert np.min(scales) >= 0.8 - 1e-9
    assert np.max(scales) <= 1.2 + 1e-9
    assert env.plant.dynamics.coulomb == model.coulomb
    env.close()


@pytest.mark.parametrize(
    "plant", ["mujoco", pytest.param("bullet", marks=pytest.mark.bullet)]
)
def test_the_same_seed_draws_the_same_and_no_seed_draws_anew(plant):
    if plant == "bullet":
        need("pybullet")
    env = make(USUAL, plant=plant)
    first = rollout(env, seed=3, steps=10)
    drawn = env.plant.dynamics
    env.reset()
    assert env.plant.dynamics != drawn
    np.testing.assert_array_equal(rollout(env, seed=3, steps=10), first)
    assert env.plant.dynamics == drawn
    env.close()


def test_start_and_hole_of_a_seed_are_those_without_randomisation():
    with_it, without = make(USUAL, tare=False), make(NOTHING, tare=False)
    _, one = with_it.reset(seed=9)
    _, other = without.reset(seed=9)
    np.testing.assert_array_equal(one["observation_raw"], other["observation_raw"])
    for part, same in zip(
        with_it.unwrapped.fixture, without.unwrapped.fixture, strict=True
    ):
        np.testing.assert_array_equal(part, same)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"gravity": -1.0}, "random gravity is -1 m/s2; allowed: 0 to 10"),
        ({"mass": (1.2, 0.8)}, "random mass is 1.2 to 0.8; give two rising numbers"),
        ({"mass": (0.0, 1.0)}, "from 0.1 to 10"),
        ({"damping": (0.0, 1.0)}, "random damping is 0 to 1.*from 0.01 to 100"),
        ({"friction": (0.1, 6.0)}, "random friction is 0.1 to 6.*from 0 to 5"),
        ({"friction": (float("nan"), 0.6)}, "random friction is nan"),
    ],
)
def test_a_range_that_cannot_be_is_refused_by_name(settings, words):
    with pytest.raises(ConfigError, match=words):
        DynamicsRandomisation(**settings)


def test_ranges_that_lead_out_of_an_arms_are_refused_before_any_episode():
    dynamics = DynamicsConfig(mass_scale=(9.0,) * 7)
    with pytest.raises(ConfigError, check=about("mass_scale[A1]")):
        make(USUAL, dynamics=dynamics)


def test_an_arm_that_is_not_simulated_here_is_refused():
    env = gym.make("dovetail/PegInHole-v0", disable_env_checker=True)
    env.unwrapped.arm = object()
    with pytest.raises(ConfigError, match="simulated in this process only"):
        RandomDynamics(env, USUAL)
