"""A cycle log with every cycle in it: short gaps are filled, long ones end it.

A cycle is missing where a message of the cabinet was answered too late or not at all.
The cabinet then goes on with the last torque, so that is what is put there; the
position is put on the straight line between its neighbours.
"""

import numpy as np

from dovetail.doctor.torque_balance import WINDOW
from dovetail.plants.plant import COLUMN
from dovetail.types import Array

_HELD = [COLUMN[f"tau{i}"] for i in range(1, 8)] + [COLUMN["flags"]]


def longest_filled(log: Array, period: float) -> Array:
    """Return the longest part without a long gap, a row for every cycle of it.

    A gap longer than the torque balance's `WINDOW` cannot be filled.

    Args:
        log: Cycle log, columns CYCLE_COLUMNS first.
        period: Control period [s].
    """
    if len(log) == 0:
        return log
    cycles = np.rint((log[:, 0] - log[0, 0]) / period).astype(int)
    missing = np.diff(cycles)
    ends = [0, *np.flatnonzero(missing * period > WINDOW + 0.5 * period) + 1, len(log)]
    starts = np.array(ends[:-1])
    lasts = np.array(ends[1:]) - 1
    longest = int(np.argmax(cycles[lasts] - cycles[starts]))
    part = log[starts[longest] : lasts[longest] + 1]
    at = cycles[starts[longest] : lasts[longest] + 1]
    return _fill(part, at - at[0])


def _fill(part: Array, at: Array) -> Array:
    """Return a row for every cycle.

    Args:
        part: Rows that there are.
        at: Cycle of each, from 0 on.
    """
    grid = np.arange(at[-1] + 1)
    before = np.searchsorted(at, grid, "right") - 1
    after = np.minimum(before + 1, len(at) - 1)
    way = (grid - at[before]) / np.maximum(at[after] - at[before], 1)
    filled = part[before] + way[:, None] * (part[after] - part[before])
    filled[:, _HELD] = part[before][:, _HELD]
    return filled
