"""Past (observation, action) pairs, appended to the newest observation."""

import numpy as np
from numpy.typing import NDArray

from dovetail.settings import in_count


class History:
    """The last `size` (observation, action) pairs, newest first.

    At the start of an episode there is no past: every slot holds the first
    observation and a zero action.
    """

    def __init__(self, size: int, num_observations: int, num_actions: int) -> None:
        """Reserve the memory.

        Args:
            size: Number of past pairs, 0 to 100; 0 gives the observation alone.
            num_observations: Length of one observation.
            num_actions: Length of one action.

        Raises:
            ConfigError: `size` is no whole number, or out of range.
        """
        self.size = size = in_count("stack", size, 0, 100, "past pairs")
        self._num_observations = num_observations
        self._pair = num_observations + num_actions
        length = num_observations + size * self._pair
        self._stacked = np.zeros(length, dtype=np.float32)

    def __len__(self) -> int:
        """Length of the stacked observation."""
        return len(self._stacked)

    def highest(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the largest stacked observation, given that of one observation."""
        num_actions = self._pair - self._num_observations
        pair = [*observation, *([1.0] * num_actions)]
        return np.array([*observation, *(pair * self.size)], dtype=np.float32)

    def reset(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Forget the past; return the stacked first observation."""
        stacked, count = self._stacked, self._num_observations
        stacked[:] = 0.0
        stacked[:count] = observation
        for start in range(count, len(stacked), self._pair):
            stacked[start : start + count] = observation
        return stacked.copy()

    def push(
        self, action: NDArray[np.float32], observation: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Remember the action just taken; return the new stacked observation."""
        if not self.size:
            return observation
        stacked, count, pair = self._stacked, self._num_observations, self._pair
        past = stacked[count : len(stacked) - pair].copy()
        stacked[count + pair :] = past
        stacked[count : 2 * count] = stacked[:count]
        stacked[2 * count : count + pair] = action
        stacked[:count] = observation
        return stacked.copy()
