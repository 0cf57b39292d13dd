"""An environment that has not begun can be copied, and sent to another process."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest

from dovetail.envs.registered import make_env
from dovetail.errors import ConfigError
from dovetail.evaluation.perturbation import Perturbation, make_perturbed
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.rail_clip.task import RailClip
from dovetail.tasks.starts import RandomisationConfig
from dovetail.trackers.covered import Covered

ID = "dovetail/PegInHole-v0"


def copies(env):
    return copy.deepcopy(env), pickle.loads(pickle.dumps(env))


def path(env):
    """Return the observations of a short seeded episode."""
    observation, _ = env.reset(seed=3)
    rng = np.random.default_rng(0)
    seen = [observation]
    for _ in range(5):
        action = rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)
        seen.append(env.step(action)[0])
    env.close()
    return np.array(seen)


@pytest.mark.parametrize(
    "make",
    [
        lambda: make_env(PegInHole, "twin:medium", peg="round", stack=1),
        lambda: make_env(RailClip, theta_range=0.3),
        lambda: gym.make(ID, twin="easy", randomisation=RandomisationConfig()),
        lambda: gym.make("dovetail/RailClip-v0"),
        lambda: make_perturbed(ID, Perturbation(fixture_shift=0.002, push=20.0), {}),
    ],
)
def test_a_copy_runs_as_the_original_does(make):
    env = make()
    others = copies(env)
    wanted = path(env)
    for other in others:
        assert other.unwrapped is not env.unwrapped
        np.testing.assert_array_equal(path(other), wanted)


def test_a_copy_has_a_tracker_of_its_own():
    env = make_env(PegInHole, tracker=Covered())
    other = copy.deepcopy(env)
    assert isinstance(other.tracker, Covered)
    assert other.tracker is not env.tracker


def test_a_begun_environment_has_no_copy():
    env = make_env(PegInHole)
    env.reset(seed=0)
    for attempt in (copy.deepcopy, pickle.dumps):
        with pytest.raises(ConfigError, match="copy it before reset"):
            attempt(env)


def test_an_arm_that_is_an_object_has_no_copy():
    arm = make_env(PegInHole).arm
    for env in (make_env(PegInHole, arm), make_env(PegInHole, arm=arm)):
        with pytest.raises(ConfigError, match="give the arm's address"):
            copy.deepcopy(env)


class Fixed:
    """Hands out an environment that is there, as some vector environments are given."""

    def __init__(self, env):
        self.env = env

    def __call__(self):
        return self.env


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vector_environments_give_the_numbers_of_single_ones(mode):
    env = gym.make(ID, disable_env_checker=True)
    if mode == "sync":
        vec = gym.vector.SyncVectorEnv([Fixed(copy.deepcopy(env)) for _ in range(2)])
    else:
        vec = gym.vector.AsyncVectorEnv([Fixed(env)] * 2, context="spawn")
    try:
        observations, _ = vec.reset(seed=[3, 4])
        actions = np.full((2, 4), 0.3, dtype=np.float32)
        after, *_ = vec.step(actions)
    finally:
        vec.close()
    for i in range(2):
        single = gym.make(ID, disable_env_checker=True)
        np.testing.assert_array_equal(observations[i], single.reset(seed=3 + i)[0])
        np.testing.assert_array_equal(after[i], single.step(actions[i])[0])
        single.close()


def test_make_vec_starts_processes_by_spawn():
    vec = gym.make_vec(
        ID,
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": "spawn"},
        twin="easy",
    )
    try:
        observations, _ = vec.reset(seed=3)
    finally:
        vec.close()
    assert observations.shape == (2, 14)
