"""The way of a component onto its rail: around the lip's end, behind it, and straight.

In the plane of the motion, with the rail's face at depth 0: aside is towards the hook's
lip, which is the world's y, and in is the world's x. The component is turned in by an
angle when the end with its hook is deeper.
"""

import math

import numpy as np

from dovetail.tasks.rail_clip.din_rail import HOLD, HOOK, OUTER, SHEET, WIDTH
from dovetail.types import Vec3

TURNED_IN = 0.25
"""Turn at which the hook goes around the lip [rad]: the latch is 1 mm in front of its
own then."""
AROUND = WIDTH / 2.0 + 0.001, HOLD + 0.0004
"""Place of the hook's inner edge at the lip's end: aside, and in [m]."""
BEHIND = 0.015
"""Length of the way behind the lip [m]: more than is left there, and its turn."""


def hook_edge(error: Vec3, theta: float) -> tuple[float, float]:
    """Return where the hook's inner edge is: aside, and in [m].

    Args:
        error: TCP minus the goal [m], world axes.
        theta: Turn about the vertical from the goal's [rad].
    """
    c, s = math.cos(theta), math.sin(theta)
    along = OUTER - HOOK
    return error[1] + c * along + s * HOLD, error[0] + c * HOLD - s * along


def is_hooked(error: Vec3, theta: float) -> bool:
    """Say whether the hook is behind the lip."""
    aside, depth = hook_edge(error, theta)
    return depth > SHEET and aside < WIDTH / 2.0


def left_on_the_way(error: Vec3, theta: float) -> tuple[Vec3, float]:
    """Return what is left of the way [m], world axes, and of the turn [rad].

    Args:
        error: TCP minus the goal [m], world axes.
        theta: Turn about the vertical from the goal's [rad].
    """
    if is_hooked(error, theta):
        return error, theta
    aside, depth = hook_edge(error, theta)
    left = np.array([depth - AROUND[1], aside - AROUND[0], error[2]])
    length = max(float(np.linalg.norm(left)), 1e-9)
    return left * (1.0 + BEHIND / length), theta + TURNED_IN
