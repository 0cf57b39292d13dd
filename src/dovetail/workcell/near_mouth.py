"""Two parts next below the mouth: is it a post, and where do walls stop a corner?"""

from collections.abc import Sequence

import numpy as np

from dovetail.poses import TOOL_DOWN
from dovetail.types import Array
from dovetail.workcell.end_outline import hull_line, surface_points
from dovetail.workcell.parts import Part

_BELOW = 0.003
"""Depth below the mouth at which the fixture is looked at [m], or half of the way: a
chamfer ends above."""
_TIP = 0.0003
"""Least height above the held part's end at which it is looked at [m]."""
_INSIDE = 1e-4
"""Distance by which all of a post lies inside the held part's end at least [m]."""
_BEYOND = 0.001
"""Distances outside of an opening at which a wall is looked for [m], up to its radius:
where the mouth is wider than the end, its walls are farther out."""
_GRID = 60
"""Points to each side at which an opening is looked at for walls inside it."""
_DIVIDED = 0.1
"""Share of an opening filled by walls from which it is divided [1]; a chamfer, or a
corner that is not quite round, is less."""
_ANGLES = 72
"""Directions in which it is looked for."""
_ENOUGH = 0.75
"""A corner is used if it has this share of the walls of the best-walled corner [1]."""
_COSINE = 0.5
"""Cosine of the angle to both sides of a corner in which walls stop it [1]."""


def sections_near_mouth(fixture: Part, depth: float) -> list[Array]:
    """Return the section of each of a fixture's pieces next below its mouth.

    Args:
        fixture: In its own frame.
        depth: Of the held part's end below the mouth when the task is done [m].

    Returns:
        Corners of convex lines, counter-clockwise, each of shape (corners, 2) [m].
    """
    return sections_at(fixture, -_looked_at(depth))


def sections_near_end(held: Part, depth: float) -> list[Array]:
    """Return the section of each of a held part's pieces next above its end.

    Args:
        held: In the TCP's frame.
        depth: See `sections_near_mouth`; 0 is at the very end.

    Returns:
        The same, as seen from above the fixture.
    """
    up = np.array([0.0, 0.0, max(_looked_at(depth), _TIP)])
    seen = tuple(one.moved(-up, TOOL_DOWN) for one in held.primitives)
    return sections_at(Part(held.name, seen), 0.0)


def _looked_at(depth: float) -> float:
    return min(_BELOW, 0.5 * depth)


def sections_at(part: Part, z: float) -> list[Array]:
    """Return the section of each of a part's pieces at a height.

    What moves on the part is left out.

    Args:
        part: In its own frame.
        z: The height [m].

    Returns:
        See `sections_near_mouth`.
    """
    found = []
    for shape in part.primitives:
        points = surface_points(Part(part.name, (shape,)))
        is_above = points[:, 2] > z
        low, high = points[~is_above], points[is_above]
        if not len(low) or not len(high):
            continue
        share = (z - low[:, None, 2:]) / (high[None, :, 2:] - low[:, None, 2:])
        cut = low[:, None, :2] + share * (high[None, :, :2] - low[:, None, :2])
        line = hull_line(cut.reshape(-1, 2))
        if len(line) > 2:
            found.append(line)
    return found


def post_line(sections: Sequence[Array], end: Array) -> Array | None:
    """Return the convex outline of a post, or None where the fixture is none.

    It is one where all of its section lies inside the outline of the held part's end:
    then that end has a bore for it.

    Args:
        sections: Of the fixture.
        end: Convex outline of the held part's end, counter-clockwise, shape (corners,
            2) [m].
    """
    if not sections:
        return None
    line = hull_line(np.vstack(sections))
    return line if inside(end, line).min() > _INSIDE else None


def is_divided(line: Array, sections: Sequence[Array]) -> bool:
    """Say whether much of what a line encloses is filled by walls.

    Args:
        line: Convex outline of an opening or a post, counter-clockwise, shape (corners,
            2) [m].
        sections: Of the fixture about that opening, or of the part over that post.
    """
    low, high = line.min(axis=0), line.max(axis=0)
    x, y = np.linspace(low, high, _GRID).T
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = points[inside(line, points).min(axis=0) > 0.0]
    is_wall = np.zeros(len(points), dtype=bool)
    for section in sections:
        is_wall |= inside(section, points).min(axis=0) >= 0.0
    return bool(is_wall.mean() > _DIVIDED)


def walled_corner(sections: Sequence[Array], opening: Array) -> Array:
    """Return the farthest corner of an opening that walls stop [m].

    Where an opening is open on a side, a corner there has fewer walls about it than
    others, and is left out.

    Args:
        sections: Of the fixture.
        opening: Corners of a convex line, counter-clockwise. It is seen from 0 0, or
            from its own middle where it does not hold that.
    """
    if inside(opening, np.zeros((1, 2))).min() <= 0.0:
        middle = opening.mean(axis=0)
        moved = [line - middle for line in sections]
        return middle + walled_corner(moved, opening - middle)
    walls = walls_about(opening, sections)
    radius = np.linalg.norm(opening, axis=1)
    is_walled = walls >= _ENOUGH * walls.max()
    return opening[np.lexsort((walls, radius.round(5), is_walled))[-1]]


def walls_about(opening: Array, sections: Sequence[Array]) -> Array:
    """Return the share of directions about each corner in which walls are next [1].

    Args:
        opening: Corners of a convex line that holds 0 0, counter-clockwise.
        sections: Of the fixture.
    """
    angles = 2.0 * np.pi * np.arange(_ANGLES) / _ANGLES
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    edge = np.roll(opening, -1, axis=0) - opening
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    reach = (normal * opening).sum(axis=1)[:, None]
    along = normal @ ways.T  # (edges, angles)
    far = np.where(along > 0.0, reach / np.where(along > 0.0, along, 1.0), np.inf)
    radius = np.linalg.norm(opening, axis=1)
    is_wall = np.zeros(_ANGLES, dtype=bool)
    for beyond in np.arange(_BEYOND, max(radius.max(), 2.0 * _BEYOND), _BEYOND):
        points = ways * (far.min(axis=0)[:, None] + beyond)
        for line in sections:
            is_wall |= inside(line, points).min(axis=0) >= 0.0
    is_near = opening @ ways.T > _COSINE * radius[:, None]
    return (is_near & is_wall).sum(axis=1) / is_near.sum(axis=1)


def inside(line: Array, points: Array) -> Array:
    """Return how far points are inside the edges of a convex line [m].

    Shape (edges, points); below 0 is outside.
    """
    way = np.roll(line, -1, axis=0) - line
    to = points[None] - line[:, None]
    area = way[:, None, 0] * to[:, :, 1] - way[:, None, 1] * to[:, :, 0]
    return area / np.linalg.norm(way, axis=1)[:, None]
