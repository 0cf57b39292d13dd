"""Score of a try by the rules of the AI for Industry Challenge, at most 100 points.

Reference:
    intrinsic-dev/aic, docs/scoring.md (2026). Points for nearness without insertion
    and the penalty for other ports are left out: there is one port, and a plug beside
    it scores nothing here.
"""

from typing import NamedTuple

import numpy as np

from dovetail.types import Array

_VALID = 1.0
_FULL = 75.0
_PARTLY = 38.0, 50.0
"""Points for a plug at the mouth, and for one that lacks little."""
_SMOOTH, _JERK_MOST = 6.0, 50.0  # m/s3
_QUICK, _QUICKEST, _SLOWEST = 12.0, 5.0, 60.0  # s
_SHORT, _LONGER = 6.0, 1.0  # m
_PRESSED, _FORCE_MOST, _PRESSED_FOR = -12.0, 20.0, 1.0  # N, s
_TOUCHED = -24.0
_MOVING = 0.01  # m/s
_WINDOW = 15


class Motion(NamedTuple):
    """Tool and contact during a try, one row per control cycle."""

    period: float
    """Control period [s]."""
    velocity: Array
    """Velocity of the TCP [m/s], shape (cycles, 3)."""
    force: Array
    """Contact force on the tool [N], shape (cycles, 3)."""


class Insertion(NamedTuple):
    """Result of a try."""

    success: bool
    """True if the plug is in, deep enough."""
    depth: float
    """Depth of the plug's end below the mouth at the end [m]."""
    full_depth: float
    """Depth that counts as plugged in [m]."""
    is_inside: bool
    """True if the plug's end is in the port, and not beside it."""
    distance: float
    """From the plug to where it goes, at the start [m]."""
    touched: bool = False
    """True if the robot touched something that is off limits."""


class Score(NamedTuple):
    """Points of a try."""

    valid: float
    insertion: float
    smoothness: float
    duration: float
    path: float
    force: float
    contact: float

    def total(self) -> float:
        """Return the sum."""
        return float(sum(self))


def mean_jerk(motion: Motion) -> float:
    """Return the mean size of the jerk while the tool moves [m/s3].

    A parabola is fitted to the velocity over 15 cycles about each (Savitzky and Golay
    1964); its second derivative is the jerk.
    """
    velocity = motion.velocity
    if len(velocity) < _WINDOW:
        return 0.0
    at = np.arange(_WINDOW) - (_WINDOW - 1) / 2.0
    weights = 2.0 * np.linalg.pinv(np.vander(at, 3, increasing=True))[2]
    windows = np.lib.stride_tricks.sliding_window_view(velocity, _WINDOW, axis=0)
    jerk = np.linalg.norm(windows @ weights, axis=1) / motion.period**2
    middle = velocity[_WINDOW // 2 : len(velocity) - _WINDOW // 2]
    is_moving = np.linalg.norm(middle, axis=1) > _MOVING
    return float(jerk[is_moving].mean()) if is_moving.any() else 0.0


def aic_score(motion: Motion, result: Insertion) -> Score:
    """Return the points of a try."""
    if result.success:
        insertion = _FULL
    elif result.is_inside and result.depth > 0.0:
        low, high = _PARTLY
        insertion = low + (high - low) * min(result.depth / result.full_depth, 1.0)
    else:
        insertion = 0.0
    time = motion.period * len(motion.velocity)
    length = motion.period * float(np.linalg.norm(motion.velocity, axis=1).sum())
    is_pressed = np.linalg.norm(motion.force, axis=1) > _FORCE_MOST
    pressed = motion.period * np.count_nonzero(is_pressed)

    def share(value: float, best: float, worst: float) -> float:
        return float(np.clip((worst - value) / (worst - best), 0.0, 1.0))

    is_near = insertion > 0.0
    return Score(
        valid=_VALID,
        insertion=insertion,
        smoothness=is_near * _SMOOTH * share(mean_jerk(motion), 0.0, _JERK_MOST),
        duration=is_near * _QUICK * share(time, _QUICKEST, _SLOWEST),
        path=is_near
        * _SHORT
        * share(length, result.distance, result.distance + _LONGER),
        force=_PRESSED if pressed > _PRESSED_FOR else 0.0,
        contact=_TOUCHED if result.touched else 0.0,
    )
