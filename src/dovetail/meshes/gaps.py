"""Gap between a plug and its socket, all round and at many heights."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dovetail.types import Array
from dovetail.workcell.planar import import_shapely

_SPACING = 2e-4
"""Between points on the plug's outline [m]."""
_FAR = 0.003
"""A wall that is further from the plug is not looked at [m]."""
_LEADS = 0.001
"""A wall that is at most so far from the plug leads it [m]."""


@dataclass(frozen=True, kw_only=True)
class Gaps:
    """Distances from the plug's outline to the socket, at one height."""

    z: float
    """Height [m]."""
    points: Array
    """Points on the plug's outline that face the socket [m], shape (points, 2)."""
    gaps: Array
    """Distance of each to the socket [m]; negative inside of it."""
    walls: Array
    """Nearest point of the socket to each [m], shape (points, 2)."""


def gaps_at(z: float, plug: Any, socket: Any) -> Gaps:
    """Return the gap between two sections at one height.

    Args:
        z: The height [m].
        plug: Section of the plug, an area of shapely [m].
        socket: Section of the socket.
    """
    shapely = import_shapely()
    line = shapely.segmentize(plug.boundary, _SPACING)
    points = shapely.points(shapely.get_coordinates(line))
    wall = socket.boundary
    if not len(points) or wall.is_empty:
        return Gaps(
            z=z, points=np.empty((0, 2)), gaps=np.empty(0), walls=np.empty((0, 2))
        )
    distances = shapely.distance(points, wall)
    shapely.prepare(socket)
    signed = np.where(shapely.contains_properly(socket, points), -distances, distances)
    near = signed <= _FAR
    lines = shapely.shortest_line(points[near], wall)
    ends = shapely.get_coordinates(lines).reshape(-1, 2, 2)
    # the back of a thin plug is near the wall, too, but does not face it
    shapely.prepare(plug)
    faces = ~shapely.contains_properly(plug, shapely.points(ends.mean(axis=1)))
    faces |= signed[near] <= 0.0
    return Gaps(
        z=z, points=ends[faces, 0], gaps=signed[near][faces], walls=ends[faces, 1]
    )


@dataclass(frozen=True, kw_only=True)
class Clearance:
    """Gap between plug and socket over the height."""

    levels: tuple[Gaps, ...]
    """The gap at each height, lowest first."""

    @property
    def quartiles(self) -> tuple[float, float, float]:
        """Quarter, half and three quarters of the gaps are at most this wide [m].

        Walls that do not lead the plug are left out: they are over 1 mm away, and over
        twice the least gap.
        """
        gaps = np.concatenate([level.gaps for level in self.levels])
        gaps = gaps[gaps <= max(_LEADS, 2.0 * float(gaps.min()) + 2e-4)]
        low, middle, high = np.quantile(gaps, (0.25, 0.5, 0.75))
        return float(low), float(middle), float(high)

    @property
    def tightest(self) -> tuple[Gaps, int]:
        """The height with the smallest gap, and the number of its point."""
        found = [level for level in self.levels if len(level.gaps)]
        level = min(found, key=lambda one: float(one.gaps.min()))
        return level, int(level.gaps.argmin())

    @property
    def is_measured(self) -> bool:
        """True where the plug faces the socket anywhere."""
        return any(len(level.gaps) for level in self.levels)
