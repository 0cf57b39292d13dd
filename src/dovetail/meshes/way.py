"""The way of a plug into its socket, straight down, by level sections of both."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.meshes.read import Mesh
from dovetail.meshes.slices import BAND, Sections, Slicer, TurningSections
from dovetail.types import Array, Vec3
from dovetail.workcell.planar import import_shapely

NEAR = 1.5e-3
"""Distance from the other part up to which a part is near [m]."""
_OVERLAP = 1e-5
"""Width up to which sections overlap by rounding [m]."""
_GRID = 1e-7
"""Distance to which corners of united sections are rounded [m]."""
_SLIVER = 5e-5
"""Width of an overlap up to which the socket is cut back [m]: two faces that CAD has in
one place, or a press fit."""
_SEAT = 1e-3
"""Way before its end on which a plug may meet what ends it, such as a cone [m]."""
_DEEP = 8e-6
"""Depth up to which level faces are in one another by rounding [m]."""
_LIFT = 2e-4
"""Most by which a plug is lifted out of a level face [m]."""
_MOST = 48
"""Most heights between two level faces."""
_APART = 3e-3
"""Gap beyond which two sections do not mate [m]."""
_WAYS, _STEPS = 8, 10
"""Directions in which a plug is moved to see what stops it, and steps of each."""
_BLOCKED = 1e-9
"""Overlap that stops it [m2]."""
AXES = {
    "-z": np.eye(3),
    "+z": np.diag([1.0, -1.0, -1.0]),
    "-x": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    "+x": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    "-y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "+y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}
"""Ways in, in the files' axes, and the rotation that turns each to -z."""


class Overlap(NamedTuple):
    """Place at which the parts overlap most in the plane."""

    area: float
    """Of the overlap of two sections [m2]."""
    at: Vec3
    """Its middle, in the files' axes [m]."""
    is_assembled: bool
    """True if they overlap where they stand in the end, not only on the way in."""
    is_sliver: bool = False
    """True if every overlap is so narrow that the socket can be cut back."""


class Gap(NamedTuple):
    """Gap between the walls of plug and socket, in the plane.

    Walls count where they are at most twice the least gap and 0.2 mm apart.
    """

    low: float
    """5 % of the wall has less [m]."""
    median: float
    """[m]"""
    high: float
    """5 % of the wall has more [m]."""
    least: float
    """[m]"""
    at: Vec3
    """Place at which it is tightest [m]."""


class CutBack:
    """Sections of a socket without what its plug passes."""

    def __init__(
        self,
        socket: TurningSections,
        plug: TurningSections,
        swept: Callable[[float], Any],
    ) -> None:
        """Take the sections of both, and what the plug passes above its end."""
        self._socket, self._swept, self._end = socket, swept, plug.low
        self.low, self.high = socket.low, socket.high
        self.jumps = np.union1d(socket.jumps, plug.jumps)
        self.turns = np.union1d(socket.turns, plug.turns)

    def at(self, z: float) -> Any:
        """Return the section at a height [m], as an area of shapely."""
        section = self._socket.at(z)
        return section.difference(self._swept(z)) if z > self._end else section


