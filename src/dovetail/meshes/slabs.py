"""A mesh as slabs: areas that keep, or lead to another, from one height to the next."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from dovetail.meshes.loft import Leaning, bulges, fewer_corners, loft
from dovetail.meshes.slices import Sections, TurningSections
from dovetail.types import Array
from dovetail.workcell.planar import import_shapely

_FAR_STEP = 2e-3
"""The same where the slope is far from the other part [m]."""
_LEAST_AREA = 1.2e-8
"""Area of a section, or of a opening in one, below which it is left out [m2]."""
_THIN = 3e-5
"""Level faces nearer to one another than this are one [m]."""


class Slab(NamedTuple):
    """One area between two heights."""

    low: float
    """Lower height [m]."""
    high: float
    """Upper height [m]."""
    outer: Array
    """Corners around it at the middle height [m], counter-clockwise."""
    cutouts: tuple[Array, ...] = ()
    """Corners around its openings [m], counter-clockwise."""
    lean: Array | None = None
    """Way of each corner from the middle to the upper height [m]; None is upright."""

    def polygon(self, z: float | None = None) -> Any:
        """Return the area at a height [m], at the middle without one."""
        if self.lean is None:
            return import_shapely().Polygon(self.outer, self.cutouts)
        half = (self.high - self.low) / 2.0
        share = 0.0 if z is None else (z - self.low - half) / half
        return Leaning(self.outer, self.cutouts, self.lean).polygon(share)


class Tolerance(NamedTuple):
    """Exactness of a part, by place."""

    near: Callable[[float, float], Any]
    """Area in which it is fine between two heights [m], of shapely; may be empty."""
    fine: float
    """Tolerance there [m]."""
    coarse: float
    """Tolerance elsewhere [m]."""
    step: float = 1e-4
    """Thickness of a slab below which no slope is followed [m]."""


class _Run(NamedTuple):
    """A part of the height with one area, or lofts."""

    low: float
    high: float
    area: Any
    lofts: list[Leaning] | None


def slabs_of(
    slicer: TurningSections,
    low: float,
    high: float,
    tolerance: Tolerance,
    cut: Callable[[Any], Any] = lambda area: area,
) -> list[Slab]:
    """Return a mesh between two heights as slabs, lowest first.

    Args:
        slicer: Its sections.
        low: Lowest height [m].
        high: Highest height [m].
        tolerance: How exact.
        cut: Returns what is taken of a section.
    """
    cutter = _Cutter(slicer, tolerance, cut)
    levels = _levels(slicer, low, high)
    runs: list[_Run] = []
    for a, b in pairwise(levels):
        runs += cutter.runs(a, b)
    slabs = []
    for run in cutter.merged(runs):
        if run.lofts is not None:
            slabs += [Slab(run.low, run.high, *one) for one in run.lofts]
            continue
        area = fewer_corners(
            run.area,
            tolerance.near(run.low, run.high),
            tolerance.fine,
            tolerance.coarse,
        )
        slabs += [Slab(run.low, run.high, *lines) for lines in lines_of(area)]
    return slabs


def lines_of(area: Any) -> list[tuple[Array, tuple[Array, ...]]]:
    """Return the closed lines of an area's parts: around each, then its openings."""
    shapely = import_shapely()
    found = []
    for one in shapely.get_parts(area):
        if one.geom_type == "Polygon" and one.area > _LEAST_AREA:
            one = shapely.orient_polygons(one)
            openings = tuple(
                np.array(line.coords)[:-1][::-1]
                for line in one.interiors
                if shapely.Polygon(line).area > _LEAST_AREA
            )
            found.append((np.array(one.exterior.coords)[:-1], openings))
    return found


def _levels(slicer: Sections, low: float, high: float) -> list[float]:
    """Return the heights of level faces with both ends, each once."""
    levels = [low]
    for z in slicer.jumps.tolist():
        if levels[-1] + _THIN < z < high - _THIN:
            levels.append(z)
    return [*levels, high]


def _union(slabs: list[Slab], z: float) -> Any:
    return import_shapely().union_all([one.polygon(z) for one in slabs])


