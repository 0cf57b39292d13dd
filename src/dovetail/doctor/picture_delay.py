"""Delay of pictures: motion of the board in them, against motion of the arm.

For a delay d the place of the board in the camera is fitted as a + b s(t - d), where s
is the arm's way along a line; the d that leaves least is the delay. It needs no
calibration: a and b are free.
"""

from typing import NamedTuple

import numpy as np

from dovetail.types import Array

LONGEST = 0.4
"""Largest delay that is looked for [s]."""
_STEP = 0.001


class PictureDelay(NamedTuple):
    """Fitted delay of the pictures, and the quality of the fit."""

    delay: float
    """From a picture's exposure until it is here [s]."""
    deviation: float
    """Its standard deviation [s]."""
    moved: float
    """Way of the board in the camera, over the arm's [1]: 1 where the arm carries one
    of the two."""
    unexplained: float
    """Residual of the fit, RMS [m]."""


def fit_delay(time: Array, way: Array, arrival: Array, seen: Array) -> PictureDelay:
    """Find the delay.

    Args:
        time: When the arm was measured [s], growing, shape (moments,).
        way: Where it was along its line [m], shape (moments,).
        arrival: When each picture was here [s], by the same clock, shape (pictures,).
        seen: Where the board was in the camera [m], shape (pictures, 3).
    """

    def fit(delay: float) -> tuple[float, Array]:
        moved = np.interp(arrival - delay, time, way)
        A = np.column_stack([np.ones(len(moved)), moved])
        found, *_ = np.linalg.lstsq(A, seen, rcond=None)
        return float(((seen - A @ found) ** 2).sum()), found[1]

    delays = np.arange(0.0, LONGEST, _STEP)
    left = np.array([fit(delay)[0] for delay in delays])
    best = int(left.argmin())
    middle = min(max(best, 1), len(delays) - 2)
    before, here, after = left[middle - 1 : middle + 2]
    bend = (before - 2.0 * here + after) / _STEP**2  # of the squares, over the delay
    shift = (before - after) / (2.0 * _STEP * max(bend, 1e-30))
    is_inside = 0 < best < len(delays) - 1
    delay = float(delays[best] + np.clip(shift, -_STEP, _STEP) * is_inside)
    least, slope = fit(delay)
    variance = least / max(3 * len(seen) - 7, 1)
    deviation = float(np.sqrt(2.0 * variance / max(bend, 1e-30)))
    rms = float(np.sqrt(least / len(seen)))
    return PictureDelay(delay, deviation, float(np.linalg.norm(slope)), rms)
