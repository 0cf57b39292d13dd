"""Guided policy search: its maths by maths, and a tiny training end to end."""

import json
import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.learn.checkpoint import list_checkpoints
from dovetail.learn.config import TrainConfig
from dovetail.learn.gps.cost import expand
from dovetail.learn.gps.local_models import fit, neighbour_weights
from dovetail.learn.gps.lqr import (
    Controller,
    Cost,
    Dynamics,
    divergence,
    gaussian_divergence,
    improve,
    solve,
)
from dovetail.learn.one_run import train_one
from dovetail.learn.policy import Policy
from dovetail.learn.run_folder import CHECKPOINTS

STATES, ACTIONS = 3, 2


def some_matrix(rng, size):
    """Return a symmetric positive definite matrix."""
    root = rng.normal(size=(size, size))
    return root @ root.T + np.eye(size)


def system(rng, rollouts=1, steps=4):
    """Return linear dynamics, a cost and a policy, each of random numbers."""
    size = STATES + ACTIONS
    shape = rollouts, steps
    slope = 0.5 * rng.normal(size=(*shape, STATES, size))
    noise = np.broadcast_to(0.01 * np.eye(STATES), (*shape, STATES, STATES))
    dynamics = Dynamics(slope, 0.1 * rng.normal(size=(*shape, STATES)), noise)
    curvature = [
        [some_matrix(rng, size) for _ in range(steps)] for _ in range(rollouts)
    ]
    cost = Cost(
        np.array(curvature),
        rng.normal(size=(*shape, size)),
        np.array([some_matrix(rng, STATES) for _ in range(rollouts)]),
        rng.normal(size=(rollouts, STATES)),
    )
    spread = np.broadcast_to(0.3 * np.eye(ACTIONS), (*shape, ACTIONS, ACTIONS))
    policy = Controller(
        0.1 * rng.normal(size=(*shape, ACTIONS, STATES)),
        0.1 * rng.normal(size=(*shape, ACTIONS)),
        spread,
    )
    return dynamics, cost, policy


def total(dynamics, cost, actions):
    """Return the cost of a sequence of actions from the state 0, without noise."""
    x, cost_so_far = np.zeros(STATES), 0.0
    for t, u in enumerate(actions):
        z = np.concatenate([x, u])
        cost_so_far += 0.5 * z @ cost.curvature[0, t] @ z + cost.slope[0, t] @ z
        x = dynamics.slope[0, t] @ z + dynamics.offset[0, t]
    return cost_so_far + 0.5 * x @ cost.final_curvature[0] @ x + cost.final_slope[0] @ x


def played(dynamics, controller):
    x, actions = np.zeros(STATES), []
    for t in range(controller.offset.shape[1]):
        u = controller.gain[0, t] @ x + controller.offset[0, t]
        actions.append(u)
        x = dynamics.slope[0, t] @ np.concatenate([x, u]) + dynamics.offset[0, t]
    return np.array(actions)


def test_far_from_the_end_the_gain_is_that_of_the_algebraic_riccati_equation(rng):
    A = np.eye(STATES) + 0.1 * rng.normal(size=(STATES, STATES))
    B = rng.normal(size=(STATES, ACTIONS))
    Q, R = some_matrix(rng, STATES), some_matrix(rng, ACTIONS)
    P, K = Q, np.zeros((ACTIONS, STATES))
    for _ in range(500):
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        P = Q + A.T @ P @ (A - B @ K)
    residual = (
        Q + A.T @ P @ A - A.T @ P @ B @ np.linalg.inv(R + B.T @ P @ B) @ (B.T @ P @ A)
    )
    np.testing.assert_allclose(P, residual, rtol=1e-9)
    steps, size = 200, STATES + ACTIONS
    curvature = np.zeros((size, size))
    curvature[:STATES, :STATES], curvature[STATES:, STATES:] = Q, R
    dynamics = Dynamics(
        np.broadcast_to(np.column_stack([A, B]), (1, steps, STATES, size)),
        np.zeros((1, steps, STATES)),
        np.zeros((1, steps, STATES, STATES)),
    )
    cost = Cost(
        np.broadcast_to(curvature, (1, steps, size, size)),
        np.zeros((1, steps, size)),
        np.zeros((1, STATES, STATES)),
        np.zeros((1, STATES)),
    )
    found = solve(dynamics, cost)
    np.testing.assert_allclose(found.gain[0, 0], -K, rtol=1e-8)
    np.testing.assert_allclose(
        found.covariance[0, 0], np.linalg.inv(R + B.T @ P @ B), rtol=1e-8
    )


