"""Level sections of a closed mesh, as areas of shapely."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dovetail.errors import ConfigError
from dovetail.types import Array
from dovetail.workcell.planar import import_shapely

_SAME = 1e-6
"""Distance up to which heights are one, and up to which corners are on a line [m]."""
_LEVEL = 0.9998
"""Least vertical part of the normal of a level face."""
_UPRIGHT = 1e-3
"""Largest vertical part of the normal of an upright face."""
BAND = 1.5e-3
"""Distance of sections that are taken where nothing tells to take more [m]."""
_BESIDE = 2e-6
"""Distance from such a height at which a section is taken [m]."""
_NEAR, _MOST = 2e-5, 200
"""Distance up to which heights at which walls turn are one [m], and most of them."""


class Sections(Protocol):
    """A body that has a section at each height."""

    @property
    def jumps(self) -> Array:
        """Heights of level faces, lowest first [m]."""
        ...

    @property
    def low(self) -> float:
        """Lowest height [m]."""
        ...

    @property
    def high(self) -> float:
        """Highest height [m]."""
        ...

    def at(self, z: float) -> Any:
        """Return the section at a height [m], as an area of shapely."""
        ...


class TurningSections(Sections, Protocol):
    """Sections of which it is known where they may be widest."""

    @property
    def turns(self) -> Array:
        """Heights beside which walls turn, see `Slicer`, lowest first [m]."""
        ...


class Slicer:
    """Sections of a mesh at any height."""

    def __init__(self, vertices: Array, faces: NDArray[np.int64]) -> None:
        """Take over a closed mesh, its triangles seen from outside [m]."""
        self._shapely = import_shapely()
        self._vertices, self._faces = vertices, faces
        z = vertices[:, 2]
        corners = z[faces]
        self._low, self._high = corners.min(axis=1), corners.max(axis=1)
        self.low, self.high = float(z.min()), float(z.max())
        self._heights = np.unique(z)
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        size = np.linalg.norm(normals, axis=1)
        is_level = np.abs(normals[:, 2]) >= _LEVEL * np.maximum(size, 1e-30)
        self.jumps = self._jumps(self._low[is_level], size[is_level] / 2.0)
        """Heights of level faces, lowest first [m]."""
        self.turns = self._turns(normals / np.maximum(size, 1e-30)[:, None])
        """Heights beside which a wall that rises meets one that falls, and ends of
        upright ones that are less than 1.5 mm high, where they stand out, lowest first
        [m]. Sections further apart than that may miss what is widest there."""
        self._cache: dict[float, Any] = {}

    def _jumps(self, heights: Array, areas: Array) -> Array:
        if not len(heights):
            return heights
        order = np.argsort(heights)
        heights, areas = heights[order], areas[order]
        group = np.concatenate([[0], np.cumsum(np.diff(heights) > _SAME)])
        total = np.bincount(group, areas)
        middle = np.bincount(group, heights * np.maximum(areas, 1e-30)) / np.bincount(
            group, np.maximum(areas, 1e-30)
        )
        return middle[total > 1e-9]

    def _turns(self, normals: Array) -> Array:
        """Return them, given the normal of each triangle."""
        rise = normals[:, 2]
        way = np.where(np.abs(rise) > _UPRIGHT, np.sign(rise), 0.0)
        is_low = (way != 0.0) | (self._high - self._low < BAND)
        edges = np.sort(self._faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        keys = edges[:, 0] * len(self._vertices) + edges[:, 1]
        order = np.argsort(keys, kind="stable")
        first, last = order[:-1], order[1:]
        one, other = first // 3, last // 3
        is_turn = (keys[first] == keys[last]) & (way[one] != way[other])
        is_turn &= is_low[one] & is_low[other]
        at, one, other = first[is_turn], one[is_turn], other[is_turn]
        # Of an edge that stands out, the other triangle is behind the plane of one.
        ways = (
            self._vertices[self._faces[other]] - self._vertices[edges[at, 0]][:, None]
        )
        behind = np.einsum("ijk,ik->ij", ways, normals[one]).min(axis=1) < -_SAME
        heights = np.unique(self._vertices[edges[at[behind]], 2])
        heights = _thinned(heights + _BESIDE, _NEAR)
        if len(heights) > _MOST:
            heights = _thinned(heights, (self.high - self.low) / _MOST)
        return heights[(heights > self.low) & (heights < self.high)]

    def at(self, z: float) -> Any:
        """Return the section at a height [m], as an area of shapely.

        Raises:
            ConfigError: The surface is not closed there.
        """
        z = self._between_corners(z)
        if z not in self._cache:
            self._cache[z] = self._area(self._rings(z))
        return self._cache[z]

    def _between_corners(self, z: float) -> float:
        """Return a height next to this one at which no corner lies."""
        for step in (0.0, 1e-8, -1e-8, 3e-8, -3e-8, 1e-7, -1e-7):
            i = int(np.searchsorted(self._heights, z + step))
            near = self._heights[max(i - 1, 0) : i + 1]
            if not len(near) or np.abs(near - z - step).min() > 1e-9:
                return z + step
        return z + 7.3e-8

    def _rings(self, z: float) -> list[Array]:
        """Return the closed lines at a height, the body on their left."""
        hit = np.flatnonzero((self._low < z) & (self._high > z))
        faces = self._faces[hit]
        is_up = self._vertices[faces, 2] > z
        # The corner that is alone on its side, first.
        alone = np.where(
            is_up.sum(axis=1) == 1, is_up.argmax(axis=1), (~is_up).argmax(axis=1)
        )
        rows = np.arange(len(hit))
        a = faces[rows, alone]
        b, c = faces[rows, (alone + 1) % 3], faces[rows, (alone + 2) % 3]
        up = is_up[rows, alone]
        # Seen from outside, the section runs from the edge that goes up to the other.
        start = np.where(up[:, None], np.stack([a, b], 1), np.stack([c, a], 1))
        end = np.where(up[:, None], np.stack([c, a], 1), np.stack([a, b], 1))
        count = len(self._vertices)
        first, last = (
            edge.min(axis=1) * count + edge.max(axis=1) for edge in (start, end)
        )
        follow: dict[int, list[int]] = {}
        for one, other in zip(first.tolist(), last.tolist(), strict=True):
            follow.setdefault(one, []).append(other)
        return [self._points(np.array(line), z) for line in _chains(follow, z)]

    def _points(self, line: NDArray[np.int64], z: float) -> Array:
        one, other = np.divmod(line, len(self._vertices))
        p, q = self._vertices[one], self._vertices[other]
        share = (z - p[:, 2]) / (q[:, 2] - p[:, 2])
        return p[:, :2] + share[:, None] * (q - p)[:, :2]

    def _area(self, rings: list[Array]) -> Any:
        """Return what closed lines enclose: left of them, later ones inside others."""
        shapely = self._shapely
        found = shapely.Polygon()
        sized = [(_signed_area(ring), ring) for ring in rings if len(ring) >= 3]
        solid = [(size, ring) for size, ring in sized if abs(size) > 1e-12]
        for size, ring in sorted(solid, key=lambda one: -abs(one[0])):
            one = shapely.Polygon(ring)
            one = one if one.is_valid else one.buffer(0.0)
            found = found.union(one) if size > 0.0 else found.difference(one)
        return found.simplify(_SAME / 2.0)


def _thinned(heights: Array, step: float) -> Array:
    """Return the first of the heights in each step [m]."""
    _, first = np.unique(heights // step, return_index=True)
    return heights[first]


def _chains(follow: dict[int, list[int]], z: float) -> list[list[int]]:
    """Return the closed lines of steps from one edge to the next."""
    chains = []
    while follow:
        first = next(iter(follow))
        line, at = [first], _step(follow, first)
        while at != first:
            if at not in follow:
                raise ConfigError(
                    f"the surface is not closed at z = {1e3 * z:.4g} mm: close it in "
                    "CAD and export a solid",
                    name="mesh",
                )
            line.append(at)
            at = _step(follow, at)
        chains.append(line)
    return chains


def _step(follow: dict[int, list[int]], at: int) -> int:
    ends = follow[at]
    end = ends.pop()
    if not ends:
        del follow[at]
    return end


def _signed_area(line: Array) -> float:
    x, y = line.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2.0
