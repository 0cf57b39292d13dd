"""A training on several threads steps the same environments as on one."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.errors import ConfigError, PlantError
from dovetail.learn.algorithms import make_vec_env
from dovetail.learn.config import TrainConfig
from extras import need


def run(config):
    """Return all that the learner is told in several tries of each environment."""
    rng = np.random.default_rng(0)
    env = make_vec_env(config)
    env.seed(3)
    told = [env.reset()]
    for _ in range(60):
        observations, rewards, dones, infos = env.step(
            rng.uniform(-1.0, 1.0, (env.num_envs, 4)).astype(np.float32)
        )
        for info in infos:
            info.get("episode", {}).pop("t", None)  # by the clock
        with np.printoptions(floatmode="unique"):
            words = [np.array(repr(info)) for info in infos]
        told += [observations, rewards, dones, *words]
    env.close()
    return told


@pytest.mark.parametrize("changes", [{}, {"randomise_dynamics": True, "tare": False}])
def test_what_is_learnt_from_is_the_same_with_any_number_of_threads(small, changes):
    need("sbx")
    config = replace(small, num_envs=3, **changes)
    wanted = run(replace(config, threads=1))
    for value, other in zip(run(replace(config, threads=2)), wanted, strict=True):
        np.testing.assert_array_equal(value, other)


def test_mujoco_in_this_process_is_a_batch_and_nothing_else(small):
    need("sbx")
    for changes, kind in (
        ({}, "BatchVecEnv"),
        ({"num_envs": 1}, "DummyVecEnv"),
        ({"threads": 1}, "DummyVecEnv"),
        ({"arm": "twin:easy"}, "DummyVecEnv"),
    ):
        config = replace(small, **changes)
        env = make_vec_env(config)
        assert type(env).__name__ == kind
        assert config.is_batch == (kind == "BatchVecEnv")
        env.close()


def test_an_error_leaves_nothing_running(small):
    need("sbx")
    env = make_vec_env(replace(small, threads=2))
    actions = np.zeros((2, 4), dtype=np.float32)
    env.reset()
    env.envs[1].unwrapped.arm.plant.data.qvel[0] = 1e4
    with pytest.raises(PlantError, match="simulation 1 of the batch"):
        env.step(actions)
    with pytest.raises(ConfigError, match="finite"):
        env.step(np.array([[0, 0, 0, 0], [0, 0, 0, np.nan]], dtype=np.float32))
    env.reset()
    env.step(actions)
    env.close()


def test_threads_that_would_do_nothing_are_refused():
    for place in ({"plant": "bullet"}, {"arm": "twin:easy"}):
        with pytest.raises(ConfigError, match="threads is 2, but only MuJoCo in this"):
            TrainConfig(threads=2, **place)
    with pytest.raises(ConfigError, match="threads is -1; allowed: 0 to"):
        TrainConfig(threads=-1)


def test_another_number_of_threads_resumes_the_same_run():
    config = TrainConfig()
    replace(config, threads=3).require_same(config)
