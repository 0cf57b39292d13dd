"""Quantiles of Student's t, which an interval from few sequences needs."""

import math


def student_t(degrees: int, *, level: float = 0.95) -> float:
    """Return the two-sided quantile of Student's t for whole degrees of freedom.

    Args:
        degrees: Degrees of freedom, at least 1.
        level: Probability between minus and plus the quantile.

    Reference:
        Abramowitz 1964, 26.7.3 and 26.7.4, inverted by bisection.
    """
    low, high = 0.0, 1.0
    while _student_inside(high, degrees) < level:
        high *= 2.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        if _student_inside(middle, degrees) < level:
            low = middle
        else:
            high = middle
    return high


def _student_inside(t: float, degrees: int) -> float:
    """Return the probability of Student's t between -t and t."""
    theta = math.atan(t / math.sqrt(degrees))
    sine, cosine = math.sin(theta), math.cos(theta)
    term = cosine if degrees % 2 else 1.0
    total = term if degrees > 1 else 0.0
    for i in range(3 if degrees % 2 else 2, degrees - 1, 2):
        term *= cosine**2 * (i - 1) / i
        total += term
    if degrees % 2:
        return 2.0 / math.pi * (theta + sine * total)
    return sine * total
