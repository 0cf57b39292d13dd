"""Many environments at once: Stable-Baselines3's vector environment over a batch."""

from collections.abc import Callable
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv  # noqa: TID253

from dovetail.arms.batch_arm import BatchArm
from dovetail.control.period import POLICY_PERIOD
from dovetail.envs.unwrapped import require_contact_env


class BatchVecEnv(DummyVecEnv):
    """Gives the numbers of `DummyVecEnv`, bit for bit; control cycles run at once."""

    def __init__(
        self, env_fns: list[Callable[[], Any]], threads: int | None = None
    ) -> None:
        """Build the environments and start the threads.

        Args:
            env_fns: Each builds a `ContactEnv` on MuJoCo in this process, in wrappers
                that hand actions on as they are.
            threads: That simulate; None is one for each core that this process may use.

        Raises:
            ConfigError: An environment that cannot be in a batch.
        """
        super().__init__(env_fns)
        self._cores = [require_contact_env(env) for env in self.envs]
        self._batch = BatchArm([core.arm for core in self._cores], threads)

    def step_async(self, actions: np.ndarray) -> None:
        """Begin the steps."""
        rows: Any = list(actions)  # the same object twice is compared at once
        super().step_async(rows)
        try:
            for i, row in enumerate(rows):
                self.begin(i, row)
        except BaseException:
            self.drop()
            raise

    def begin(self, index: int, action: np.ndarray) -> None:
        """Begin the step of one environment; its `step` with this action ends it."""
        target = self._cores[index].begin_step(action)
        self._batch.begin(index, target, POLICY_PERIOD)

    def drop(self) -> None:
        """Wait for the steps that were begun, and forget what came of them."""
        self._batch.drop()

    def step_wait(self) -> Any:
        """End the steps; an environment that has ended starts anew.

        Raises:
            PlantError: A simulation diverged; says which. Nothing runs any more.
        """
        try:
            return super().step_wait()
        except BaseException:
            self.drop()
            raise

    def close(self) -> None:
        """End the threads, and close the environments."""
        self._batch.close()
        super().close()
