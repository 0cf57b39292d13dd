"""A run that starts from a policy acts like it, and keeps it until critics know."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from dovetail.errors import ConfigError, PolicyError
from dovetail.learn.algorithms import ACTOR_SHARE, make_model, make_vec_env
from dovetail.learn.best_actor import GROUP, BestActor
from dovetail.learn.checkpoint import load_checkpoint, save_checkpoint
from dovetail.learn.config import TrainConfig
from dovetail.learn.export import export_policy
from dovetail.learn.fine_tune import START_STD, load_start, require_fit, start_from
from dovetail.learn.policy import Policy
from dovetail.learn.train import train

TOLERANCE = 1e-5
"""Largest difference of an action, of a range of 2."""


@pytest.fixture
def make(small, tmp_path):
    """Builds a model, and the file of a policy, of other random weights each time."""
    environments = []

    def make(seed=0, **changes):
        config = replace(small, seed=seed, **changes)
        env = make_vec_env(config)
        environments.append(env)
        model = make_model(config, env)
        path = tmp_path / f"policy-{len(environments)}"
        policy = export_policy(model, config, env.envs[0], wall_time=0.0)
        return model, config, policy.save(path)

    yield make
    for env in environments:
        env.close()


def start(model, config, path):
    config = replace(config, from_policy=str(path))
    policy = load_start(config)
    require_fit(policy, config, model.get_env().envs[0])
    start_from(model, policy)
    return policy


@pytest.mark.parametrize("algorithm", ["sac", "tqc", "td3", "ddpg", "ppo"])
def test_the_first_deterministic_actions_are_the_policys(algorithm, make, rng):
    _, _, path = make(seed=1, algorithm=algorithm)
    model, config, _ = make(seed=2, algorithm=algorithm)
    observations = rng.uniform(-3.0, 3.0, (100, 14)).astype(np.float32)
    before, _ = model.predict(observations, deterministic=True)
    policy = start(model, config, path)
    actions, _ = model.predict(observations, deterministic=True)
    wanted = np.array([policy(observation) for observation in observations])
    np.testing.assert_allclose(actions, wanted, atol=TOLERANCE, rtol=0.0)
    assert np.abs(before - wanted).max() > 0.01


def test_the_policy_explores_near_what_it_knows(make, rng):
    _, _, path = make(seed=1)
    model, config, _ = make(seed=2)
    policy = start(model, config, path)
    observation = rng.uniform(-1.0, 1.0, 14).astype(np.float32)
    drawn, _ = model.predict(np.tile(observation, (4000, 1)), deterministic=False)
    spread = np.std(np.arctanh(np.clip(drawn, -0.9999, 0.9999)), axis=0)
    np.testing.assert_allclose(spread, START_STD, rtol=0.1)
    np.testing.assert_allclose(
        np.arctanh(drawn).mean(axis=0), np.arctanh(policy(observation)), atol=0.02
    )


def test_the_shipped_policy_fits_the_default_settings(make, rng):
    model, config, _ = make(net=(128, 128))
    policy = start(model, config, "peg_square")
    observations = rng.uniform(-3.0, 3.0, (100, 14)).astype(np.float32)
    actions, _ = model.predict(observations, deterministic=True)
    wanted = np.array([policy(observation) for observation in observations])
    np.testing.assert_allclose(actions, wanted, atol=TOLERANCE, rtol=0.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stack": 1}, "trained for the stack 0"),
        ({"task": "XY:force A:pose ZBC:hold"}, "trained for the task"),
        ({"net": (16, 8)}, r"add --net 16 16"),
        ({"f_scale": 2.0}, "axis X means 2 at 1 here and 4"),
        ({"algorithm": "ppo"}, "policies of ppo go on with ppo"),
        ({"env": "dovetail/RailClip-v0"}, "trained for the environment"),
    ],
)
def test_a_policy_that_does_not_fit_is_refused_with_the_remedy(make, changes, message):
    _, _, path = make()
    model, config, _ = make(**changes)
    with pytest.raises(PolicyError, match=message) as error:
        start(model, config, path)
    assert f"cannot start from {path}" in str(error.value)


def test_no_policy_of_that_name_lists_the_shipped_ones(make):
    model, config, _ = make()
    with pytest.raises(ConfigError, match=r"the shipped policies are: .*peg_square"):
        start(model, config, "nobody")


def test_crossq_cannot_start_from_a_policy():
    with pytest.raises(ConfigError, match="known: sac, tqc, td3, ddpg, ppo"):
        TrainConfig(algorithm="crossq", from_policy="peg_square")


def test_while_the_critics_learn_the_policy_stays_and_then_it_moves(make, small):
    _, _, path = make(seed=1)
    settings = {"from_policy": str(path), "eval_episodes": 0, "steps": 120}
    kept = replace(small, out=small.out / "kept", learning_starts=200, **settings)
    # No episode ends in 20 steps and no group of them in 120: nothing to go back to.
    moved = replace(small, out=small.out / "moved", learning_starts=20, **settings)
    weights = Policy.load(path).layers[0][0]
    (result,) = train(kept)
    np.testing.assert_array_equal(Policy.load(result.policy).layers[0][0], weights)
    (result,) = train(moved)
    assert np.abs(Policy.load(result.policy).layers[0][0] - weights).max() > 1e-5


def test_a_checkpoint_knows_the_actor_that_is_kept(make, tmp_path):
    import jax

    _, _, path = make(seed=1)
    first, config, _ = make(seed=2)
    start(first, config, path)
    best = BestActor(first, 0)
    kept = first.policy.actor_state
    for reward in range(GROUP):
        best.judge(1)
        best.add(float(reward))
    best.judge(1)
    first.policy.actor_state = make(seed=3)[0].policy.actor_state
    place = save_checkpoint(tmp_path / "checkpoints", first, 0.0)
    second, config, _ = make(seed=2)
    start(second, config, path)
    again = BestActor(second, 0)
    load_checkpoint(place, second, seed=2)
    assert again.kept.reward == 2.0
    assert again.kept.spread == pytest.approx(np.std(range(GROUP)))
    for state, wanted in (
        (again.kept.actor, kept),
        (second.policy.actor_state, first.policy.actor_state),
    ):
        for mine, theirs in zip(
            jax.tree.leaves(state), jax.tree.leaves(wanted), strict=True
        ):
            np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("algorithm", ["sac", "tqc", "td3", "ddpg"])
def test_an_actor_that_knows_something_learns_slower_than_its_critics(
    algorithm, make, small
):
    config = replace(small, algorithm=algorithm, from_policy="peg_square")
    model, _, _ = make(algorithm=algorithm)
    slow = make_model(config, model.get_env())
    assert slow.lr_schedule(1.0) == pytest.approx(ACTOR_SHARE * config.learning_rate)
    assert slow.qf_learning_rate == pytest.approx(config.learning_rate)


@pytest.mark.parametrize("seeds", ["1", "2"])
def test_a_missing_policy_is_refused_before_the_learning_stack_is_imported(
    seeds, tmp_path
):
    code = (
        "import sys\n"
        "from dovetail.cli import run\n"
        "if __name__ == '__main__':\n"
        f"    code = run(['train', '--from-policy', 'missing', '--seeds', '{seeds}'])\n"
        "    print(code, sorted({'jax', 'torch', 'sbx'} & set(sys.modules)))\n"
    )
    script = tmp_path / "train.py"
    script.write_text(code)
    work = tmp_path / "work"
    work.mkdir()
    done = subprocess.run(
        [sys.executable, str(script)], cwd=work, capture_output=True, text=True
    )
    assert done.stdout.splitlines()[-1] == "2 []"
    assert "no policy 'missing'" in done.stderr
    assert not list(work.iterdir())
