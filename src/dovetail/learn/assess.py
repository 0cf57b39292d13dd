"""The evaluation that ends a training: deterministic, on episodes of its own."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from dovetail.evaluation.transfer import wilson_interval
from dovetail.learn.algorithms import derive_seed
from dovetail.learn.policy import Actor

TEST_SEED = 20_200_419
"""First number of the test episodes' seeds: the same episodes for every run."""


class EpisodeResult(NamedTuple):
    """Result of an episode."""

    success: bool
    """The task was done."""
    steps: int
    """Policy steps of 50 ms."""
    force: float
    """Largest contact force [N]; nan where it is not measured."""
    violations: int
    """Limit violations."""


class TestEnvs(NamedTuple):
    """Environments to play episodes in; left open."""

    envs: Sequence[gym.Env]
    """Each plays one episode at a time."""
    begin: Callable[[int, NDArray[np.float32]], object] = lambda index, action: None
    """Begins a step of one of them, so that several are simulated at once."""
    drop: Callable[[], object] = lambda: None
    """Forgets the steps that were begun."""
    check: Callable[[], None] = lambda: None
    """Called after every step; raises KeyboardInterrupt to end it."""


def assess(policy: Actor, episodes: int, stage: TestEnvs) -> dict[str, Any]:
    """Run a policy in the environments of its training.

    The test episodes are the same for every training seed; their seeds are hashed from
    a number of their own, so that no run trains on them.

    Args:
        policy: Any policy.
        episodes: Number of test episodes, at least 1.
        stage: Where to play them. How many environments there are changes nothing where
            they are alike.

    Returns:
        Success rate with its Wilson 95 % interval, steps to insert, peak contact
        force, limit violations: ready for JSON; null where nothing was inserted, and
        for a force that the arm does not measure.
    """
    seeds = [derive_seed(TEST_SEED, i) for i in range(episodes)]
    results = play(policy, seeds, stage)
    success = [result.success for result in results]
    steps = [result.steps for result in results if result.success]
    force = [result.force for result in results]
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
        "limit_violations": sum(result.violations for result in results),
        "failed_episodes": [i for i, ok in enumerate(success) if not ok],
        "test_seed": TEST_SEED,
    }


def play(policy: Actor, seeds: Sequence[int], stage: TestEnvs) -> list[EpisodeResult]:
    """Play one episode for each seed, without exploration.

    Args:
        policy: Chooses actions by the newest observation alone, as one of it plays in
            all environments at the same time.
        seeds: Of the environment's reset. Number i is played in the environment i, from
            the first one again after the last.
        stage: Where to play them.

    Returns:
        How each went, in the order of the seeds.
    """
    envs = stage.envs
    numbered = list(enumerate(seeds))
    players = [
        _Player(policy, env, numbered[i :: len(envs)]) for i, env in enumerate(envs)
    ]
    results: dict[int, EpisodeResult] = {}
    try:
        while going := [p for p in enumerate(players) if p[1].is_playing()]:
            for index, player in going:
                stage.begin(index, player.choose())
            for _, player in going:
                player.step(results)
            stage.check()
    except BaseException:
        stage.drop()
        raise
    return [results[number] for number in range(len(seeds))]


class _Player:
    """A policy in one environment."""

    def __init__(
        self, policy: Actor, env: gym.Env, episodes: list[tuple[int, int]]
    ) -> None:
        self._policy, self._env = policy, env
        self._waiting = episodes[::-1]
        self._number: int | None = None

    def is_playing(self) -> bool:
        """Say whether an episode goes on; begin the next one where one has ended."""
        if self._number is None and self._waiting:
            self._start(*self._waiting.pop())
        return self._number is not None

    def _start(self, number: int, seed: int) -> None:
        self._number = number
        self._observation, _ = self._env.reset(seed=seed)
        self._policy.reset()
        self._steps, self._force, self._violations = 0, 0.0, 0

    def choose(self) -> NDArray[np.float32]:
        self._action = self._policy(self._observation)
        return self._action

    def step(self, results: dict[int, EpisodeResult]) -> None:
        """Go on by a step; note the episode where it ends."""
        self._observation, _, ended, cut, info = self._env.step(self._action)
        self._steps += 1
        felt = float(info.get("contact_force_max", math.nan))
        self._force = float(np.maximum(self._force, felt))  # nan: not measured
        self._violations += int(info.get("limit_violations", 0))
        if (ended or cut) and self._number is not None:
            results[self._number] = EpisodeResult(
                bool(info["success"]), self._steps, self._force, self._violations
            )
            self._number = None


def _percentile(values: list[Any], q: float) -> float | None:
    if not values or np.isnan(values).any():
        return None
    return round(float(np.percentile(values, q)), 3)
