"""Control periods: those at which every promise is tested, and how one is refused.

A policy's step of 50 ms is a whole number of each of them. On FRI's wire a period is a
whole number of milliseconds.
"""

import math

from dovetail.durations import format_ms
from dovetail.errors import ConfigError

POLICY_PERIOD = 0.05
"""Time between two actions of a policy [s]."""
PERIODS = (0.001, 0.002, 0.0025, 0.005)
"""Control periods of tasks and arms [s]."""
FRI_PERIODS = (0.001, 0.002, 0.005)
"""Those of them that a cabinet can send at [s]."""
DEFAULT_PERIOD = 0.005
"""Control period where nothing else is asked for [s]."""


def require_period(
    period: float,
    name: str = "control period",
    allowed: tuple[float, ...] = PERIODS,
) -> float:
    """Return the allowed control period [s] that a number is.

    Args:
        period: To check [s].
        name: What it is, for messages.
        allowed: PERIODS, or FRI_PERIODS for an arm behind a cabinet.

    Raises:
        ConfigError: It is none of them; says which of the reasons it is.
    """
    names = [f"{1e3 * known:g}" for known in allowed]
    listed = f"allowed: {', '.join(names[:-1])} and {names[-1]} ms"
    if isinstance(period, str) or not math.isfinite(period):
        raise ConfigError(f"{name} is {period!r}, no number of seconds; {listed}")
    for known in allowed:
        if math.isclose(period, known, rel_tol=1e-9):
            return known
    shorter = [known for known in allowed if known < period] or [allowed[0]]
    raise ConfigError(
        f"{name} is {1e3 * period:g} ms{_reason(period, allowed)}; {listed}; take "
        f"{format_ms(shorter[-1])}"
    )


def _reason(period: float, allowed: tuple[float, ...]) -> str:
    """Return why a period is refused, where one word says it."""
    if not allowed[0] <= period <= allowed[-1]:
        return ""
    if period in PERIODS:
        return ", and FRI knows whole milliseconds only"
    steps = POLICY_PERIOD / period
    if abs(steps - round(steps)) > 1e-9:
        return f"; a policy step, {1e3 * POLICY_PERIOD:g} ms, is no multiple of it"
    return ", at which the limits were not tested"
