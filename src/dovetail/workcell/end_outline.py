"""Outline of the end of a held part: what goes into an opening first."""

import numpy as np

from dovetail.poses import matrix_from_quat
from dovetail.types import Array
from dovetail.workcell.outline import moved_corners, signed_area
from dovetail.workcell.parts import Part

_LAYER = 0.0005
"""Height of the layer above the lowest point that counts as the end [m]."""
_LEAST_AREA = 1e-8
"""Area of an end below which more of a pointed or sharp part counts as it [m2]."""
_SIDES = 48
"""Points that stand for a circle."""
_SAME = 1e-6
"""Distance up to which a corner of the outline is left out [m]."""


def end_outline(held: Part, gap: float) -> Array:
    """Return the convex outline of a held part's end, wider by a gap.

    Args:
        held: In the TCP's frame: the end is at z = 0, the tool at negative z.
        gap: How far each edge is moved outwards [m].

    Returns:
        Corners as seen from above the fixture, counter-clockwise, shape (corners, 2).
    """
    points = surface_points(held)
    above = points[:, 2].max() - points[:, 2]
    seen = points[:, :2] * [1.0, -1.0]  # the tool's z points down
    layer = _LAYER
    line = hull_line(seen[above < layer])
    while signed_area(line) < _LEAST_AREA and layer < above.max():
        layer *= 2.0
        line = hull_line(seen[above < layer])
    after = np.roll(line, -1, axis=0)
    return moved_corners(line[np.linalg.norm(after - line, axis=1) > _SAME], gap)


def surface_points(part: Part) -> Array:
    """Return points of a part whose hull is that of its shapes, shape (points, 3) [m].

    Cylinders have `_SIDES` sides; what moves on the part is left out.
    """
    found = []
    for shape in part.primitives:
        if shape.kind == "box":
            found.append(shape.corners())
            continue
        if shape.kind == "cylinder":
            radius, half = shape.size
            angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
            circle = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            own = np.vstack([np.insert(circle, 2, z, axis=1) for z in (-half, half)])
        else:
            own = shape.vertices()
        found.append(shape.position + own @ matrix_from_quat(shape.quat_wxyz).T)
    return np.vstack(found)


def hull_line(points: Array) -> Array:
    """Return the corners of the convex hull of points in a plane, counter-clockwise.

    Reference:
        Andrew 1979, Another efficient algorithm for convex hulls in two dimensions.
    """
    # By x, then y. Rounded, as x of one column that differs by its last bit would put
    # y out of order, and corners would be lost.
    _, first = np.unique(points.round(9), axis=0, return_index=True)
    ordered = points[first]
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    return np.array([*lower[:-1], *upper[:-1]]).reshape(-1, 2)


def _chain(ordered: Array) -> list[Array]:
    """Return the points of one side of the hull, in their order."""
    chain: list[Array] = []
    for point in ordered:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-1] - chain[-2], point - chain[-2]
            if ax * by - ay * bx > 1e-12:
                break
            chain.pop()
        chain.append(point)
    return chain