class Way:
    """A plug that goes down into a socket, as far as it stands in the files."""

    def __init__(self, plug: Mesh, socket: Mesh, axis: str) -> None:
        """Turn both so that the way in is -z."""
        self.axis, self.turn = axis, AXES[axis]
        self.mesh = plug
        self._shapely = import_shapely()
        self.plug = Slicer(plug.vertices @ self.turn.T, plug.faces)
        self.socket: TurningSections = Slicer(
            socket.vertices @ self.turn.T, socket.faces
        )
        self.pressed: Overlap | None = None
        """Overlap with a socket that is cut back before the plug's end, if any."""
        self._plug_at = _heights(self.plug)
        self._socket_at = _heights(self.socket)
        self._swept = self._sums(self.plug, self._plug_at)
        self._above = self._sums(self.socket, self._socket_at[::-1])[::-1]
        beside = int(np.searchsorted(self._socket_at, self.plug.low + _DEEP))
        nothing = self._shapely.Polygon()
        self._comes_in = self._above[beside] if beside < len(self._above) else nothing

    def cut_back(self) -> None:
        """Cut the socket back where the plug passes."""
        self.pressed = self.overlap(_SEAT)
        self.socket = CutBack(self.socket, self.plug, self.swept)

    @property
    def heights(self) -> Array:
        """Heights of sections of either part where both have one, lowest first [m]."""
        found = np.union1d(self._plug_at, self._socket_at)
        low = max(self.plug.low, self.socket.low)
        high = min(self.plug.high, self.socket.high)
        return found[(found > low) & (found < high)]

    def _sums(self, slicer: Sections, heights: Array) -> list[Any]:
        """Return the union of the first sections, of the first two, and so on."""
        shapely = self._shapely
        found, area = [], shapely.Polygon()
        for z in heights.tolist():
            section = slicer.at(z)
            if not area.covers(section):
                # On a grid: sections that differ by rounding add no corners for ever.
                both = shapely.union(area, section, grid_size=_GRID)
                parts = shapely.get_parts(both)
                is_area = shapely.get_dimensions(parts) == 2  # no leftover line
                area = shapely.multipolygons(shapely.get_parts(parts[is_area]))
            found.append(area)
        return found

    def swept(self, z: float) -> Any:
        """Return what the plug passes at a height on its way, an area of shapely."""
        i = int(np.searchsorted(self._plug_at, z))
        if i == 0:
            return self._swept[0]
        return self._swept[min(i, len(self._swept) - 1)]

    def socket_above(self, z: float) -> Any:
        """Return the union of the socket's sections from a height on."""
        i = int(np.searchsorted(self._socket_at, z)) - 1
        if i + 1 >= len(self._above) and z > self.socket.high:
            return self._shapely.Polygon()
        return self._above[max(i, 0)]

    def without_empty_openings(self, area: Any) -> Any:
        """Return a section of the plug without openings that nothing comes into."""
        shapely = self._shapely
        parts = []
        for one in shapely.get_parts(area):
            openings = [
                line
                for line in one.interiors
                if shapely.Polygon(line).intersects(self._comes_in)
            ]
            parts.append(shapely.Polygon(one.exterior, openings))
        return shapely.union_all(parts)

    def lift(self) -> float | None:
        """Return how far to lift a plug whose level faces are in the socket's [m].

        Returns:
            The way up, at most 0.2 mm; None where that does not free it.
        """
        ways = (self.socket.jumps[:, None] - self.plug.jumps[None]).ravel()
        for way in np.unique(ways[(ways > 0.0) & (ways <= _LIFT)]).tolist():
            if self.overlap(way) is None:
                return way
        return None

    def overlap(self, lift: float = 0.0) -> Overlap | None:
        """Return where the parts overlap most on the way, or None.

        Args:
            lift: How much higher the plug ends than it stands [m].
        """
        found, is_sliver = None, True
        for z in self._socket_at.tolist():
            below = z - _DEEP - lift
            i = int(np.searchsorted(self._plug_at, below))
            own = self.plug.at(below)
            passed = own.union(self._swept[i - 1]) if i else own
            common = passed.intersection(self.socket.at(z))
            if common.is_empty or common.buffer(-_OVERLAP / 2.0).is_empty:
                continue
            is_sliver &= common.buffer(-_SLIVER / 2.0).is_empty
            if found is None or common.area > found.area:
                middle = common.representative_point()
                place = self.turn.T @ np.array([middle.x, middle.y, z])
                inside = own.intersection(self.socket.at(z))
                is_assembled = not inside.buffer(-_OVERLAP / 2.0).is_empty
                found = Overlap(common.area, place, is_assembled)
        return found and found._replace(is_sliver=is_sliver)

    def gap(self) -> Gap | None:
        """Return the gap between the walls, or None where nothing mates."""
        shapely = self._shapely
        bottom = max(self.plug.low, self.socket.low)
        top = min(self.plug.high, self.socket.high)
        if top - bottom < 1e-4:
            return None
        gaps, places = [], []
        for z in (bottom + (top - bottom) * (np.arange(30) + 0.5) / 30.0).tolist():
            wall, around = self.plug.at(z), self.socket.at(z)
            if wall.is_empty or around.is_empty:
                continue
            points = along(wall, 3e-4)
            shapely.prepare(around)
            distances = shapely.distance(shapely.points(points), around)
            gaps.append(distances)
            places.append(np.insert(points, 2, z, axis=1))
        if not gaps:
            return None
        all_gaps, points = np.concatenate(gaps), np.vstack(places)
        if (tightest := float(all_gaps.min())) > _APART:
            return None
        mates = all_gaps <= 2.0 * tightest + 2e-4
        all_gaps, points = all_gaps[mates], points[mates]
        low, median, high = np.quantile(all_gaps, [0.05, 0.5, 0.95]).tolist()
        least = int(all_gaps.argmin())
        return Gap(low, median, high, float(all_gaps[least]), points[least])

    def mouth(self) -> float:
        """Return the height of the highest point of the socket near the plug [m]."""
        low = max(self.plug.low, self.socket.low)
        levels = np.unique([*self._socket_at, *self._plug_at])
        levels = levels[(levels > low) & (levels < self.socket.high)]
        high = self.socket.high
        for z in levels[::-1].tolist():
            if self._is_near(z):
                return self._highest(z, high)
            high = z
        return self.socket.high

    def _is_near(self, z: float) -> bool:
        section = self.socket.at(z)
        return not section.is_empty and bool(section.dwithin(self.swept(z), NEAR))

    def _highest(self, low: float, high: float) -> float:
        """Return the height between two up to which the socket is near the plug."""
        inside = [z for z in self.socket.jumps.tolist() if low < z <= high + 1e-6]
        for z in inside:
            if not self._is_near(z + 2e-6):
                return z
        for _ in range(12):
            middle = (low + high) / 2.0
            low, high = (middle, high) if self._is_near(middle) else (low, middle)
        return low

    def is_through(self) -> bool:
        """Say whether nothing of the socket is below the plug's end."""
        tip = self._swept[0]
        end = self.plug.low
        below = [z for z in self._socket_at.tolist() if z < end]
        floors = [self.socket.at(z).intersection(tip).area for z in below]
        return max(floors, default=0.0) < 0.02 * tip.area


