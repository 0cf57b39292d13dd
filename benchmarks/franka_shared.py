"""Memory that franka-sim's process and its judge share: states of the arm, a push.

A file of numbers: the first row has the count of states so far and the size of the push
[N]; the others are a ring of the last `ROWS` states. Every state has its time by the
machine's monotonic clock [s], whether torques are commanded, q [rad] and dq [rad/s].
"""

import time
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

ROWS = 20_000
COLUMNS = 16
Array = NDArray[np.float64]


class Shared:
    """The memory, as one of both ends sees it."""

    def __init__(self, memory: Array) -> None:
        """Take what `made` or `of` opened."""
        self._head, self._ring = memory[0], memory[1:]

    @classmethod
    def made(cls, path: Path) -> Self:
        """Make the file anew."""
        return cls(np.memmap(path, np.float64, "w+", shape=(1 + ROWS, COLUMNS)))

    @classmethod
    def of(cls, path: Path) -> Self:
        """Open a file that the other end has made."""
        return cls(np.memmap(path, np.float64, "r+", shape=(1 + ROWS, COLUMNS)))

    @property
    def push(self) -> float:
        """Size of the push [N]."""
        return float(self._head[1])

    @push.setter
    def push(self, newtons: float) -> None:
        self._head[1] = newtons

    def note(self, q: Array, dq: Array, *, is_commanded: bool) -> None:
        """Add a state."""
        count = int(self._head[0])
        row = self._ring[count % ROWS]
        row[0], row[1] = time.monotonic(), is_commanded
        row[2:9], row[9:16] = q, dq
        self._head[0] = count + 1

    def since(self, begin: float) -> Array:
        """Return the states since a time [s], oldest first, one row each."""
        count = int(self._head[0])
        at = np.arange(max(0, count - ROWS + 100), count) % ROWS
        rows = np.array(self._ring[at])
        return rows[rows[:, 0] >= begin]
