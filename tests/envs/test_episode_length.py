"""An episode's length: Gymnasium's `max_episode_steps`, and `max_steps` elsewhere."""

import gymnasium as gym
import numpy as np
import pytest

import dovetail  # noqa: F401  (registers the environments)
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import make, make_env
from dovetail.errors import ConfigError
from dovetail.learn.foreign import settings_of_env
from dovetail.tasks.peg_in_hole.task import PegInHole

ID = "dovetail/PegInHole-v0"


def length(env, most=300):
    """Play an episode of zeros; return after how many actions it is truncated."""
    env.reset(seed=0)
    steps, cut = 0, False
    while steps < most and not cut:
        _, _, ended, cut, _ = env.step(np.zeros(4, dtype=np.float32))
        assert not ended
        steps += 1
    env.close()
    return steps


@pytest.mark.parametrize("asked", [3, 205])
def test_the_length_that_gymnasium_is_asked_for_holds_both_ways(asked):
    env = gym.make(ID, max_episode_steps=asked)
    assert env.spec.max_episode_steps == asked
    assert length(env) == asked


def test_the_usual_length_is_told():
    env = gym.make(ID)
    assert env.spec.max_episode_steps == EnvConfig().max_steps
    assert length(env) == 200


def test_without_a_limit_there_is_none():
    assert length(gym.make(ID, max_episode_steps=-1), most=250) == 250


def test_beside_gymnasium_our_own_setting_holds():
    assert length(make(ID, max_steps=205)) == 205
    assert length(make_env(PegInHole, max_steps=4)) == 4


@pytest.mark.parametrize("given", [{"max_steps": 4}, {"max_steps": 400}])
@pytest.mark.parametrize("wrap", [dict, lambda **g: {"config": EnvConfig(**g)}])
def test_our_own_word_is_refused_where_it_would_not_be_all(given, wrap):
    number = given["max_steps"]
    with pytest.raises(ConfigError, match=f"max_episode_steps={number}"):
        gym.make(ID, **wrap(**given))
    for mode in ("sync", "vector_entry_point"):
        with pytest.raises(ConfigError, match=f"max_episode_steps={number}"):
            gym.make_vec(ID, 1, mode, **wrap(**given))


@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
def test_many_environments_have_the_same_length(mode):
    envs = gym.make_vec(ID, 2, mode, max_episode_steps=3)
    envs.reset(seed=0)
    for step in range(3):
        _, _, _, cut, _ = envs.step(np.zeros((2, 4), dtype=np.float32))
        assert cut.tolist() == [step == 2] * 2
    envs.close()


@pytest.mark.parametrize(("given", "told"), [(300, 300), (None, 200), (-1, 200)])
def test_a_policy_of_an_environment_has_its_length(given, told):
    env = gym.make(ID, max_episode_steps=given)
    assert settings_of_env(env).max_steps == told
    env.close()
