"""How deep the peg is, and how far from the hole's axis."""

import math

from dovetail.types import Vec3


def insertion(error: Vec3, axis: Vec3, hole_depth: float) -> tuple[float, float]:
    """Return depth below the mouth and distance from the axis [m].

    Args:
        error: Tool minus target [m].
        axis: The hole's axis, out of the hole, unit length.
        hole_depth: From the mouth to the target [m].
    """
    x, y, z = error.tolist()  # each policy step: floats are quicker than arrays
    nx, ny, nz = axis.tolist()
    height = x * nx + y * ny + z * nz
    lateral = math.sqrt(max(x * x + y * y + z * z - height * height, 0.0))
    return hole_depth - height, lateral
