"""An environment in which a policy corrects what a script does.

A script of six phases cannot know how far it may be hurried; a network does not learn
where it has searched. Here the script remembers and leads, and the
policy sees what it is about to do and changes it.

Reference:
    Silver et al. 2018, Residual policy learning; Johannink et al. 2019, Residual
    reinforcement learning for robot control.
"""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from dovetail import _core
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.observation import Column
from dovetail.search.corner import CornerSearch

CORRECTED_STEPS = 40
"""Policy steps in which corrections count in full; in as many more they fade away."""


class CorrectedEnv(ContactEnv):
    """Does what the corner search does, plus `correction` times the action.

    The sum is clipped to [-1, 1]. From `CORRECTED_STEPS` on the correction fades away:
    even under a bad policy the search acts alone in the end, and finds the opening.

    The search's next action and the share of the correction that is left are appended
    to the observation. The last action that is recalled is the sum. An action of zeros
    is the search alone; a person's is done as it is.

    Raises:
        ConfigError: The search cannot act here; see `CornerSearch`.
    """

    def _prepare(self) -> None:
        super()._prepare()
        self._search = CornerSearch(self)
        size = len(self.commands)
        self._next = np.zeros(size, dtype=np.float32)
        own = [Column(f"script_{i}", "1", "of 1") for i in range(size)]
        left = Column("correction_left", "1", "of 1")
        self.columns = (*self.columns, *own, left)
        seen = np.append(self.scaling.high, self._recall.high)
        ones = np.ones(size + 1, dtype=np.float32)
        high = np.concatenate([self._history.highest(seen), ones])
        self.observation_space = gymnasium.spaces.Box(-high, high, dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; see `ContactEnv.reset`."""
        observation, info = super().reset(seed=seed, options=options)
        self._search.reset()
        return self._with_next(observation), info

    def begin_step(self, action: NDArray[np.float32]) -> _core.Target:
        """Do what a step does before its control cycles; see `ContactEnv`."""
        own = self.commands.usable(action)
        share = np.float32(self.config.correction) * self._left
        asked = own if self.is_led else self._next + share * own
        target = super().begin_step(asked.astype(np.float32))
        self._begun = action
        return target

    def remember(self, scaled: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a step's observation, and what the search would do next."""
        return self._with_next(super().remember(scaled))

    def _with_next(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        self._next = self._search(observation)
        return np.concatenate([observation, self._next, [self._left]])

    @property
    def _left(self) -> np.float32:
        """Share of the correction that counts in the next step, 0 to 1."""
        return np.float32(np.clip(2.0 - self.steps / CORRECTED_STEPS, 0.0, 1.0))


class NoCorrection:
    """Leaves the script as it is: acts as a policy does, with zeros."""

    def __init__(self, size: int) -> None:
        """Take the length of an action."""
        self._size = size

    def reset(self) -> None:
        """Do nothing; there is nothing to forget."""

    def __call__(self, observation: NDArray[np.float32], /) -> NDArray[np.float32]:
        """Return zeros, shape (size,)."""
        return np.zeros(self._size, dtype=np.float32)
