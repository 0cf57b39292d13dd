"""A teacher's steps fill the start of a replay buffer, in place of random ones.

What random actions never reach, no learner learns: a search of several seconds with a
tilted part is such a thing. The teacher acts in the run's own environments, with noise
on its actions; what comes of it are transitions as any others.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.unwrapped import require_contact_env
from dovetail.learn.policy import Actor
from dovetail.search.corner import CornerSearch
from dovetail.search.corrected_env import CorrectedEnv, NoCorrection

_STREAM = 0x7EAC4E
_JUDGED = 4000
"""Gradient steps of the critics before the actor's first, where a script is corrected:
an actor that follows new critics away from it unlearns what it does."""


class Teacher:
    """One actor for each environment, and noise."""

    def __init__(self, envs: list[Any], noise: float, seed: int) -> None:
        """Begin with the environments as they are.

        Args:
            envs: Environments of dovetail, wrapped or not.
            noise: Standard deviation of what is added to actions [1].
            seed: Of the noise.

        Raises:
            ConfigError: The teacher cannot act in such an environment.
        """
        self._cores = [require_contact_env(env) for env in envs]
        self._actors = [_actor(core) for core in self._cores]
        self.is_corrected = any(isinstance(c, CorrectedEnv) for c in self._cores)
        """True if its steps are a script's that the policy corrects."""
        self._noise = noise
        self._rng = np.random.default_rng([_STREAM, seed])

    def act(self) -> NDArray[np.float32]:
        """Return the next action of each environment."""
        rows = []
        for core, actor in zip(self._cores, self._actors, strict=True):
            if core.steps == 0:
                actor.reset()
            rows.append(actor(np.zeros(0, dtype=np.float32)))
        actions = np.array(rows)
        noise = self._noise * self._rng.normal(size=actions.shape)
        return np.clip(actions + noise, -1.0, 1.0).astype(np.float32)


def _actor(core: ContactEnv) -> Actor:
    """Return the teacher's actor; it corrects nothing where the search acts already."""
    if isinstance(core, CorrectedEnv):
        return NoCorrection(len(core.commands))
    return CornerSearch(core)


def taught(kind: type) -> type:
    """Return an off-policy algorithm of SBX whose first steps are its teacher's.

    The first `learning_starts` steps of a run are; `teacher` is set after it was built.
    """

    class Taught(kind):
        teacher: Teacher

        def _sample_action(
            self, learning_starts: int, action_noise: Any = None, n_envs: int = 1
        ) -> tuple[NDArray[Any], NDArray[Any]]:
            if self.num_timesteps >= learning_starts:
                return super()._sample_action(learning_starts, action_noise, n_envs)
            actions = self.teacher.act()
            return actions, actions

        def train(self, gradient_steps: int, batch_size: int) -> None:
            if self._n_updates == 0 and self.teacher.is_corrected:
                self._learn_to_judge(gradient_steps, batch_size)
            super().train(gradient_steps, batch_size)

        def _learn_to_judge(self, gradient_steps: int, batch_size: int) -> None:
            """Let the critics learn from the teacher's steps before the actor does."""
            usual, self.policy_delay = self.policy_delay, gradient_steps + 2
            for _ in range(_JUDGED // gradient_steps):
                super().train(gradient_steps, batch_size)
                self._n_updates = 0  # the actor's turn never comes; compiled once
            self.policy_delay = usual

    return Taught