class _Cutter:
    """Cuts one mesh into runs of heights."""

    def __init__(
        self, slicer: TurningSections, tolerance: Tolerance, cut: Callable[[Any], Any]
    ) -> None:
        self._slicer, self._tolerance, self._cut = slicer, tolerance, cut
        self._known: dict[float, Any] = {}

    def area(self, z: float) -> Any:
        """Return the section at a height, cut."""
        if z not in self._known:
            self._known[z] = self._cut(self._slicer.at(z))
        return self._known[z]

    def runs(self, low: float, high: float) -> list[_Run]:
        """Return what is between two heights without a level face between them."""
        half = (high - low) / 2.0
        inset = min(2e-6, half / 10.0)
        heights = (low + inset, low + half / 2, low + half, high - half / 2)
        first, *inner = (self.area(z) for z in heights)
        last = self.area(high - inset)
        near = self._tolerance.near(low, high)
        changes = [self._change(first, one, near) for one in (*inner, last)]
        middle = inner[1]
        if 2.0 * half <= self._tolerance.step:
            return [_Run(low, high, middle, None)]
        if max(changes) == 0 or (max(changes) == 1 and 2.0 * half <= _FAR_STEP):
            if self._keeps(low, high, near, lambda _: middle):
                return [_Run(low, high, middle, None)]
        elif max(changes) == 2 and (lofts := self._lofts(first, inner, last, near)):
            led = [Slab(low, high, *one) for one in lofts]
            if self._keeps(low, high, near, lambda z: _union(led, z)):
                return [_Run(low, high, middle, lofts)]
        return [*self.runs(low, low + half), *self.runs(low + half, high)]

    def _keeps(
        self, low: float, high: float, near: Any, built: Callable[[float], Any]
    ) -> bool:
        """Say whether what is built stands for the mesh where its walls turn, too."""
        turns = self._slicer.turns
        turns = turns[(turns > low) & (turns < high)].tolist()
        return all(self._change(built(z), self.area(z), near) < 2 for z in turns)

    def _lofts(
        self, first: Any, inner: list[Any], last: Any, near: Any
    ) -> list[Leaning] | None:
        """Return areas that lead from the first section to the last, if they fit."""
        fine = self._tolerance.fine
        for coarse in (self._tolerance.coarse / 2.0, fine / 4.0):
            low, high = (
                fewer_corners(one, near, fine / 4.0, coarse) for one in (first, last)
            )
            lofts = loft(low, high, fine / 2.0)
            if lofts is not None and self._fit(lofts, inner, near):
                return lofts
        return None

    def _fit(self, lofts: list[Leaning], inner: list[Any], near: Any) -> bool:
        """Say whether lofts are the sections at a quarter, half and three quarters."""
        shapely = import_shapely()
        for share, area in zip((-0.5, 0.0, 0.5), inner, strict=True):
            one = [leaning.polygon(share) for leaning in lofts]
            if not all(polygon.is_valid for polygon in one):
                return False
            if self._change(shapely.union_all(one), area, near):
                return False
        return not any(bulges(one, near, self._tolerance.fine) for one in lofts)

    def _change(self, one: Any, other: Any, near: Any) -> int:
        """Return 0 if two areas are the same, 1 if they are far from the other part."""
        apart = one.symmetric_difference(other)
        if apart.is_empty:
            return 0
        fine, coarse = self._tolerance.fine, self._tolerance.coarse
        if near is None or near.is_empty:
            return int(not apart.buffer(-coarse / 2.0).is_empty)
        if not apart.intersection(near).buffer(-fine / 2.0).is_empty:
            return 2
        return int(not apart.difference(near).buffer(-coarse / 2.0).is_empty)

    def merged(self, runs: list[_Run]) -> list[_Run]:
        """Return runs with those on one another that are the same made one."""
        found: list[_Run] = []
        for run in runs:
            last = found[-1] if found else None
            if (
                last is not None
                and last.lofts is None
                and run.lofts is None
                and not self._change(
                    last.area, run.area, self._tolerance.near(last.low, run.high)
                )
            ):
                thick = run.high - run.low > last.high - last.low
                area = run.area if thick else last.area
                found[-1] = _Run(last.low, run.high, area, None)
            else:
                found.append(run)
        return found
