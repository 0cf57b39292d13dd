"""The exported policy acts like the network that was trained, for every algorithm."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.control.proven import DECLARED
from dovetail.learn.algorithms import make_model, make_vec_env
from dovetail.learn.config import TrainConfig
from dovetail.learn.export import export_policy
from dovetail.learn.learner_config import ALGORITHMS
from dovetail.learn.policy import Policy
from dovetail.learn.policy_env import TRAINED_IN, policy_settings

TOLERANCE = 1e-5
"""Largest difference of an action, of a range of 2."""


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_numpy_gives_the_same_actions_as_the_learner(algorithm, small, rng):
    config: TrainConfig = replace(small, algorithm=algorithm, steps=120)
    env = make_vec_env(config)
    model = make_model(config, env)
    model.learn(config.steps)
    path = export_policy(model, config, env.envs[0], wall_time=1.0).save(config.out)
    policy = Policy.load(path)
    observations = rng.uniform(-3.0, 3.0, (100, 14)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    actions = np.array([policy(observation) for observation in observations])
    np.testing.assert_allclose(actions, expected, atol=TOLERANCE, rtol=0.0)
    assert np.ptp(actions, axis=0).min() > 1e-3
    policy.require_env(config.env, config.env_options())
    env.close()


def test_the_sidecar_says_what_is_needed_to_use_and_repeat_the_policy(small):
    config = replace(small, algorithm="ppo", steps=1, stack=1)
    env = make_vec_env(config)
    model = make_model(config, env)
    metadata = export_policy(model, config, env.envs[0], wall_time=1.0).metadata
    options = config.env_options()
    # What is declared is of the arm that was trained on, not of the next one.
    assert metadata["env"] == {k: v for k, v in options.items() if k not in DECLARED}
    assert policy_settings(metadata).keys() >= metadata["env"].keys() - set(TRAINED_IN)
    assert metadata["observation"]["size"] == 14 + 14 + 4
    assert metadata["action"]["axes"] == ["X", "Y", "Z", "A"]
    assert metadata["action"]["scale"] == [4.0, 4.0, 4.0, 0.2]
    assert metadata["provenance"]["command"] == config.command()
    assert metadata["provenance"]["versions"]["jax"]
    env.close()
