"""A small policy file whose size fits the default task."""

import gymnasium as gym
import numpy as np
import pytest

from dovetail.learn.policy import Policy
from dovetail.learn.spaces import describe_spaces


@pytest.fixture(scope="session")
def still_policy(tmp_path_factory):
    """Path of a policy that always answers 0: it never inserts."""
    layers = [(np.zeros((14, 4), dtype=np.float32), np.zeros(4, dtype=np.float32))]
    metadata = {
        "network": {"layers": [[14, 4]], "activation": "relu", "output": "tanh"},
        "env_id": "dovetail/PegInHole-v0",
        "env": {"plant": "mujoco", "max_steps": 5, "stack": 0},
        "provenance": {},
    }
    env = gym.make("dovetail/PegInHole-v0", disable_env_checker=True)
    metadata |= describe_spaces(env)
    env.close()
    folder = tmp_path_factory.mktemp("policy")
    return Policy(layers, metadata).save(folder / "still")
