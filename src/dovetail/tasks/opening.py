"""Going straight into an opening: depth along its axis, distance from it."""

import math

from dovetail.control.ranges import Range
from dovetail.errors import ConfigError
from dovetail.poses import TOOL_DOWN, Pose, quat_multiply
from dovetail.tasks.task import Goal, Progress, axis_of
from dovetail.types import Vec3

CLEARANCE = Range(0.0, 0.010, "m")
"""Gap between held part and fixture on each side; 0.06 mm to 4 mm is tested."""


def widened_gap(clearance: float, widened: float) -> float:
    """Return a gap [m] that a twin made wider.

    Raises:
        ConfigError: It would be negative.
    """
    if clearance + widened < 0.0:
        raise ConfigError(
            f"clearance_offset {widened * 1e3:g} mm makes the clearance of "
            f"{clearance * 1e3:g} mm negative; allowed is "
            f"{-clearance * 1e3:g} mm and more"
        )
    return clearance + widened


def goal_inside(fixture: Pose, depth: float) -> Goal:
    """Return the goal `depth` [m] below the fixture's frame, tool against its z."""
    axis = axis_of(fixture)
    return Goal(
        position=fixture.position - depth * axis,
        quat_wxyz=quat_multiply(fixture.quat_wxyz, TOOL_DOWN),
        normal=axis,
        surface=float(axis @ fixture.position),
    )


def insertion(error: Vec3, axis: Vec3, depth: float) -> tuple[float, float]:
    """Return how deep the tool is in an opening and how far from its axis [m].

    Args:
        error: Tool minus the middle of the opening's floor [m].
        axis: The opening's axis, outwards, unit length; same axes.
        depth: From mouth to floor [m].
    """
    x, y, z = error.tolist()
    nx, ny, nz = axis.tolist()
    height = x * nx + y * ny + z * nz
    lateral = math.sqrt(max(x * x + y * y + z * z - height * height, 0.0))
    return depth - height, lateral


def judge_insertion(
    error: Vec3, goal: Goal, depth: float, success_depth: float, lateral_max: float
) -> Progress:
    """Say how deep the tool is, and whether it is deep enough and inside.

    Args:
        error: Tool minus the goal [m].
        goal: Of `goal_inside`.
        depth: From mouth to floor [m].
        success_depth: Depth that counts as done [m].
        lateral_max: Largest distance from the axis that is inside [m].
    """
    reached, lateral = insertion(error, goal.normal, depth)
    return Progress(reached, reached >= success_depth and lateral <= lateral_max)
