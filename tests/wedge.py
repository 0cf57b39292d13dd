"""Statics of a sprung latch: a wedge that a lip pushes aside, with friction."""

import math

from dovetail.tasks.rail_clip.din_rail import OVERLAP, PRELOAD, STIFFNESS


def snap_force(friction: float, angle: float) -> float:
    """Return the largest force at one latch, pushed along the component's way [N].

    Args:
        friction: Coefficient of friction of nose and lip.
        angle: `SLOPE_IN` to snap in, `SLOPE_OUT` to pull off [rad].

    Returns:
        Infinite where friction HOLDs it at any force.
    """
    spring = STIFFNESS * (PRELOAD + OVERLAP)
    tilted = angle + math.atan(friction)
    return spring * math.tan(tilted) if tilted < math.pi / 2.0 else math.inf
