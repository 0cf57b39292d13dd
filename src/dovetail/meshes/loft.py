"""Areas between two level sections: corners of one led to corners of the other."""

from typing import Any, NamedTuple

import numpy as np

from dovetail.types import Array
from dovetail.workcell.outline import Outline
from dovetail.workcell.planar import import_shapely
from dovetail.workcell.sections import convex_pieces

_LINE_MAX = 160
"""Most corners of a line that is led to another."""


class Leaning(NamedTuple):
    """An area at the middle height, and how far each corner moves up to the upper."""

    outer: Array
    """Corners around it [m], counter-clockwise."""
    cutouts: tuple[Array, ...]
    """Corners around its openings [m], counter-clockwise."""
    lean: Array
    """Way of each corner from the middle to the upper height [m], openings' after."""

    def polygon(self, share: float = 0.0) -> Any:
        """Return it between the lower (-1) and the upper (1) height."""
        lines, at = [], 0
        for line in (self.outer, *self.cutouts):
            lines.append(line + share * self.lean[at : at + len(line)])
            at += len(line)
        return import_shapely().Polygon(lines[0], lines[1:])


def bulges(leaning: Leaning, near: Any, tolerance: float) -> bool:
    """Say whether hulls of pieces would leave the area near the other part.

    An engine builds convex pieces: each is cut out at the middle height, and must still
    be convex where its corners are at the lower and at the upper height.
    """
    shapely = import_shapely()
    middle = np.vstack([leaning.outer, *leaning.cutouts])
    index = {tuple(corner): i for i, corner in enumerate(middle.tolist())}
    for piece in convex_pieces(Outline(leaning.outer, leaning.cutouts)):
        rows = [index[x, y] for x, y in piece.tolist()]
        for sign in (-1.0, 1.0):
            corners = middle[rows] + sign * leaning.lean[rows]
            area = shapely.make_valid(shapely.Polygon(corners))
            hull = shapely.MultiPoint(corners).convex_hull
            if hull.area - area.area < 1e-12:
                continue
            if near is not None and not hull.intersects(near):
                continue
            if not area.buffer(tolerance).covers(hull):
                return True
    return False


def loft(low: Any, high: Any, tolerance: float) -> list[Leaning] | None:
    """Return areas that lead from one section to the other, or None.

    Args:
        low: Lower section, an area of shapely.
        high: Upper one.
        tolerance: Up to which corners are left out [m].
    """
    shapely = import_shapely()
    below, above = (shapely.get_parts(one).tolist() for one in (low, high))
    if not below or len(below) != len(above):
        return None
    found = []
    for one in below:
        other = min(above, key=lambda area: area.centroid.distance(one.centroid))
        above.remove(other)
        leaning = _loft_one(one, other, tolerance)
        if leaning is None:
            return None
        found.append(leaning)
    return found


def _loft_one(low: Any, high: Any, tolerance: float) -> Leaning | None:
    if len(low.interiors) != len(high.interiors):
        return None
    left = list(high.interiors)
    pairs = [(low.exterior, high.exterior)]
    for opening in low.interiors:
        other = min(left, key=lambda line: line.centroid.distance(opening.centroid))
        left.remove(other)
        pairs.append((opening, other))
    lines = []
    for one, other in pairs:
        both = _lead(_corners(one, tolerance / 4.0), _corners(other, tolerance / 4.0))
        if both is None or len(both := _fewer(both, tolerance)) < 3:
            return None
        lines.append(both)
    middle = [(both[:, :2] + both[:, 2:]) / 2.0 for both in lines]
    lean = np.vstack([(both[:, 2:] - both[:, :2]) / 2.0 for both in lines])
    found = Leaning(middle[0], tuple(middle[1:]), lean)
    return found if found.polygon().is_valid else None


def _corners(line: Any, tolerance: float) -> Array:
    """Return the corners of a closed line, counter-clockwise, each once."""
    corners = np.array(line.simplify(tolerance).coords)[:-1]
    return corners if line.is_ccw else corners[::-1]


