"""Bounds of the acceleration that may be asked for: the reference's third part."""

import numpy as np

from dovetail.control.config import LimitConfig
from dovetail.types import Array

HOLD_WIDTH = 1e-3
"""Least way behind a margin on which a push comes to be held against [rad or m]."""

_DAMPING_AWAY = 0.25
"""Share of `brake_rate` that slows a motion away from a limit against a push."""

RETURN_SPEED = 0.05
"""Of a wall that comes in from where the tool was outside of it at the start [m/s]."""


def walls(
    lim: LimitConfig, dt: float, p: Array, last: tuple[Array, Array] | None
) -> tuple[Array, Array]:
    """Lower and upper walls [m]: at a tool that begins outside, and slowly inwards."""
    tool = lim
    low, high = last or (p - tool.delta_x, p + tool.delta_x)
    way = RETURN_SPEED * dt if last else 0.0
    return np.minimum(low + way, tool.x_min), np.maximum(high - way, tool.x_max)


def intervals(
    lim: LimitConfig, dt: float, x: Array, v: Array, push: Array, x_min: Array,
    x_max: Array, v_max: Array, a_max: Array, eta: float, delta: float,
) -> tuple[Array, Array]:  # fmt: skip
    """Accelerations [lb, ub] from which, pushed, each coordinate still stops in time.

    `push` comes on top of what is asked for [rad/s2 or m/s2].
    """
    T, bounds = lim.kappa * dt, lim.bounds
    against = lim

    def upper(
        d: float, v: float, push: float, speed: float, V: float, A: float
    ) -> float:
        if bounds == "viability":
            d, V, full = d - delta, (1.0 - lim.delta_v) * V, A + max(push, 0.0)
            a = max(viable(d, v, V, full, T, eta * A), -A)
            beyond = min(2.0 * (d - v * T) / T**2, (V - v) / T)  # the limit already
            a = min(a, max(beyond, -against.authority * A))
            if not against.passive:
                return min(a, A) - push
            met = d - 0.5 * max(v, 0.0) / max(against.brake_rate, 1.0)
            held = min(max(-met / max(delta, HOLD_WIDTH), 0.0), 1.0)
            return min(under_push(lim, a, push, v, held), A + max(-push, 0.0))
        is_printed = bounds == "paper-printed"
        speed = speed if is_printed else v  # printed: position there
        a = min(2.0 * (d - v * dt) / dt**2, (V - speed) / dt, A)
        return (a if is_printed else max(a, -A)) - push

    ub = np.array([*map(upper, x_max - x, v, push, x, v_max, a_max)])
    lb = -np.array([*map(upper, x - x_min, -v, -push, -x, v_max, a_max)])  # by mirror
    side = np.where(v >= 0.0, ub, lb)  # not viable: the side moved towards wins
    return np.where(lb > ub, side, lb), np.where(lb > ub, side, ub)


def viable(d: float, v: float, V: float, A: float, T: float, brake: float) -> float:
    """Largest a over T after which braking still stops within d (Del Prete 2018)."""
    pos = 2.0 * (d - v * T) / T**2
    if d > 0.0 and v > 0.0 and pos <= -v / T:  # turning point inside the interval
        pos = max(min(-(v**2) / (2.0 * d), -v / T), -2.0 * v / T)
    b, c = T * (2.0 * v + brake * T), v**2 - 2.0 * brake * (d - v * T)
    disc = b**2 - 4.0 * T**2 * c
    stop = max((-b + np.sqrt(disc)) / (2.0 * T**2), -v / T) if disc >= 0 else -v / T
    return min(pos, stop, (V - v) / T, A)


def under_push(
    lim: LimitConfig, limit: float, push: float, v: float, held: float
) -> float:
    """Return what may be asked for below a limit: against a push only braking."""
    rate = lim.brake_rate
    if push <= 0.0 or not lim.passive:
        return limit - push
    braking = -rate * max(v, 0.0) - held * (push + max(-limit, 0.0))
    damping = _DAMPING_AWAY * rate * max(-v, 0.0) * (1.0 - held)
    return min(limit, max(limit - push, braking + damping))