def along(area: Any, spacing: float) -> Array:
    """Return points along the boundary of an area, shape (points, 2)."""
    shapely = import_shapely()
    line = shapely.segmentize(shapely.boundary(area), spacing)
    return shapely.get_coordinates(line)


def _heights(slicer: TurningSections) -> Array:
    """Return heights at which to take a mesh's sections, next to level faces, too."""
    levels = [slicer.low]
    for z in slicer.jumps.tolist():
        if levels[-1] + 3e-5 < z < slicer.high - 3e-5:
            levels.append(z)
    levels.append(slicer.high)
    found = []
    for a, b in pairwise(levels):
        count = int(np.clip(np.ceil((b - a) / BAND), 2, _MOST))
        inset = min(2e-6, (b - a) / 10.0)
        found += np.linspace(a + inset, b - inset, count).tolist()
    return np.union1d(found, slicer.turns)


def find_way(plug: Mesh, socket: Mesh, axis: str | None = None) -> Way:
    """Return the way in.

    Args:
        plug: Where it stands in the end.
        socket: In the same frame.
        axis: Way in: -z, +z, -x, +x, -y or +y; None tries them in this order.

    Raises:
        ConfigError: The parts are not in a common frame, overlap, or the plug does not
            go in straight; says where.
    """
    if axis is not None and axis not in AXES:
        raise ConfigError(
            f"axis is {axis[:20]!r}; known: {', '.join(AXES)}",
            name="axis",
            value=axis,
            allowed=tuple(AXES),
        )
    (a, b), (c, d) = plug.box, socket.box
    if (np.minimum(b, d) - np.maximum(a, c)).min() < -_APART:
        middle, other = (", ".join(_mm((p + q) / 2.0)) for p, q in ((a, b), (c, d)))
        raise ConfigError(
            f"plug and socket are not in a common frame: their boxes' middles are at "
            f"({middle}) and ({other}) mm, and they do not meet. Export both from the "
            "assembly, with its origin",
            name="mesh",
        )
    worst: Overlap | None = None
    free = []
    for name in [axis] if axis else AXES:
        way = Way(plug, socket, name)
        overlap = way.overlap()
        if overlap and overlap.is_assembled and (lift := way.lift()):
            way = Way(_lifted(plug, lift * way.turn[2]), socket, name)
            overlap = way.overlap()
        if overlap and overlap.is_sliver:
            way.mesh = _noted(
                way.mesh,
                f"the socket is cut back by up to {1e3 * _SLIVER:g} mm where the plug "
                f"is in it, about ({', '.join(_mm(overlap.at))}) mm",
            )
            way.cut_back()
            overlap = None
        if overlap is None and (axis or _is_guided(way)):
            return way
        if overlap is None:
            free.append(name)
        elif worst is None or overlap.area < worst.area:
            worst = overlap
    if free or worst is None:  # without the second, worst might be None below
        raise _does_not_mate(free, worst)
    raise _does_not_go_in(worst, axis)


