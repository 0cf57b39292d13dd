"""Many environments at once: Gymnasium's vector environment over a `BatchArm`."""

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit
from numpy.typing import NDArray

from dovetail.arms.batch_arm import BatchArm
from dovetail.control.period import POLICY_PERIOD
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.info_columns import InfoColumns
from dovetail.errors import ArmError, ConfigError

_PLAIN_STEPS = (
    *(gymnasium.Wrapper.step, gymnasium.ObservationWrapper.step),
    *(gymnasium.RewardWrapper.step, OrderEnforcing.step, PassiveEnvChecker.step),
    TimeLimit.step,
)
"""These hand an action on as it is, before they do anything else."""
_NO_STEPS = (gymnasium.Wrapper.step, OrderEnforcing.step, PassiveEnvChecker.step)
"""These hand on what comes back as well, once a first step was right."""


class BatchVectorEnv(SyncVectorEnv):
    """Steps environments of this process at once, each as it would be alone.

    It gives the numbers of `SyncVectorEnv` over the same environments, bit for bit;
    autoreset is NEXT_STEP. The control cycles run on several cores. What a step does in
    Python and what a reset does are done meanwhile, one environment after the other;
    observations are scaled at once.
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
        own = {name for env in self.envs if (name := _own_step(env, _PLAIN_STEPS))}
        self._is_begun_early = not own
        self._scaling = scaling = self._cores[0].scaling
        self._scales_at_once = not any(_own_step(e, _NO_STEPS) for e in self.envs)
        self._scales_at_once &= all(scaling.is_like(c.scaling) for c in self._cores)
        self._remembers = any(
            core.remembers or type(core).remember is not ContactEnv.remember
            for core in self._cores
        )
        self._raw = np.zeros((self.num_envs, len(scaling)))
        box = self.observation_space
        self._seen = np.zeros(box.shape or (), box.dtype)
        self._env_obs: Any = self._seen  # where Gymnasium's reset puts a row, too
        self._is_checked = False
        self._failed = np.zeros(self.num_envs, dtype=np.bool_)
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
        if self._failed.any():
            raise ArmError(
                f"a step of this batch failed, and environment {self._failed.argmax()} "
                "was not reset since: reset before the next step",
                "not_reset",
            )
        rows = list(actions)  # the same object twice is compared at once
        over: list[int] = []
        going: list[int] = []
        index = 0
        try:
            for index, is_over in enumerate(self._autoreset_envs.tolist()):
                (over if is_over else going).append(index)
                if self._is_begun_early and not is_over:
                    target = self._cores[index].begin_step(rows[index])
                    self.batch.begin(index, target, POLICY_PERIOD)
            # All that can be done while they move is done after this line.
            infos: list[dict[str, Any]] = [{}] * self.num_envs
            columns = InfoColumns(self.num_envs, self._add_info)
            # Past wrappers that do nothing, scaled at once below; or each for itself.
            is_raw = self._scales_at_once and self._is_checked
            seen = self._raw if is_raw else self._seen
            for index in over:
                self._seen[index], infos[index] = self.envs[index].reset()
                self._rewards[index] = 0.0
                self._terminations[index] = self._truncations[index] = False
                columns.add(index, infos[index])
            for index in going:
                step = self._cores[index].follow if is_raw else self.envs[index].step
                (
                    seen[index],
                    self._rewards[index],
                    self._terminations[index],
                    self._truncations[index],
                    infos[index],
                ) = step(rows[index])
                columns.add(index, infos[index])
        except BaseException as error:
            error.add_note(f"in environment {index} of {self.num_envs}, from 0")
            self.batch.drop()
            self._failed[:] = True
            raise
        gathered = columns.gathered(infos)
        if is_raw and going:
            scaled = self._scaling.scale(self._raw[going] if over else self._raw)
            if self._remembers:
                rows = zip(going, scaled, strict=True)
                scaled = np.array([self._cores[i].remember(row) for i, row in rows])
            self._seen[going] = scaled
        self._is_checked = True
        self._autoreset_envs = self._terminations | self._truncations
        return (
            self._seen.copy(),
            self._rewards.copy(),
            self._terminations.copy(),
            self._truncations.copy(),
            gathered,
        )

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode in each environment, or where options["reset_mask"] says."""
        mask = (options or {}).get("reset_mask", slice(None))
        started = super().reset(seed=seed, options=options)
        self._failed[mask] = False
        return started

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads, and close the environments."""
        self.batch.close()
        super().close_extras(**kwargs)


def _core_of(env: gymnasium.Env) -> ContactEnv:
    core = env.unwrapped
    if isinstance(core, ContactEnv):
        return core
    raise ConfigError(
        f"{type(core).__name__} is no ContactEnv and cannot be stepped in a batch; "
        "take gymnasium's SyncVectorEnv"
    )


def _own_step(env: gymnasium.Env, others: Sequence[Any]) -> str | None:
    """Name the outermost layer whose step is neither the core's nor among others."""
    while isinstance(env, gymnasium.Wrapper):
        if type(env).step not in others:
            return type(env).__name__
        env = env.env
    return None if type(env).step is ContactEnv.step else type(env).__name__
