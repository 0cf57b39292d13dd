"""The infos of many environments as Gymnasium puts them together, one at a time."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

AddInfo: TypeAlias = Callable[[dict[str, Any], dict[str, Any], int], dict[str, Any]]
"""Gymnasium's `VectorEnv._add_info`: it knows every kind of value, and is slow."""


class InfoColumns:
    """A column of N values, and a mask, for each key of an info.

    Numbers and arrays are put into place here, while other environments still move.
    """

    def __init__(self, num_envs: int, add_info: AddInfo) -> None:
        """Begin with no column.

        Args:
            num_envs: N.
            add_info: Adds what is neither number nor array.
        """
        self._num_envs, self._add_info = num_envs, add_info
        self._columns: dict[str, tuple[Any, Any]] = {}
        self._others: dict[str, Any] = {}

    def add(self, index: int, info: dict[str, Any]) -> None:
        """Put an environment's info into place."""
        for key, value in info.items():
            column = self._columns.get(key)
            if column is None:
                column = self._begin(key, value)
                if column is None:
                    added = self._add_info(self._others, {key: value}, index)
                    self._others = added
                    continue
            column[0][index] = value
            column[1][index] = True

    def _begin(self, key: str, value: Any) -> tuple[Any, Any] | None:
        """Return an empty column, or None where Gymnasium has to know what to do."""
        if key in self._others or key == "final_obs":
            return None
        if isinstance(value, np.ndarray):
            values = np.zeros((self._num_envs, *value.shape), dtype=value.dtype)
        elif isinstance(value, (bool, int, float, np.number)):
            values = np.zeros(self._num_envs, dtype=type(value))
        else:
            return None
        self._columns[key] = values, np.zeros(self._num_envs, dtype=np.bool_)
        return self._columns[key]

    def gathered(self, infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
        """Return the columns and their masks, in the order in which `infos` have them.

        Args:
            infos: Of the environments, in their order.
        """
        out: dict[str, Any] = {}
        for info in infos if self._is_mixed(infos) else infos[:1]:
            for key in info:
                if key in out:
                    continue
                values, mask = self._columns.get(key) or (
                    self._others[key],
                    self._others[f"_{key}"],
                )
                out[key], out[f"_{key}"] = values, mask
        return out

    def _is_mixed(self, infos: Sequence[dict[str, Any]]) -> bool:
        """Say whether some have keys that the first has not."""
        return len(infos[0]) < len(self._columns) + len(self._others) // 2
