"""Many environments at once: Gymnasium's vector environment over a `BatchArm`."""

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker
from numpy.typing import NDArray

from dovetail.arms.batch_arm import BatchArm
from dovetail.control.period import POLICY_PERIOD
from dovetail.envs.contact_env import ContactEnv
from dovetail.errors import ConfigError

_PLAIN_STEPS = (
    *(gymnasium.Wrapper.step, gymnasium.ObservationWrapper.step),
    *(gymnasium.RewardWrapper.step, OrderEnforcing.step, PassiveEnvChecker.step),
)
"""These hand an action on as it is, before they do anything else."""


class BatchVectorEnv(SyncVectorEnv):
    """Steps environments of this process at once, each as it would be alone.

    It gives the numbers of `SyncVectorEnv` over the same environments, bit for bit;
    autoreset is NEXT_STEP. The control cycles run on several cores. What a step does in
    Python and what a reset does are done meanwhile, one environment after the other.
    """

    def __init__(
        self,
        env_fns: Sequence[Callable[[], gymnasium.Env]],
        threads: int | None = None,
    ) -> None:
        """Build the environments and start the threads.

        Args:
            env_fns: Each builds a `ContactEnv` on MuJoCo in this process, with wrappers
                or without. Where a wrapper or a derived class has a `step` of its own,
                environments are stepped one after the other, which a warning says: what
                they do before the arm moves must come first.
            threads: That simulate, the calling one among them; None is one for each
                core that this process may use.

        Raises:
            ConfigError: An environment that cannot be in a batch.
        """
        super().__init__(env_fns)
        try:
            self._cores = [_core_of(env) for env in self.envs]
            self.batch = BatchArm([core.arm for core in self._cores], threads)
        except BaseException:
            super().close_extras()
            raise
        own = {name for env in self.envs if (name := _own_step(env))}
        self._is_begun_early = not own
        for name in sorted(own):
            gymnasium.logger.warn(
                f"{name} has a step of its own, so that its environments are stepped "
                "one after the other; to use several cores, override begin_step, or "
                "take a reward or observation wrapper"
            )

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[
        NDArray[np.float32],
        NDArray[np.float64],
        NDArray[np.bool_],
        NDArray[np.bool_],
        dict[str, Any],
    ]:
        """Follow one action per environment for 50 ms; one that has ended starts anew.

        Raises:
            ConfigError: An action is not one finite number for each commanded axis.
            PlantError: A simulation diverged. As after any error, a note says in which
                environment; nothing runs any more; reset before the next step.
        """
        infos: list[dict[str, Any]] = [{}] * self.num_envs
        rows = list(actions)  # the same object twice is compared at once
        over = np.flatnonzero(self._autoreset_envs).tolist()
        going = np.flatnonzero(~self._autoreset_envs).tolist()
        index = 0
        try:
            for index in going if self._is_begun_early else ():
                target = self._cores[index].begin_step(rows[index])
                self.batch.begin(index, target, POLICY_PERIOD)
            for index in over:  # while the others move
                self._env_obs[index], infos[index] = self.envs[index].reset()
                self._rewards[index] = 0.0
                self._terminations[index] = self._truncations[index] = False
            for index in going:
                (
                    self._env_obs[index],
                    self._rewards[index],
                    self._terminations[index],
                    self._truncations[index],
                    infos[index],
                ) = self.envs[index].step(rows[index])
        except BaseException as error:
            error.add_note(f"in environment {index} of {self.num_envs}, from 0")
            self.batch.drop()
            raise
        self._observations = np.array(self._env_obs)
        self._autoreset_envs = self._terminations | self._truncations
        return (
            self._observations.copy(),
            self._rewards.copy(),
            self._terminations.copy(),
            self._truncations.copy(),
            self._gather(infos),
        )

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads, and close the environments."""
        self.batch.close()
        super().close_extras(**kwargs)

    def _gather(self, infos: list[dict[str, Any]]) -> dict[str, Any]:
        """Put infos together as Gymnasium does, at once where keys are the same."""
        first = infos[0]
        gathered: dict[str, Any] = {}
        if all(info.keys() == first.keys() for info in infos):
            gathered = self._columns(first, infos)
        if not gathered:
            for index, info in enumerate(infos):
                gathered = self._add_info(gathered, info, index)
        return gathered

    def _columns(
        self, first: dict[str, Any], infos: list[dict[str, Any]]
    ) -> dict[str, Any]:
        """Return a column per key; empty if a key has no numbers."""
        columns: dict[str, Any] = {}
        for key, value in first.items():
            values = [info[key] for info in infos]
            if isinstance(value, np.ndarray) and value.ndim and key != "final_obs":
                shape = self.num_envs, *value.shape
                columns[key] = np.concatenate(values, dtype=value.dtype).reshape(shape)
            elif isinstance(value, (bool, int, float, np.number)):
                columns[key] = np.array(values, dtype=type(value))
            else:
                return {}
            columns[f"_{key}"] = np.ones(self.num_envs, dtype=np.bool_)
        return columns


def _core_of(env: gymnasium.Env) -> ContactEnv:
    core = env.unwrapped
    if isinstance(core, ContactEnv):
        return core
    raise ConfigError(
        f"{type(core).__name__} is no ContactEnv and cannot be stepped in a batch; "
        "take gymnasium's SyncVectorEnv"
    )


def _own_step(env: gymnasium.Env) -> str | None:
    """Name the outermost layer whose step may do something before the arm moves."""
    while isinstance(env, gymnasium.Wrapper):
        if type(env).step not in _PLAIN_STEPS:
            return type(env).__name__
        env = env.env
    return None if type(env).step is ContactEnv.step else type(env).__name__
