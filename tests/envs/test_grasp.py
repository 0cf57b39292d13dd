"""The grasp in an environment: drawn in its range, judged by, and never seen."""

import gymnasium as gym
import numpy as np
import pytest
from rich.console import Console

from dovetail.episode import Episode
from dovetail.errors import ConfigError
from dovetail.evaluation.config import EvaluationConfig, environment_options
from dovetail.evaluation.evaluate import evaluate
from dovetail.learn.policy import Policy, find_policy
from dovetail.poses import UNMOVED, rotation_error
from dovetail.tasks.grasp import Grasp

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def test_draws_fill_their_range_and_no_more():
    rng = np.random.default_rng(0)
    grasps = [Grasp(0.002, 0.04).draw(rng) for _ in range(500)]
    shifts = np.array([g.position for g in grasps])
    turns = np.array([rotation_error(g.quat_wxyz, IDENTITY) for g in grasps])
    for drawn, most in ((shifts, 0.002), (turns, 0.04)):
        assert np.abs(drawn).max() <= most * (1 + 1e-9)
        assert (drawn.max(axis=0) > 0.9 * most).all()
        assert (drawn.min(axis=0) < -0.9 * most).all()


def test_no_error_draws_nothing():
    rng = np.random.default_rng(0)
    assert Grasp().draw(rng) is UNMOVED
    assert rng.uniform() == np.random.default_rng(0).uniform()


def make(**settings):
    return gym.make("dovetail/PegInHole-v0", **settings).unwrapped


def test_success_is_judged_by_the_part_and_seen_by_the_tool():
    env = make(grasp_error=0.003, grasp_turn=0.05)
    plain = make()
    seen, info = env.reset(seed=4)
    same, told = plain.reset(seed=4)
    grasp = env.grasp
    assert np.abs(grasp.position).max() > 0.0
    np.testing.assert_array_equal(seen, same)
    np.testing.assert_array_equal(info["position_error"], told["position_error"])
    # The tool points down: what is further out along its z is lower in the world.
    assert info["depth"] - told["depth"] == pytest.approx(
        grasp.position[2], abs=1e-5 + 0.3 * np.abs(grasp.position[:2]).sum()
    )
    assert info["depth"] != told["depth"]


def test_a_part_that_was_displaced_is_put_back():
    env = make(grasp_error=0.002)
    env.reset(seed=0)
    first = env.grasp
    env.reset()
    assert (first.position != env.grasp.position).any()


def test_ranges_are_kept():
    with pytest.raises(ConfigError):
        make(grasp_error=0.5)
    with pytest.raises(ConfigError):
        make(grasp_turn=-0.1)


def test_an_evaluation_may_hold_the_part_otherwise_than_the_training(tmp_path):
    config = EvaluationConfig(
        policy="peg_square",
        plant="mujoco",
        tries=1,
        max_steps=2,
        grasp_error=0.002,
        out=tmp_path / "out",
    )
    options = environment_options(
        config, Policy.load(find_policy("peg_square")).metadata
    )
    assert options["grasp_error"] == 0.002
    assert "grasp_turn" not in options


def test_the_log_of_a_try_says_where_the_part_was(tmp_path):
    config = EvaluationConfig(
        policy="peg_square",
        plant="mujoco",
        tries=1,
        max_steps=2,
        grasp_error=0.002,
        out=tmp_path / "out",
    )
    result = evaluate(config, Console(quiet=True))
    logs = [Episode.load(path) for path in sorted((result.folder / "logs").iterdir())]
    told = [log.metadata["grasp (m, wxyz)"] for log in logs]
    assert all(len(numbers) == 7 for numbers in told)
    assert len({tuple(numbers) for numbers in told}) == 3