def test_no_sequence_of_actions_costs_less_than_the_regulators(rng):
    dynamics, cost, _ = system(rng)
    best = played(dynamics, solve(dynamics, cost))
    least = total(dynamics, cost, best)
    for _ in range(200):
        other = best + rng.normal(size=best.shape) * 10.0 ** rng.uniform(-4, 0)
        assert total(dynamics, cost, other) > least


def test_the_divergence_is_the_mean_log_ratio_of_what_is_drawn(rng):
    dynamics, cost, policy = system(rng)
    controller = solve(dynamics, cost)
    count, said = 200_000, divergence(controller, policy, dynamics)[0]
    x, logs = np.zeros((count, STATES)), np.zeros(count)
    for t in range(policy.offset.shape[1]):
        mean = x @ controller.gain[0, t].T + controller.offset[0, t]
        root = np.linalg.cholesky(controller.covariance[0, t])
        u = mean + rng.normal(size=mean.shape) @ root.T
        other = x @ policy.gain[0, t].T + policy.offset[0, t]
        logs += log_density(u - mean, controller.covariance[0, t])
        logs -= log_density(u - other, policy.covariance[0, t])
        x = np.column_stack([x, u]) @ dynamics.slope[0, t].T + dynamics.offset[0, t]
        x = x + rng.normal(size=x.shape) * 0.1
    assert said == pytest.approx(logs.mean(), abs=6.0 * logs.std() / np.sqrt(count))


def log_density(apart, covariance):
    squares = np.einsum("pi,ij,pj->p", apart, np.linalg.inv(covariance), apart)
    return -0.5 * (squares + np.linalg.slogdet(2.0 * np.pi * covariance)[1])


def test_normal_distributions_diverge_as_in_one_dimension():
    apart = np.array([[0.0], [3.0]])
    found = gaussian_divergence(apart, np.array([[4.0]]), np.array([[1.0]]))
    expected = (4.0 - 1.0 - np.log(4.0)) / 2.0
    np.testing.assert_allclose(found, [expected, expected + 4.5])
    same = np.array([[2.0, 0.3], [0.3, 1.0]])
    assert gaussian_divergence(np.zeros((1, 2)), same, same) == pytest.approx(0.0)


def test_the_step_uses_the_divergence_that_it_may_and_no_more(rng):
    dynamics, cost, policy = system(rng, rollouts=3)
    bound = np.array([0.01, 0.3, 2.0])
    better = improve(dynamics, cost, policy, bound)
    np.testing.assert_allclose(divergence(better, policy, dynamics), bound, rtol=1e-3)
    assert (divergence(better, policy, dynamics) <= bound).all()


def test_a_step_that_may_go_further_costs_less(rng):
    dynamics, cost, policy = system(rng)
    costs = [
        total(dynamics, cost, played(dynamics, improve(dynamics, cost, policy, bound)))
        for bound in (np.array([1e-6]), np.array([0.1]), np.array([10.0]))
    ]
    assert costs[0] > costs[1] > costs[2]
    stays = played(dynamics, improve(dynamics, cost, policy, np.array([1e-9])))
    np.testing.assert_allclose(stays, played(dynamics, policy), atol=1e-3)


def test_a_linear_system_is_found_again(rng):
    slope = rng.normal(size=(STATES, STATES + ACTIONS))
    offset = rng.normal(size=STATES)
    inputs = rng.normal(size=(60, STATES + ACTIONS)) * [1.0, 1e-3, 1e2, 1.0, 0.1]
    found = fit(inputs, inputs @ slope.T + offset, inputs[:4], np.ones((4, 60)))
    np.testing.assert_allclose(
        found.slope, np.broadcast_to(slope, (4, *slope.shape)), rtol=1e-3
    )
    np.testing.assert_allclose(found.value, inputs[:4] @ slope.T + offset, rtol=1e-3)
    assert np.abs(found.covariance).max() < 1e-6


def test_what_the_fit_leaves_is_the_noise(rng):
    inputs = rng.normal(size=(4000, 3))
    noise = rng.normal(size=(4000, 2)) @ np.array([[0.2, 0.0], [0.1, 0.3]])
    outputs = inputs @ rng.normal(size=(3, 2)) + noise
    found = fit(inputs, outputs, np.zeros((1, 3)), np.ones((1, 4000)))
    expected = noise.T @ noise / 4000
    np.testing.assert_allclose(found.covariance[0], expected, rtol=0.02)


def test_neighbours_give_each_place_its_own_slope(rng):
    inputs = rng.uniform(-1.0, 1.0, size=(400, 1))
    outputs = np.abs(inputs)  # as at a contact
    at = np.array([[-0.5], [0.5]])
    weights = neighbour_weights(inputs, at, 40)
    assert weights.max() <= 1.0
    found = fit(inputs, outputs, at, weights)
    np.testing.assert_allclose(found.slope[:, 0, 0], [-1.0, 1.0], atol=0.1)


