"""Areas in the plane as convex pieces: triangles of shapely, merged where convex."""

from typing import Any

import numpy as np

from dovetail.errors import ConfigError
from dovetail.types import Array
from dovetail.workcell.outline import Outline
from dovetail.workcell.planar import import_shapely

_DENT = 1e-10
"""Largest depth of a dent that a convex piece fills [m]."""
_LEAST_AREA = 1e-10
"""Area that is left out where an offset cuts it off [m2]."""
_SLIVER = 3e-6
"""Width of a piece beside others below which it is left out [m]."""


def convex_pieces(outline: Outline) -> list[Array]:
    """Return an area as convex pieces that do not overlap, counter-clockwise.

    Their corners are the outline's own, to the last bit.

    Raises:
        MissingDependencyError: shapely is not installed.
    """
    if not outline.cutouts and is_convex(outline.outer):
        return [outline.outer]
    shapely = import_shapely()
    area = shapely.Polygon(outline.outer, outline.cutouts)
    found = shapely.constrained_delaunay_triangles(area)
    triangles = shapely.get_coordinates(shapely.get_parts(found)).reshape(-1, 4, 2)
    flat = triangles[:, :3].reshape(-1, 2)
    points, index = np.unique(flat, axis=0, return_inverse=True)
    pieces = _merge(points, index.reshape(-1, 3))
    wide = [piece for piece in pieces if _width(piece) > _SLIVER]
    return wide or pieces


def _width(line: Array) -> float:
    """Return the extent of points along the axis in which they extend least [m]."""
    centred = line - line.mean(axis=0)
    axis = np.linalg.svd(centred, full_matrices=False)[2][-1]
    return float(np.ptp(centred @ axis))


def areas_offset(outline: Outline, distance: float) -> list[Outline]:
    """Return an outline with every edge moved outwards [m].

    Where an edge vanishes, as the short ones of a mesh's section do, the neighbours
    meet; an area may fall apart, or a cutout close.

    Raises:
        ConfigError: Nothing is left.
        MissingDependencyError: shapely is not installed.
    """
    try:
        return [outline.offset(distance)]
    except ConfigError:
        shapely = import_shapely()
        area = shapely.Polygon(outline.outer, outline.cutouts)
        moved = area.buffer(distance, join_style="mitre", mitre_limit=2.0)
        parts = [one for one in shapely.get_parts(moved) if one.area > _LEAST_AREA]
        if not parts:
            raise
        return [
            Outline(_corners(one.exterior), tuple(map(_corners, one.interiors)))
            for one in parts
        ]


def _corners(line: Any) -> Array:
    """Return the corners of a closed line of shapely, counter-clockwise."""
    corners = np.array(line.coords)[:-1]
    return corners if line.is_ccw else corners[::-1]


def _merge(points: Array, triangles: Any) -> list[Array]:
    """Merge neighbours, those with the longest common edge first."""
    pieces = {}
    for key, corners in enumerate(triangles.tolist()):
        (ax, ay), (bx, by), (cx, cy) = points[corners]
        is_left = (bx - ax) * (cy - ay) > (by - ay) * (cx - ax)
        pieces[key] = corners if is_left else corners[::-1]
    owner = {edge: key for key, piece in pieces.items() for edge in _edges(piece)}
    shared = [(a, b) for a, b in owner if a < b and (b, a) in owner]
    lengths = {(a, b): float(np.linalg.norm(points[a] - points[b])) for a, b in shared}
    for a, b in sorted(shared, key=lambda edge: (-lengths[edge], edge)):
        one, other = owner[a, b], owner[b, a]
        joined = [*_from(pieces[one], b), *_from(pieces[other], a)[1:-1]]
        if one == other or not is_convex(points[joined]):
            continue
        pieces[one] = joined
        del pieces[other]
        owner |= dict.fromkeys(_edges(joined), one)
    return [points[piece] for piece in pieces.values()]


def _edges(piece: list[int]) -> list[tuple[int, int]]:
    return list(zip(piece, [*piece[1:], piece[0]], strict=True))


def _from(piece: list[int], first: int) -> list[int]:
    """Return a closed line that begins with a corner."""
    at = piece.index(first)
    return piece[at:] + piece[:at]


def is_convex(line: Array) -> bool:
    """Return True if no corner of a counter-clockwise line is a dent."""
    before, after = np.roll(line, 1, axis=0), np.roll(line, -1, axis=0)
    chord = after - before
    out = line - before
    side = out[:, 0] * chord[:, 1] - out[:, 1] * chord[:, 0]
    return bool((side >= -_DENT * np.linalg.norm(chord, axis=1)).all())
