"""The longest part of a cycle log in which no cycle is missing."""

import numpy as np

from dovetail.plants.plant import COLUMN
from dovetail.types import Array

GAP = 0.25
"""Deviation of the time between two cycles that is a gap, as a share of the period."""


def longest_gapless(log: Array, period: float) -> Array:
    """Return the rows between the two gaps that are farthest apart.

    Args:
        log: Cycle log, columns CYCLE_COLUMNS first.
        period: Control period [s].
    """
    late = np.abs(np.diff(log[:, COLUMN["time"]]) - period) > GAP * period
    ends = np.concatenate([[0], np.flatnonzero(late) + 1, [len(log)]])
    longest = int(np.argmax(np.diff(ends)))
    return log[ends[longest] : ends[longest + 1]]
