"""The last moments of the control loop as columns, for plots."""

import numpy as np
from numpy.typing import NDArray

from dovetail.cockpit.snapshot import USED, Moment
from dovetail.types import Array

COLUMNS = ("time", "force", "pull", "reward", "work", *USED)
"""Time since the reset [s], sizes of contact force and pull [N], reward of the last
policy step [1], computing time of a slice [ms], limits used [%]."""
ROWS = 1200
"""Number of moments that are kept: 12 s of slices."""
_APART = 0.002  # [m] between two points of the path, about


class Trace:
    """A ring that one thread writes and others read without waiting.

    A reader may find its oldest rows overwritten by newer ones; those are left out.
    """

    def __init__(self) -> None:
        """Begin empty."""
        self._rows = np.full((2 * ROWS, len(COLUMNS)), np.nan)
        self._places = np.full((2 * ROWS, 3), np.nan)
        self._count = self._begin = 0

    def clear(self) -> None:
        """Forget everything: an episode begins."""
        self._begin = self._count

    def add(self, moment: Moment) -> None:
        """Remember a moment."""
        row = self._count % (2 * ROWS)
        self._rows[row] = (
            moment.stamp,
            float(np.linalg.norm(moment.load.force)),
            float(np.linalg.norm(moment.load.pull)),
            moment.reward,
            1e3 * moment.work,
            *moment.load.used,
        )
        self._places[row] = moment.tool.position
        self._count += 1

    def _indices(self) -> NDArray[np.int_]:
        count = self._count
        return np.arange(max(self._begin, count - ROWS), count) % (2 * ROWS)

    def rows(self) -> Array:
        """Return the last moments, the oldest first, shape (moments, columns)."""
        return self._rows[self._indices()]

    def path(self) -> Array:
        """Return where the tool's end was [m], shape (points, 3)."""
        places = self._places[self._indices()]
        cells = np.round(places / _APART)
        has_moved = np.ones(len(places), dtype=bool)
        has_moved[1:] = (np.diff(cells, axis=0) != 0.0).any(axis=1)
        return places[has_moved]
