"""A training so small that it takes seconds, and policies of random weights."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from dovetail.learn.algorithms import limit_threads
from dovetail.learn.config import TrainConfig
from dovetail.learn.policy import Policy
from dovetail.learn.spaces import describe_spaces

limit_threads()

SMALL = {
    "steps": 300,
    "net": (16, 16),
    "batch_size": 16,
    "learning_starts": 40,
    "num_envs": 2,
    "updates_per_step": 1,
    "rollout_steps": 32,
    "max_steps": 25,
    "checkpoint_interval": 100,
    "eval_episodes": 2,
    "until": 1.0,
}


@pytest.fixture
def small(tmp_path: Path) -> TrainConfig:
    """Settings of a training of 300 steps."""
    return TrainConfig(out=tmp_path / "run", **SMALL)


@pytest.fixture
def policy(rng: np.random.Generator) -> Policy:
    """A policy 14 -> 8 -> 4 of random weights."""
    shapes = [(14, 8), (8, 4)]
    layers = [
        (
            rng.normal(size=s).astype(np.float32),
            rng.normal(size=s[1]).astype(np.float32),
        )
        for s in shapes
    ]
    metadata = {
        "network": {
            "layers": [list(s) for s in shapes],
            "activation": "relu",
            "output": "tanh",
        },
        "env_id": "dovetail/PegInHole-v0",
        "env": {"task": "XYZ:force A:pose BC:hold", "stack": 0, "peg": "square"},
        "provenance": {"seed": 0},
    }
    env = gym.make("dovetail/PegInHole-v0", disable_env_checker=True)
    metadata |= describe_spaces(env)
    env.close()
    return Policy(layers, metadata)
