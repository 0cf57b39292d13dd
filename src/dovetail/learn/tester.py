"""Tests a model while it is trained, in environments beside those that it trains in."""

from collections.abc import Callable
from typing import Any

from dovetail.learn.algorithms import make_vec_env
from dovetail.learn.assess import TestEnvs, play
from dovetail.learn.best_actor import BestActor
from dovetail.learn.config import TrainConfig
from dovetail.learn.early_stopping import EarlyStopping
from dovetail.learn.export import current_policy


class Tester:
    """Makes the tests that a run's stop asks for."""

    def __init__(
        self,
        model: Any,
        best: BestActor | None,
        config: TrainConfig,
        stop: EarlyStopping,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Take what is tested; nothing is built before the first test.

        Args:
            model: SBX algorithm.
            best: Keeps the actor that a run from a policy ends with.
            config: Settings of the run.
            stop: Judges.
            check: Called at every step of a test; raises KeyboardInterrupt to end it.
        """
        self._model, self._best = model, best
        self._config, self._stop, self._check = config, stop, check
        self._env: Any = None

    def is_passed(self) -> bool:
        """Make a test of the actor that the run would end with."""
        if self._env is None:
            self._env = make_vec_env(self._config)
        actor = None if self._best is None else self._best.chosen
        policy = current_policy(self._model, self._config, actor)
        stage = stage_of(self._env)._replace(check=self._check)
        step = int(self._model.num_timesteps)
        return self._stop.is_passed(
            step,
            (
                [episode.success for episode in play(policy, seeds, stage)]
                for seeds in self._stop.seeds(step)
            ),
        )

    def close(self) -> None:
        """Close the environments."""
        if self._env is not None:
            self._env.close()


def stage_of(env: Any) -> TestEnvs:
    """Return a vector environment of `make_vec_env` to play episodes in."""
    from dovetail.learn.batch_vec_env import BatchVecEnv

    if isinstance(env, BatchVecEnv):
        return TestEnvs(env.envs, env.begin, env.drop)
    return TestEnvs(env.envs)
