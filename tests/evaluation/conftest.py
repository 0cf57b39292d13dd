"""A policy that inserts without having learned: two layers written by hand."""

import numpy as np
import pytest

from dovetail.envs.registered import make
from dovetail.learn.policy import Policy
from dovetail.learn.spaces import describe_spaces

ENV = {
    "plant": "mujoco",
    "peg": "square",
    "clearance": 0.002,
    "task": "XYZ:force A:pose BC:hold",
    "stack": 0,
    "period": 0.005,
    "force_damping": 40.0,
}


def scripted_policy() -> Policy:
    """Go to the hole's axis, rise while away from it, descend on it.

    The observation holds slog(x), slog(y) at 7 and 8: the hidden layer takes their
    positive and negative parts, the output combines them.
    """
    hidden = np.zeros((14, 4), dtype=np.float32)
    hidden[7, 0], hidden[7, 1] = 1.0, -1.0
    hidden[8, 2], hidden[8, 3] = 1.0, -1.0
    output = np.zeros((4, 4), dtype=np.float32)
    output[:, 0] = [-0.8, 0.8, 0.0, 0.0]
    output[:, 1] = [0.0, 0.0, -0.8, 0.8]
    output[:, 2] = 0.6  # rise with |x| + |y|
    bias = np.array([0.0, 0.0, -1.5, 0.0], dtype=np.float32)
    layers = [(hidden, np.zeros(4, dtype=np.float32)), (output, bias)]
    shapes = [list(weight.shape) for weight, _ in layers]
    env = make("dovetail/PegInHole-v0", **ENV)
    metadata = {
        **describe_spaces(env),
        "network": {"layers": shapes, "activation": "relu", "output": "tanh"},
        "env_id": "dovetail/PegInHole-v0",
        "env": ENV,
        "provenance": {"command": "written by hand"},
    }
    env.close()
    return Policy(layers, metadata)


@pytest.fixture(scope="session")
def policy_file(tmp_path_factory):
    """Path of the scripted policy's weights."""
    return scripted_policy().save(tmp_path_factory.mktemp("policy") / "scripted")