def _lifted(plug: Mesh, move: Vec3) -> Mesh:
    """Return a plug a little higher, which says so."""
    note = (
        f"lifted by {1e3 * float(np.linalg.norm(move)):.3f} mm: a level face of it was "
        "inside one of the socket"
    )
    return _noted(plug._replace(vertices=plug.vertices + move), note)


def _noted(mesh: Mesh, note: str) -> Mesh:
    return mesh._replace(notes=(*mesh.notes, note))


def _is_guided(way: Way) -> bool:
    """Say whether the socket stops the plug in two opposite directions, sideways.

    It does not stop one that stands beside a single wall, or on the socket's top.
    """
    if way.gap() is None:
        return False
    translate = import_shapely().affinity.translate
    angles = np.arange(_WAYS) * 2.0 * np.pi / _WAYS
    blocked = np.zeros(_WAYS, bool)
    steps = _APART * np.arange(1, _STEPS + 1)[:, None] / _STEPS
    for z in way.heights.tolist():
        own, around = way.plug.at(z), way.socket.at(z)
        if own.is_empty or around.is_empty:
            continue
        for i in np.flatnonzero(~blocked).tolist():
            moves = steps * [np.cos(angles[i]), np.sin(angles[i])]
            blocked[i] = any(
                translate(own, x, y).intersection(around).area > _BLOCKED
                for x, y in moves.tolist()
            )
        if (blocked & np.roll(blocked, _WAYS // 2)).any():
            return True
    return False


def _mm(place: Array) -> list[str]:
    return [f"{1e3 * v:.4g}" for v in place]


def _does_not_mate(free: list[str], worst: Overlap | None) -> ConfigError:
    also = ""
    if worst is not None:
        place = ", ".join(_mm(worst.at))
        also = f" Along the others it overlaps, about ({place}) mm."
    return ConfigError(
        f"plug and socket do not mate: the plug is free along {', '.join(free)}, and "
        f"walls of the socket do not stop it within {1e3 * _APART:g} mm on two "
        f"opposite sides.{also} Export both as they stand when assembled: the plug in "
        "the socket, not on it",
        name="mesh",
    )


def _does_not_go_in(overlap: Overlap, axis: str | None) -> ConfigError:
    place = ", ".join(_mm(overlap.at))
    size = f"{1e6 * overlap.area:.3g} mm2 about ({place}) mm"
    if overlap.is_assembled:
        return ConfigError(
            f"plug and socket overlap where they stand in the end, by {size}: the plug "
            "is too large, or one of them is not where it belongs",
            name="mesh",
            value=overlap.area,
            unit="m2",
        )
    ways = f"along {axis}" if axis else "along any axis of the files"
    return ConfigError(
        f"the plug does not go in straight {ways}: on the way it overlaps the socket "
        f"by {size}, an undercut. Give parts that go in straight, or another axis",
        name="mesh",
        value=overlap.area,
        unit="m2",
    )
