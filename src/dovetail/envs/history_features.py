"""A few past positions of the tool and the last action, appended to an observation.

A search needs to know where it has been, and a stack of all that was costs ten times
the numbers.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dovetail.envs.observation import Column, Layout
from dovetail.settings import in_count

_RECALLED = ("position", "tilt")
"""Groups of columns whose past a policy sees."""
_OLDEST = 200


class HistoryFeatures:
    """Scaled columns of some steps ago, in the order of their ages.

    At the start of an episode there is no past: each is what was seen first, and the
    last action is zero.
    """

    def __init__(self, ages: Sequence[int], layout: Layout, num_actions: int) -> None:
        """Find the columns.

        Args:
            ages: How many policy steps ago, each 1 to 200; none appends nothing.
            layout: Of one observation.
            num_actions: Length of one action.

        Raises:
            ConfigError: An age that is no whole number, or out of range.
        """
        self._ages = [in_count("recall", age, 1, _OLDEST, "steps") for age in ages]
        groups = [name for name in _RECALLED if name in layout.places]
        indices = [np.arange(len(layout))[layout.places[name]] for name in groups]
        self._indices = np.concatenate([np.zeros(0, dtype=int), *indices])
        self._num_actions = num_actions if self._ages else 0
        self._past: deque[NDArray[np.float32]] = deque(maxlen=max([0, *ages]) + 1)
        places = [layout.high[self._indices]] * len(self._ages)
        ones = np.ones(self._num_actions, dtype=np.float32)
        self.high: NDArray[np.float32] = np.concatenate([ones, *places])
        self.columns = tuple(
            [Column(f"last_action_{i}", "1", "of 1") for i in range(self._num_actions)]
            + [
                column._replace(name=f"{column.name}_{age}_ago")
                for age in self._ages
                for column in (layout.columns[i] for i in self._indices)
            ]
        )

    def __len__(self) -> int:
        """Return the count of numbers that are appended."""
        return len(self.high)

    def reset(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Forget the past; return the scaled observation with what is appended."""
        if not self._ages:
            return observation
        self._past.clear()
        self._past.append(observation[self._indices])
        return self._with(np.zeros(self._num_actions, dtype=np.float32), observation)

    def push(
        self, action: NDArray[np.float32], observation: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Remember; return the scaled observation with what is appended."""
        if not self._ages:
            return observation
        self._past.append(observation[self._indices])
        return self._with(action, observation)

    def _with(
        self, action: NDArray[np.float32], observation: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        newest = len(self._past) - 1
        past = [self._past[max(newest - age, 0)] for age in self._ages]
        return np.concatenate([observation, action, *past])
