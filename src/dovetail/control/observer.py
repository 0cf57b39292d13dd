"""Gain of the observer that makes joint velocities from encoder positions."""

OBSERVER_TIME = 0.005
"""Time over which positions make a velocity [s]: a difference over 1 ms has five times
the noise of one over 5 ms, which swung twin hard by 20 mm while it was held."""


def observer_gain(period: float) -> float:
    """Return the velocity observer's gain [1] at a control period [s]."""
    return min(1.0, period / OBSERVER_TIME)