def test_the_parabola_lies_above_the_cost_and_touches_it(rng):
    x = rng.normal(size=(1, 2, 3))
    weight, smooth = np.array([1.0, 2.0, 0.0]), np.array([0.1, 0.2, 1.0])
    cost = expand(x, np.zeros((1, 1, 2)), weight, smooth, np.ones((1, 1)))

    def true(state):
        return float((weight * np.sqrt(state**2 + smooth**2)).sum())

    for away in (*1e-6 * np.eye(3), *rng.normal(size=(50, 3))):
        z = np.concatenate([away, np.zeros(2)])
        rise = cost.slope[0, 0] @ z + z @ cost.curvature[0, 0] @ z / 2.0
        assert rise >= true(x[0, 0] + away) - true(x[0, 0]) - 1e-12
        if np.abs(away).max() < 1e-5:
            assert rise == pytest.approx(true(x[0, 0] + away) - true(x[0, 0]), abs=1e-9)


@pytest.fixture
def tiny(small):
    """Settings of a search of 300 steps; a rollout ends before its episode."""
    return replace(
        small, algorithm="gps", conditions=2, horizon=20, updates_per_step=1.0
    )


def test_a_training_ends_with_a_policy_of_the_usual_format(tiny):
    result = train_one(tiny, lambda status: None)
    assert result.steps == tiny.steps
    policy = Policy.load(result.policy)
    assert policy.metadata["provenance"]["algorithm"] == "gps"
    network = policy.metadata["network"]
    assert (network["activation"], network["output"]) == ("relu", "tanh")
    assert [list(w.shape) for w, _ in policy.layers] == [[14, 16], [16, 16], [16, 4]]
    rows = (tiny.folder / "progress.csv").read_text().splitlines()
    lengths = [int(row.split(",")[2]) for row in rows[1:]]
    assert lengths
    assert set(lengths) == {20}
    assert all(float(row.split(",")[1]) < 0.0 for row in rows[1:])


def test_a_search_that_is_cut_short_goes_on(tiny, monkeypatch):
    from dovetail.envs.contact_env import ContactEnv

    step, taken = ContactEnv.step, []

    def interrupted_once(self, action):
        taken.append(1)
        if len(taken) == 150:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.2)
        return step(self, action)

    monkeypatch.setattr(ContactEnv, "step", interrupted_once)
    with pytest.raises(KeyboardInterrupt):
        train_one(tiny, lambda status: None)
    newest = list_checkpoints(tiny.folder / CHECKPOINTS)[-1]
    assert 150 <= int(newest.stem.removeprefix("step-")) <= 160
    train_one(replace(tiny, resume=True), lambda status: None)
    policy = json.loads((tiny.folder / "policy.json").read_text())
    assert policy["provenance"]["steps"] == tiny.steps


def test_a_checkpoint_holds_all_that_the_search_knows(tiny):
    from dovetail.learn.checkpoint import load_checkpoint
    from dovetail.learn.one_run import prepared

    train_one(tiny, lambda status: None)
    newest = list_checkpoints(tiny.folder / CHECKPOINTS)[-1]
    with prepared(replace(tiny, out=tiny.folder.parent / "other")) as run:
        load_checkpoint(newest, run.model, tiny.seed)
        search = run.model.policy.search_state
        count = len(search.transitions.state)
        assert 0 < count <= tiny.steps
        assert search.transitions.state.shape == (count, 7)
        assert search.lessons.iteration.max() > 1
        assert np.linalg.eigvalsh(search.covariance).min() > 0.0
        seen = search.transitions.seen[:3]
        learned = Policy.load(tiny.folder / "policy.safetensors")
        for one, action in zip(seen, run.model.policy.actions(seen), strict=True):
            np.testing.assert_allclose(learned(one), action, atol=1e-5)


@pytest.mark.parametrize(
    "setting", [{"conditions": 4}, {"horizon": 50}, {"kl_step": 3.0}]
)
def test_its_settings_are_refused_with_another_algorithm(setting):
    (name,) = setting
    with pytest.raises(ConfigError, match=f"{name} .* --algorithm gps"):
        TrainConfig(**setting)
    assert vars(TrainConfig(algorithm="gps", **setting))[name] == setting[name]


@pytest.mark.parametrize(
    "setting",
    [
        {"from_policy": "peg_square"},
        {"demos": ("logs",)},
        {"teacher": "corner"},
        {"script": "corner"},
        {"informed": True},
    ],
)
def test_a_start_that_it_cannot_use_is_refused(setting):
    (name,) = setting
    with pytest.raises(ConfigError, match=name):
        TrainConfig(algorithm="gps", **setting)
