"""The infos of many environments as Gymnasium puts them together, one at a time."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

AddInfo: TypeAlias = Callable[[dict[str, Any], dict[str, Any], int], dict[str, Any]]
"""Gymnasium's `VectorEnv._add_info`: it knows every kind of value, and is slow."""


class InfoColumns:
    """A column of N values, and a mask, for each key of an info.

    Numbers and arrays are put into place here, while other environments still move;
    whose info has a key is asked once, at the end.
    """

    def __init__(self, num_envs: int, add_info: AddInfo) -> None:
        """Begin with no column.

        Args:
            num_envs: N.
            add_info: Adds what is neither number nor array.
        """
        self._num_envs, self._add_info = num_envs, add_info
        self._columns: dict[str, NDArray[Any]] = {}
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
            column[index] = value

    def _begin(self, key: str, value: Any) -> NDArray[Any] | None:
        """Return an empty column, or None where Gymnasium has to know what to do."""
        if key in self._others or key == "final_obs":
            return None
        if isinstance(value, np.ndarray):
            column = np.zeros((self._num_envs, *value.shape), dtype=value.dtype)
        elif isinstance(value, (bool, int, float, np.number)):
            column = np.zeros(self._num_envs, dtype=type(value))
        else:
            return None
        self._columns[key] = column
        return column

    def gathered(self, infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
        """Return the columns and their masks, in the order in which `infos` have them.

        Args:
            infos: Of the environments, in their order.
        """
        out: dict[str, Any] = {}
        num_keys = len(self._columns) + len(self._others) // 2
        is_alike = min(map(len, infos)) == num_keys
        every = np.ones(self._num_envs, dtype=np.bool_)
        for key in infos[0] if is_alike else dict.fromkeys(k for i in infos for k in i):
            if key in self._others:
                out[key], out[f"_{key}"] = self._others[key], self._others[f"_{key}"]
                continue
            out[key] = self._columns[key]
            has_it = every if is_alike else [key in info for info in infos]
            out[f"_{key}"] = np.array(has_it)
        return out
