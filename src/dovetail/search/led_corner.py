"""The opening that a search looks for, and the corners by which it may lead a part.

All in the fixture's frame. Where the part goes over a post, the opening is the post,
and the corner is one of the part's bore, led from outside.
"""

import math
from typing import NamedTuple

import numpy as np

from dovetail.tasks.task import Outline
from dovetail.types import Array, Vec3
from dovetail.workcell.outline import area_centre
from dovetail.workcell.sections import is_convex

_UP: Vec3 = np.array([0.0, 0.0, 1.0])
_BESIDE_MIDDLE = 0.5
"""Share of the room about an opening's middle from which 0 0 is no middle of it [1]."""
_FAR = 0.85
"""Least distance from the middle of a corner that is tried, per the farthest's [1]."""
_SPREAD = 0.5 * (1.0 + math.sqrt(5.0))
"""Golden ratio: its multiples are spread evenly [1]."""


class LedCorner(NamedTuple):
    """A corner of the opening, and the part's corner that is led there."""

    along: Vec3
    """From the opening's middle to its corner, level, unit length."""
    size: float
    """Distance of the part's corner from the opening's middle when it is in [m]."""
    on_part: Vec3
    """The part's corner from the middle of its end, the part upright [m]."""
    tilt_axis: Vec3
    """Axis about which the part is tilted, so that this corner is lowest."""
    to_walls: Vec3
    """Way of that corner to the walls that stop it, level, unit length."""
    lever: float
    """Height per tilt of the end's middle over the corner, in the mouth [m]."""


class SoughtOpening:
    """An opening or a post, as a search needs to know it."""

    def __init__(self, outline: Outline, gap: float) -> None:
        """Take it from its outline.

        Args:
            outline: Of the opening or the post.
            gap: Between it and the part, on each side [m].
        """
        self.is_post, self.is_pin = outline.is_post, outline.is_pin
        self.is_divided, self.has_steps = outline.is_divided, not outline.is_straight
        self.outer = outline.outer
        """Half side of the square around the fixture [m]."""
        self.depth = outline.depth
        """Depth of the part's end below the mouth when the task is done [m]."""
        self.middle = _middle_of(outline)
        """Its middle, x y [m]."""
        line = outline.opening - self.middle
        self.radius = float(np.linalg.norm(line, axis=1).max())
        """Distance of its farthest corner from the middle [m]."""
        room = _inner_radius(line)
        self.catch = min(self.radius, 2.0 * room)
        """Width in which a corner can fall in, of a circle its radius [m]."""
        inward = gap / max(room, gap, 1e-9)
        self._part_per_opening = 1.0 + inward if self.is_post else 1.0 - inward
        corner = outline.corner
        if corner is None:
            corner = self.middle + max(line, key=lambda point: float(point @ point))
        far: list[Array] = []
        self.is_notched = not is_convex(outline.opening[:-1])
        """True if what falls in may lie in another arm than that of its corner."""
        if self.is_notched:
            far = [self.middle + one for one in far_corners(line)]
        self.corners = [self._led(one) for one in far or [corner]]
        """Those to be tried, one after the other."""

    @property
    def wide(self) -> float:
        """Twice the distance of the farthest corner from the middle [m]."""
        return 2.0 * self.radius

    def _led(self, corner: Array) -> LedCorner:
        """Return what leads a part to a corner of the opening, x y [m]."""
        out = corner - self.middle
        radius = math.hypot(*out)
        along: Vec3 = np.append(out / radius, 0.0)
        size = self._part_per_opening * radius
        on_part = np.append(self.middle, 0.0) + size * along
        ahead = max(float(on_part @ along), size)
        return LedCorner(
            along=along,
            size=size,
            on_part=on_part,
            tilt_axis=np.cross(_UP, along),
            to_walls=-along if self.is_post else along,
            lever=ahead if self.is_pin else self.radius,
        )


def far_corners(opening: Array) -> list[Array]:
    """Return an opening's corners that are far from 0 0, spread in their order.

    Args:
        opening: Closed line, shape (points, 2) [m].
    """
    radius = float(np.linalg.norm(opening, axis=1).max())
    far = [one for one in opening[:-1] if math.hypot(*one) > _FAR * radius]
    turned = sorted(range(len(far)), key=lambda i: i / _SPREAD % 1.0)
    return [far[i] for i in turned]


def _middle_of(outline: Outline) -> Array:
    """Return the middle of a post, or of an opening [m].

    An opening's is 0 0, unless it was drawn beside that or with an edge next to it:
    then it is the centre of its area.
    """
    line = outline.opening
    centre = area_centre(line[:-1])
    own, most = float(_rooms(line).min()), float(_rooms(line - centre).min())
    is_beside = own < min(_BESIDE_MIDDLE * most, most)
    return centre if outline.is_post or is_beside else np.zeros(2)


def _inner_radius(opening: Array) -> float:
    """Return the distance from the origin to the nearest edge of a closed line [m]."""
    return float(np.abs(_rooms(opening)).min())


def _rooms(opening: Array) -> Array:
    """Return how far the origin is to the left of each edge of a closed line [m]."""
    begin, way = opening[:-1], np.diff(opening, axis=0)
    area = begin[:, 0] * way[:, 1] - begin[:, 1] * way[:, 0]
    return area / np.linalg.norm(way, axis=1)
