"""SAC's networks: drawn as flax draws them, and with the values of SBX's."""

import numpy as np
import pytest

from dovetail.learn.algorithms import limit_threads
from extras import need

limit_threads()
need("sbx")

import jax  # noqa: E402
from sbx.common.policies import VectorCritic  # noqa: E402

from dovetail.learn.networks import Critics, SbxActor  # noqa: E402

SHAPE = {"net_arch": [64, 32], "use_layer_norm": True}


@pytest.fixture(scope="module")
def inputs():
    rng = np.random.default_rng(0)
    return [rng.normal(size=(3, size)).astype(np.float32) for size in (14, 4)]


@pytest.fixture(scope="module")
def drawn(inputs):
    keys = {"params": jax.random.PRNGKey(3), "dropout": jax.random.PRNGKey(4)}
    return Critics(**SHAPE).init(keys, *inputs)


def leaves(tree):
    return {
        "/".join(part.key for part in path): np.asarray(leaf)
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }


def test_weights_are_lecuns_and_biases_are_zero(drawn):
    values = leaves(drawn)
    kernels = [name for name in values if name.endswith("kernel")]
    assert len(kernels) == 6
    for name, value in values.items():
        assert value.dtype == np.float32
        if name not in kernels:
            assert (value == (1.0 if name.endswith("scale") else 0.0)).all()
            continue
        spread = 1.0 / np.sqrt(value.shape[0])
        assert np.abs(value).max() <= 2.0 * spread / 0.8796
        tolerance = 4.0 / np.sqrt(value.size)  # four standard errors, or more
        assert np.abs(value.mean()) <= tolerance * spread
        assert value.std() == pytest.approx(spread, rel=tolerance)
    one, other = (values[name] for name in kernels if "Dense_1" in name)
    assert (one != other).all()


def test_a_key_decides_the_numbers(inputs, drawn):
    keys = {"params": jax.random.PRNGKey(3), "dropout": jax.random.PRNGKey(5)}
    again = leaves(Critics(**SHAPE).init(keys, *inputs))
    for name, value in leaves(drawn).items():
        np.testing.assert_array_equal(value, again[name])
    actors = [
        leaves(
            SbxActor(net_arch=[8], action_dim=4).init(jax.random.PRNGKey(i), inputs[0])
        )
        for i in (3, 3, 4)
    ]
    name = next(name for name in actors[0] if name.endswith("Dense_0/kernel"))
    assert (actors[0][name] == actors[1][name]).all()
    assert (actors[0][name] != actors[2][name]).all()


def test_the_critics_say_what_sbxs_say(inputs, drawn):
    ours = drawn["params"]
    pairs = [ours[name] for name in sorted(ours)]
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *pairs)
    reference = VectorCritic(**SHAPE)
    shapes = jax.eval_shape(reference.init, jax.random.PRNGKey(0), *inputs)["params"]
    (name,) = shapes
    wanted = jax.jit(reference.apply)({"params": {name: stacked}}, *inputs)
    found = jax.jit(Critics(**SHAPE).apply)(drawn, *inputs)
    assert found.shape == (2, 3, 1)
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-5)