def _lead(low: Array, high: Array) -> Array | None:
    """Return pairs of corners along two lines with the least sum of squared ways.

    Returns:
        x y of a lower and x y of its upper corner, shape (pairs, 4); None where there
        are too many.
    """
    if not 3 <= min(len(low), len(high)) <= max(len(low), len(high)) <= _LINE_MAX:
        return None
    ways = ((low[:, None] - high[None]) ** 2).sum(axis=2)
    i, j = np.unravel_index(ways.argmin(), ways.shape)
    low, high = np.roll(low, -i, axis=0), np.roll(high, -j, axis=0)
    cost = np.roll(ways, (-i, -j), axis=(0, 1)).tolist()
    n, m = len(low), len(high)
    total = [[0.0] * m for _ in range(n)]
    for r in range(n):
        row, before = total[r], total[r - 1]
        for c in range(m):
            if r and c:
                least = min(before[c - 1], before[c], row[c - 1])
            elif r:
                least = before[c]
            else:
                least = row[c - 1] if c else 0.0
            row[c] = cost[r][c] + least
    path, r, c = [(n - 1, m - 1)], n - 1, m - 1
    while r or c:
        steps = [(r - 1, c - 1)] if r and c else []
        steps += [(r - 1, c)] if r else []
        steps += [(r, c - 1)] if c else []
        r, c = min(steps, key=lambda at: total[at[0]][at[1]])
        path.append((r, c))
    rows, columns = np.array(path[::-1]).T
    return np.hstack([low[rows], high[columns]])


def _fewer(points: Array, tolerance: float) -> Array:
    """Leave out points of a closed line that are on chords, in each pair of columns."""
    far = int(((points - points[0]) ** 2).sum(axis=1).argmax())
    closed = np.vstack([points, points[:1]])
    kept = {0, far}
    _keep(closed, 0, far, tolerance, kept)
    _keep(closed, far, len(points), tolerance, kept)
    return points[sorted(kept - {len(points)})]


def _keep(
    points: Array, first: int, last: int, tolerance: "float | Array", kept: set[int]
) -> None:
    """Add the points between two others that no chord stands for (Douglas-Peucker).

    The tolerance may be one for each point.
    """
    limits = np.broadcast_to(np.asarray(tolerance, dtype=float), len(points))
    spans = [(first, last)]
    while spans:
        i, j = spans.pop()
        if j - i < 2:
            continue
        between = points[i + 1 : j]
        excess = np.zeros(len(between))
        for k in range(0, points.shape[1], 2):
            a, b = points[i, k : k + 2], points[j, k : k + 2]
            excess = np.maximum(excess, _beside(between[:, k : k + 2], a, b))
        excess = excess - limits[i + 1 : j]
        worst = int(excess.argmax())
        if excess[worst] > 0.0:
            at = i + 1 + worst
            kept.add(at)
            spans += [(i, at), (at, j)]


def _beside(points: Array, a: Array, b: Array) -> Array:
    """Return distances of points from a straight line between two ends."""
    along = b - a
    square = float(along @ along)
    share = (points - a) @ along / square if square else np.zeros(len(points))
    share = np.clip(share, 0.0, 1.0)
    return np.linalg.norm(points - a - share[:, None] * along, axis=1)


def fewer_corners(area: Any, near: Any, fine: float, coarse: float) -> Any:
    """Return an area with fewer corners, exact where it matters.

    Args:
        area: An area of shapely.
        near: Where it matters; None is nowhere.
        fine: Tolerance there [m].
        coarse: Tolerance elsewhere [m].
    """
    shapely = import_shapely()
    if near is None or near.is_empty:
        return area.simplify(coarse)
    shapely.prepare(near)
    found = []
    for one in shapely.get_parts(area):
        lines = []
        for line in (one.exterior, *one.interiors):
            corners = np.array(line.coords)[:-1]
            ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            edges = shapely.intersects(shapely.linestrings(ends), near)
            inside = edges | np.roll(edges, 1)  # an edge of the corner is near
            if not inside.any():
                kept = np.array(shapely.LinearRing(corners).simplify(coarse).coords)
            else:
                kept = _fewer_along(corners, np.where(inside, fine, coarse))
            if len(kept) >= 3:
                lines.append(kept)
        if lines:
            new = shapely.Polygon(lines[0], lines[1:])
            # A far chord may cross a near line: then all is fine.
            found.append(new if new.is_valid else one.simplify(fine))
    return shapely.union_all(found)


def _fewer_along(corners: Array, tolerance: Array) -> Array:
    far = int(((corners - corners[0]) ** 2).sum(axis=1).argmax())
    closed = np.vstack([corners, corners[:1]])
    limits = np.append(tolerance, tolerance[0])
    kept = {0, far}
    _keep(closed, 0, far, limits, kept)
    _keep(closed, far, len(corners), limits, kept)
    return corners[sorted(kept - {len(corners)})]
