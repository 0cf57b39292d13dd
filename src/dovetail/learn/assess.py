"""The evaluation that ends a training: deterministic, on episodes of its own."""

import math
from typing import Any

import gymnasium as gym
import numpy as np

from dovetail.evaluate.transfer import wilson_interval
from dovetail.learn.algorithms import derive_seed
from dovetail.learn.policy import Policy

TEST_SEED = 20_200_419
"""First number of the test episodes' seeds: the same episodes for every run."""


def assess(policy: Policy, episodes: int, env: gym.Env) -> dict[str, Any]:
    """Run a policy in the environment of its training.

    The test episodes are the same for every training seed; their seeds are hashed from
    a number of their own, so that no run trains on them.

    Args:
        policy: Any policy.
        episodes: Number of test episodes, at least 1.
        env: The environment to use, left open.

    Returns:
        Success rate with its Wilson 95 % interval, steps to insert, peak contact
        force, limit violations: ready for JSON; null where nothing was inserted, and
        for a force that the arm does not measure.
    """
    results = [_run(env, policy, derive_seed(TEST_SEED, i)) for i in range(episodes)]
    success = [r["success"] for r in results]
    steps = [r["steps"] for r in results if r["success"]]
    force = [r["force"] for r in results]
    interval = wilson_interval(sum(success), episodes)
    return {
        "episodes": episodes,
        "successes": sum(success),
        "success": sum(success) / episodes,
        "wilson_95": [round(end, 4) for end in interval],
        "steps_to_insert": {
            "median": _percentile(steps, 50),
            "p95": _percentile(steps, 95),
            "max": _percentile(steps, 100),
        },
        "contact_force_peak_N": {
            "p50": _percentile(force, 50),
            "p95": _percentile(force, 95),
            "max": _percentile(force, 100),
        },
        "limit_violations": sum(r["violations"] for r in results),
        "failed_episodes": [i for i, ok in enumerate(success) if not ok],
        "test_seed": TEST_SEED,
    }


def _run(env: gym.Env, policy: Policy, seed: int) -> dict[str, Any]:
    observation, info = env.reset(seed=seed)
    policy.reset()
    steps, force, violations, done = 0, 0.0, 0, False
    while not done:
        observation, _, ended, cut, info = env.step(policy(observation))
        steps += 1
        felt = float(info.get("contact_force_max", math.nan))
        force = float(np.maximum(force, felt))  # nan where it is not measured
        violations += int(info.get("limit_violations", 0))
        done = ended or cut
    return {
        "success": bool(info["success"]),
        "steps": steps,
        "force": force,
        "violations": violations,
    }


def _percentile(values: list[Any], q: float) -> float | None:
    if not values or np.isnan(values).any():
        return None
    return round(float(np.percentile(values, q)), 3)
