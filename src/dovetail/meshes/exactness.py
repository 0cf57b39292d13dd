"""Convex pieces beside the meshes that they stand for: clearance and end of the way."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from dovetail.meshes.slices import Sections
from dovetail.meshes.way import Gap, along
from dovetail.types import Array
from dovetail.workcell.parts import Part
from dovetail.workcell.planar import import_shapely

CLEARANCE = 2e-5, 0.1
"""Allowed error of the clearance [m], or the share of the gap, if that is larger."""
STOP = 1e-4
"""Allowed error of the depth at which the way ends [m]."""
REACH = 4e-3
"""Depth beyond the assembled pose in which the end of the way is looked for [m]."""
_WALL = 1e-4
"""Distance beyond the largest gap up to which a place is a wall that mates [m]."""
_CONTACT = 6e-6
"""Width of an overlap that is a contact [m]."""
_LEVEL = 2e-9
"""Distance from the end of a piece at which a section is taken above it [m]."""
_HEIGHTS = 50
_SLOPES = 24
_HALVINGS = 9


class Exactness(NamedTuple):
    """Pieces beside the meshes."""

    low: float
    """5 % of the walls have a clearance whose error is below this [m]."""
    high: float
    """5 % have one above this [m]; negative is narrower than the meshes."""
    worst: float
    """Largest error of the clearance, by size [m]."""
    allowed: float
    """Largest error at 5 and at 95 % that is exact enough [m]."""
    stop_mesh: float | None
    """Way of the plug's mesh from the assembled pose down to the first contact [m];
    None where nothing ends it within 4 mm."""
    stop_pieces: float | None
    """The same of the pieces [m]."""

    @property
    def stop_error(self) -> float:
        """Depth by which the pieces go deeper than the meshes [m]."""
        if self.stop_mesh is None and self.stop_pieces is None:
            return 0.0
        ends = (REACH if s is None else s for s in (self.stop_mesh, self.stop_pieces))
        mesh, pieces = ends
        return pieces - mesh

    def why_not(self) -> list[str]:
        """Return what is not exact enough, one sentence each."""
        reasons = []
        if max(-self.low, self.high) > self.allowed:
            reasons.append(
                f"the pieces' clearance is off by {1e3 * self.low:.3f} to "
                f"{1e3 * self.high:.3f} mm (5 to 95 %); allowed: "
                f"{1e3 * self.allowed:.3f} mm"
            )
        if abs(self.stop_error) > STOP:
            reasons.append(
                f"the pieces stop {1e3 * self.stop_error:.3f} mm deeper than the "
                f"meshes; allowed: {1e3 * STOP:g} mm"
            )
        return reasons


class PieceSections:
    """Sections of the convex pieces of a part."""

    def __init__(self, part: Part) -> None:
        """Sort the corners of each piece by height."""
        self._shapely = import_shapely()
        self._pieces = [piece.corners() for piece in part.primitives]
        ends = [(p[:, 2].min(), p[:, 2].max()) for p in self._pieces]
        self._low, self._high = np.array(ends).T
        self.low, self.high = float(self._low.min()), float(self._high.max())
        self.jumps: Array = np.unique(np.append(self._low, self._high).round(9))
        self._known: dict[float, Any] = {}

    def at(self, z: float) -> Any:
        """Return the section at a height [m], as an area of shapely."""
        if np.abs(self.jumps - z).min() < _LEVEL:  # two pieces meet, neither is cut
            z += 2.0 * _LEVEL
        if z not in self._known:
            active = np.flatnonzero((self._low < z) & (self._high > z)).tolist()
            cuts = [_cut(self._pieces[i], z) for i in active]
            counts = [len(cut) for cut in cuts]
            if not cuts:
                self._known[z] = self._shapely.Polygon()
                return self._known[z]
            hulls = self._shapely.convex_hull(
                self._shapely.multipoints(
                    np.vstack(cuts), indices=np.repeat(np.arange(len(cuts)), counts)
                )
            )
            self._known[z] = self._shapely.union_all(hulls)
        return self._known[z]


def _cut(corners: Array, z: float) -> Array:
    """Return points whose hull is the section of a hull at a height."""
    above = corners[:, 2] > z
    low, high = corners[~above], corners[above]
    if low.shape == high.shape and (low[:, :2] == high[:, :2]).all():
        return low[:, :2]
    share = (z - low[:, None, 2:]) / (high[None, :, 2:] - low[:, None, 2:])
    cut = low[:, None, :2] + share * (high[None, :, :2] - low[:, None, :2])
    return cut.reshape(-1, 2)


class Shifted(NamedTuple):
    """Sections seen in another frame, its origin moved."""

    body: Sections
    origin: Array
    change: Callable[[Any], Any] = lambda area: area

    @property
    def jumps(self) -> Array:
        """Heights of level faces [m]."""
        return self.body.jumps - self.origin[2]

    @property
    def low(self) -> float:
        """Lowest height [m]."""
        return self.body.low - float(self.origin[2])

    @property
    def high(self) -> float:
        """Highest height [m]."""
        return self.body.high - float(self.origin[2])

    def at(self, z: float) -> Any:
        """Return the section at a height [m], as an area of shapely."""
        x, y, height = self.origin.tolist()
        section = self.change(self.body.at(z + height))
        return import_shapely().transform(section, lambda points: points - [x, y])


def exactness_of(
    meshes: tuple[Sections, Sections], pieces: tuple[Sections, Sections], gap: Gap
) -> Exactness:
    """Return how exactly pieces stand for meshes.

    Args:
        meshes: Of plug and socket, where they stand in the end, z out of the socket.
        pieces: Of the same.
        gap: Between the walls.
    """
    errors = _clearance_errors(meshes, pieces, gap)
    low, high = np.quantile(errors, [0.05, 0.95]).tolist() if len(errors) else (0, 0)
    worst = float(errors[np.abs(errors).argmax()]) if len(errors) else 0.0
    least, share = CLEARANCE
    return Exactness(
        float(low),
        float(high),
        worst,
        max(least, share * gap.low),
        end_of_way(*meshes, pieces[1].jumps),
        end_of_way(*pieces, pieces[1].jumps),
    )


def _clearance_errors(
    meshes: tuple[Sections, Sections], pieces: tuple[Sections, Sections], gap: Gap
) -> Array:
    """Return errors of the clearance at places of the walls that mate [m]."""
    shapely = import_shapely()
    plug, socket = meshes
    low, high = max(plug.low, socket.low), min(plug.high, socket.high)
    found = [np.zeros(0)]
    for z in (low + (high - low) * (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS).tolist():
        wall, around = plug.at(z), socket.at(z)
        if wall.is_empty or around.is_empty:
            continue
        points = shapely.points(along(wall, 5e-4))
        distances = shapely.distance(points, around)
        is_wall = distances < gap.high + _WALL
        points = points[is_wall]
        if not len(points):
            continue
        own, other = (one.at(z) for one in pieces)
        inside = shapely.distance(points, shapely.boundary(own))
        outside = shapely.distance(points, own)
        smaller = np.where(outside > 0.0, outside, -inside)
        clearance = shapely.distance(points, other) + smaller
        errors = clearance - distances[is_wall]
        found.append(np.nan_to_num(errors, nan=REACH))  # there is no piece at all
    return np.concatenate(found)


def end_of_way(plug: Sections, socket: Sections, heights: Array) -> float | None:
    """Return how far a plug goes down until it first meets the socket [m].

    Args:
        plug: Where it stands in the end.
        socket: In the same frame.
        heights: Next below which slopes of the socket may be met, beside others.

    Returns:
        The way, None where it is more than `REACH`.
    """
    level = _first_level(plug, socket)
    most = REACH if level is None else level
    low = max(plug.low - most, socket.low)
    high = min(plug.high, socket.high)
    inner = heights[(heights > low) & (heights <= high + 1e-6)]
    inner = inner[:: -max(1, len(inner) // _SLOPES)]
    tops = socket.high - np.array([0.0, 2e-5, 1e-4, 2e-4, 4e-4, 8e-4])
    tried = [np.linspace(low, high, _SLOPES + 2)[1:-1], inner, tops]
    way = most - 2e-5  # next to the level faces' contact, not in it
    hits = [
        z for z in (np.concatenate(tried) - 2e-6) if _meet(plug, socket, float(z), way)
    ]
    if way <= 0.0 or not hits:
        return level
    free, met = 0.0, way
    for _ in range(_HALVINGS):
        middle = (free + met) / 2.0
        if any(_meet(plug, socket, z, middle) for z in hits):
            met = middle
        else:
            free = middle
    return met


def _meet(plug: Sections, socket: Sections, z: float, way: float) -> bool:
    """Say whether a plug that has gone so far down overlaps the socket at a height."""
    section = socket.at(z)
    if section.is_empty:
        return False
    common = plug.at(z + way).intersection(section)
    return not common.is_empty and not common.buffer(-_CONTACT / 2.0).is_empty


def _first_level(plug: Sections, socket: Sections) -> float | None:
    """Return the least way after which a level face of the plug lies on a socket's."""
    ways = plug.jumps[:, None] - socket.jumps[None]
    rows, columns = np.nonzero((ways > -STOP) & (ways < REACH))
    order = np.argsort(ways[rows, columns])
    for i, j in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        lower = socket.at(float(socket.jumps[j]) - 2e-6)
        upper = plug.at(float(plug.jumps[i]) + 2e-6)
        common = upper.intersection(lower)
        if not common.is_empty and not common.buffer(-_CONTACT).is_empty:
            return float(ways[i, j])
    return None
