"""A policy with a memory: the same numbers as JAX and PyTorch, and whole files."""

import json

import numpy as np
import pytest

from dovetail.errors import PolicyError
from dovetail.learn.fine_tune import load_start
from dovetail.learn.gru import Gru
from dovetail.learn.policy import Policy
from extras import need

TOLERANCE = 1e-5
"""Largest difference of an action, of a range of 2."""
STEPS = 200
UNITS = 24


def remembering(policy: Policy, gru: Gru, before: int) -> Policy:
    """Return a policy 14 -> 8 -> 4 with a GRU before one of its layers."""
    rng = np.random.default_rng(3)
    sizes = [(14, 8), (8, 4)]
    sizes[before] = (gru.units, sizes[before][1])
    layers = [
        (rng.normal(size=s).astype(np.float32), rng.normal(size=s[1]).astype("f4"))
        for s in sizes
    ]
    network = {
        "layers": [list(s) for s in sizes],
        "activation": "relu",
        "output": "tanh",
        "memory": gru.describe() | {"before": before},
    }
    return Policy(layers, policy.metadata | {"network": network}, gru)


def random_gru(rng, inputs=14, units=UNITS) -> Gru:
    shapes = ((inputs, 3 * units), (units, 3 * units), (3 * units,), (units,))
    return Gru(*(0.5 * rng.normal(size=shape) for shape in shapes))


@pytest.mark.parametrize("before", [0, 1])
def test_a_random_gru_gives_the_actions_of_jax(policy, rng, before):
    need("sbx")
    import jax
    from flax import linen

    inputs = (14, 8)[before]
    cell = linen.GRUCell(UNITS)
    state = cell.initialize_carry(jax.random.PRNGKey(0), (inputs,))
    params = cell.init(jax.random.PRNGKey(1), state, np.zeros(inputs))["params"]
    params = jax.tree.map(lambda p: p + 0.3 * rng.normal(size=p.shape), params)
    mine = remembering(policy, Gru.from_flax(params), before)
    observations = rng.uniform(-3.0, 3.0, (STEPS, 14)).astype(np.float32)
    (first, first_bias), (last, last_bias) = mine.layers
    for episode in range(2):
        carry = state
        mine.reset()
        actions = []
        for i, observation in enumerate(observations[episode:]):
            x = observation
            if before == 1:
                x = np.maximum(x @ first + first_bias, 0.0)
            carry, x = cell.apply({"params": params}, carry, x)
            if before == 0:
                x = np.maximum(x @ first + first_bias, 0.0)
            expected = np.tanh(x @ last + last_bias)
            actions.append(mine(observation))
            np.testing.assert_allclose(actions[-1], expected, atol=TOLERANCE, rtol=0.0)
            assert actions[-1].dtype == np.float32, i
        assert np.ptp(actions, axis=0).min() > 1e-2


def test_a_random_gru_gives_the_states_of_pytorch(rng):
    need("sbx")
    import torch

    theirs = torch.nn.GRU(14, UNITS)
    mine = Gru.from_torch(theirs.state_dict())
    inputs = rng.uniform(-3.0, 3.0, (STEPS, 14)).astype(np.float32)
    with torch.no_grad():
        expected, _ = theirs(torch.from_numpy(inputs))
    states = np.array([mine.step(x) for x in inputs])
    np.testing.assert_allclose(states, expected.numpy(), atol=TOLERANCE, rtol=0.0)


def test_reset_begins_an_episode_and_a_step_remembers(policy, rng):
    mine = remembering(policy, random_gru(rng), 0)
    observation = rng.normal(size=14)
    first, second = mine(observation), mine(observation)
    assert np.abs(first - second).max() > 1e-3
    mine.reset()
    np.testing.assert_array_equal(mine(observation), first)


def test_a_policy_without_memory_takes_reset_as_well(policy, rng):
    observation = rng.normal(size=14)
    action = policy(observation)
    policy.reset()
    np.testing.assert_array_equal(policy(observation), action)


def test_a_saved_memory_is_the_same_and_of_version_2(policy, rng, tmp_path):
    mine = remembering(policy, random_gru(rng, inputs=8), 1)
    weights = mine.save(tmp_path / "gru")
    assert json.loads(weights.with_suffix(".json").read_text())["version"] == 2
    policy.save(tmp_path / "plain")
    assert json.loads((tmp_path / "plain.json").read_text())["version"] == 1
    again = Policy.load(weights)
    for observation in rng.normal(size=(5, 14)):
        np.testing.assert_array_equal(again(observation), mine(observation))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (None, "the weights have the memory .*JSON file says None"),
        ({"units": 7}, "the weights have the memory"),
        ({"kind": "lstm"}, "the weights have the memory"),
        ({"before": 2}, "before layer '2'; allowed: 0 to 1"),
        ({"before": True}, "before layer 'True'"),
        ({"before": 1}, "memory takes 14 numbers, the layer before it gives 8"),
    ],
)
def test_a_memory_that_does_not_fit_its_description_is_refused(
    policy, rng, change, words
):
    mine = remembering(policy, random_gru(rng), 0)
    memory = change and mine.metadata["network"]["memory"] | change
    network = mine.metadata["network"] | {"memory": memory}
    with pytest.raises(PolicyError, match=words):
        Policy(mine.layers, mine.metadata | {"network": network}, mine.memory)


def test_a_described_memory_without_weights_is_refused(policy):
    network = policy.metadata["network"] | {"memory": {"kind": "gru", "before": 0}}
    with pytest.raises(PolicyError, match="the weights have the memory None"):
        Policy(policy.layers, policy.metadata | {"network": network})


def test_weights_of_a_gru_that_do_not_fit_are_refused(rng):
    gru = random_gru(rng)
    for i in range(4):
        cut = [array[:-1] if i == j else array for j, array in enumerate(gru.weights)]
        if i == 0:
            cut[0] = gru.weights[0][:, :-1]
        with pytest.raises(PolicyError, match="the policy's GRU has weights of shapes"):
            Gru(*cut)
    bad = [array.copy() for array in gru.weights]
    bad[1][0, 0] = np.nan
    with pytest.raises(PolicyError, match="recurrent that are not finite"):
        Gru(*bad)


def test_no_training_starts_from_a_policy_with_a_memory(policy, rng, small, tmp_path):

    weights = remembering(policy, random_gru(rng), 0).save(tmp_path / "gru")
    config = small.having(from_policy=str(weights))
    with pytest.raises(PolicyError, match="it has a memory"):
        load_start(config)
