"""Places where a gripper can hold a plug until it is inserted, from the meshes alone.

Both meshes stand as they do when the plug is inserted, z up; the plug goes in along -z.
What holds it stays above it and rises with it, so what is clear of the socket in the
end is clear of it on the whole way in.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeVar

import numpy as np

from dovetail.meshes.slabs import lines_of
from dovetail.meshes.slices import Slicer
from dovetail.types import Array
from dovetail.workcell.outline import Outline
from dovetail.workcell.sections import convex_pieces
from dovetail.workcell.tool import GRIP, OPENING_MAX

_T = TypeVar("_T")

_FINGER = (0.012, 0.020)
"""Thickness along the closing direction, and width, of a finger [m]."""
_TIP = (0.003, 0.010)
"""The same of tips that stand for fingers in a simulation [m]."""
_AIR = 0.001
"""Between a finger and the socket [m]."""
_STALK_AIR = 0.0003
"""Between a stalk and the socket [m]: it stands on the plug, which leads it."""
_SHORTEST = 0.0025
"""Least height of plug between the fingers [m]."""
_FLAT = 1e-4
"""Parts of a face that are this near to its outermost point touch the finger [m]."""
_STEP = 15.0
"""Between the closing directions that are tried on any plug [deg]."""
_EDGES = 8
"""Longest edges of a plug across which fingers are tried, too."""
_THINNEST = 0.0004
"""Least half thickness of a stalk's wall [m], two lines of a printer."""
_INSET = 0.0001
"""From the plug's outline to the stalk's [m]."""
_DOWN = (5e-4, 1e-3, 2e-3, 4e-3)
"""Depths below the plug's top at which a stalk may begin, too: it may be round [m]."""
_AREA = 4e-6
"""Least area of a stalk's foot [m2]."""
_LONGEST = 0.110
"""From the plug's end to the top of what holds it [m], see tasks/insert/task.py."""
_ASIDE = 0.001
"""Most that opposite faces are beside each other [m]."""
_FINE = 2.5e-4
"""To which a reachable depth is found [m]."""


class Body(Protocol):
    """A closed mesh."""

    @property
    def vertices(self) -> Array:
        """Corners [m], shape (corners, 3)."""
        ...

    @property
    def faces(self) -> Any:
        """Triangles: indices of corners, shape (triangles, 3)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Grip:
    """Two faces of the plug between the fingers."""

    turn: float
    """Direction in which the fingers close, from x about z [rad]."""
    middle: Array
    """x and y of the middle between the fingers [m]."""
    width: float
    """Width of the plug between the fingers [m]."""
    low: float
    """Height of the fingers' lower end [m]."""
    high: float
    """Height up to which the plug is between the fingers [m]."""
    touching: float
    """Height over which both fingers touch it [m]."""

    def pads(self) -> Array:
        """Return the corners of both fingers from above [m], shape (2, 4, 2)."""
        return self._beside(_FINGER[0] + _AIR, _FINGER[1])

    def tips(self) -> Array:
        """Return the corners of thinner fingers [m], shape (2, 4, 2)."""
        return self._beside(*_TIP)

    def _beside(self, thickness: float, width: float) -> Array:
        along = np.array([np.cos(self.turn), np.sin(self.turn)])
        across = np.array([-along[1], along[0]])
        near, half = self.width / 2.0, width / 2.0
        ends = near, near + thickness
        corners = [
            (u, v)
            for u, v in zip(
                (*ends, *ends[::-1]), (-half, -half, half, half), strict=True
            )
        ]
        return np.array(
            [
                [self.middle + side * (u * along + v * across) for u, v in corners]
                for side in (-1.0, 1.0)
            ]
        )


@dataclass(frozen=True, kw_only=True)
class Stalk:
    """An extension on top of the plug; the fingers hold its upper 20 mm."""

    outline: Any
    """Section between plug and head, a polygon or several of shapely [m]."""
    low: float
    """Height of its foot, in the plug's uppermost section [m]."""
    neck: float
    """Height at which it is above the socket, and may be of any width [m]."""
    high: float
    """Height of its upper end [m]."""

    def pieces(self) -> list[Array]:
        """Return the section as convex pieces [m], counter-clockwise."""
        areas = lines_of(self.outline)
        return [piece for lines in areas for piece in convex_pieces(Outline(*lines))]

    def head(self) -> Array:
        """Return the corners of the part between the fingers [m], convex."""
        return np.array(self.outline.convex_hull.exterior.coords)[:-1]


@dataclass(frozen=True, kw_only=True)
class Hold:
    """Ways to hold a plug, and how deep it can be held."""

    grip: Grip | None
    """Place for the fingers on the plug itself, at the depth `bare`."""
    stalk: Stalk | None
    """Extension that stays clear of the socket, at the depth `reach`."""
    depth: float
    """Full depth of the plug [m]."""
    bare: float
    """Depth to which fingers can hold the plug itself [m]."""
    reach: float
    """Depth to which it can be held by either [m]."""

    @property
    def kind(self) -> Literal["fingers", "stalk", "none"]:
        """Best way to hold it to the full depth; none where there is no way."""
        if self.bare >= self.depth:
            return "fingers"
        return "stalk" if self.reach >= self.depth else "none"

    def why_not(self) -> str | None:
        """Return why the plug cannot be held to its depth, and what to do, or None."""
        if self.kind != "none":
            return None
        return (
            f"the plug can be held only to {1e3 * self.reach:.1f} of "
            f"{1e3 * self.depth:.1f} mm: deeper, fingers would meet the socket, and a "
            "stalk on its top would, too, or be too thin. Add a handle to the plug in "
            "CAD, or cut the socket free around it"
        )

    @property
    def used_grip(self) -> Grip | None:
        """Fingers on the plug itself, unless it is held by a stalk."""
        return None if self.kind == "stalk" else self.grip

    @property
    def used_stalk(self) -> Stalk | None:
        """The stalk, unless fingers hold the plug without one."""
        return None if self.kind == "fingers" else self.stalk


def find_hold(plug: Body, socket: Body, depth: float) -> Hold:
    """Return where a gripper can hold a plug, and how deep.

    Args:
        plug: The part to hold, inserted [m]; z up.
        socket: The part that it goes into [m].
        depth: Way of the plug in the socket along -z [m].
    """
    grips, feet = _grips(plug), _feet(plug)
    grip_up, grip = _lowest(lambda up: _clear_grip(grips, socket, up), depth)
    bottom = float(plug.vertices[:, 2].min())
    stalk_up, stalk = _lowest(lambda up: _stalk(feet, bottom, socket, up), grip_up)
    bare, reach = depth - grip_up, depth - min(grip_up, stalk_up)
    return Hold(grip=grip, stalk=stalk, depth=depth, bare=bare, reach=reach)


def _lowest(find: Callable[[float], _T | None], most: float) -> tuple[float, _T | None]:
    """Return how far the plug must be raised until something is found, and what.

    The more it is raised, the less of the socket is in the way.

    Args:
        find: Looks for it at a height above the inserted plug [m].
        most: Largest height [m]; returned with None where nothing is found.
    """
    if (found := find(0.0)) is not None or most <= 0.0:
        return 0.0, found
    low, high, found = 0.0, most, find(most)
    while found is not None and high - low > _FINE:
        middle = (low + high) / 2.0
        if (other := find(middle)) is not None:
            high, found = middle, other
        else:
            low = middle
    return high, found


def _lines(mesh: Body, z: float) -> Array:
    """Return the lines of a section at a height [m], shape (lines, 2, 2)."""
    is_up = mesh.vertices[:, 2][mesh.faces] > z  # (triangles, 3)
    crossed = is_up.any(axis=1) & ~is_up.all(axis=1)
    cuts = _cuts(mesh.vertices[mesh.faces[crossed]], z)
    return cuts[_is_crossed(is_up[crossed])].reshape(-1, 2, 2)


def _is_crossed(is_up: Any) -> Any:
    """Return which edges of triangles have one end up, shape (triangles, 3)."""
    return is_up != np.roll(is_up, -1, axis=1)


def _cuts(corners: Array, z: float) -> Array:
    """Return x and y where the edges of triangles are at a height [m], if they are."""
    ends = np.roll(corners, -1, axis=1)
    # each edge from its lower end, so that two triangles find one point
    swap = corners[:, :, 2:] > ends[:, :, 2:]
    low, high = np.where(swap, ends, corners), np.where(swap, corners, ends)
    rise = high[:, :, 2:] - low[:, :, 2:]
    share = (z - low[:, :, 2:]) / np.where(rise == 0.0, 1.0, rise)
    return (low + share * (high - low))[:, :, :2]


def _grips(plug: Body) -> list[Grip]:
    """Return places for fingers that reach down from above, the best first.

    A finger's inner face is a rectangle that reaches upwards. It touches the outermost
    of what is before it; the height over which both fingers touch is what counts, up
    to 20 mm, and then the narrower place.
    """
    top, bottom = float(plug.vertices[:, 2].max()), float(plug.vertices[:, 2].min())
    found: list[Grip] = []
    for down in (GRIP, 0.015, 0.010, 0.0075, 0.005, _SHORTEST):
        if top - down < bottom:
            continue
        levels = np.linspace(top - down, top, 25)
        levels = (levels[1:] + levels[:-1]) / 2.0
        lines = [_lines(plug, z) for z in levels]
        closed = (_close(lines, levels, turn) for turn in _turns(lines))
        found += [one for one in closed if one and one.width <= OPENING_MAX]
    return sorted(
        found, key=lambda g: (-round(g.touching, 3), round(2e3 * g.width), -g.low)
    )


def _turns(lines: list[Array]) -> Array:
    """Return closing directions to try [rad]: round ones, and across long edges."""
    import shapely

    points = np.concatenate(lines).reshape(-1, 2)
    hull = shapely.MultiPoint(points).convex_hull.boundary
    corners = np.array(hull.simplify(_FLAT / 2.0).coords)
    edges = np.diff(corners, axis=0)
    edges = edges[np.argsort(-np.hypot(*edges.T))[:_EDGES]]
    normal = np.round(np.arctan2(edges[:, 0], -edges[:, 1]) % np.pi, 5)
    usual = np.deg2rad(np.arange(0.0, 180.0, _STEP))
    return np.array(list(dict.fromkeys([*usual, *normal])))


def _clear_grip(grips: list[Grip], socket: Body, up: float) -> Grip | None:
    """Return the best place where fingers are clear of the socket, if any.

    Args:
        grips: Places, the best first.
        socket: The mesh.
        up: Height to which the plug is raised [m].
    """
    lows = {grip.low for grip in grips}
    above = {low: _Above(socket, low + up - _AIR) for low in lows}
    return next((g for g in grips if not above[g.low].meets(g.pads())), None)


def _close(lines: list[Array], levels: Array, turn: float) -> Grip | None:
    """Close the fingers in a direction; None where they would not hold.

    They do not where they touch over too little height, or where the faces are
    not opposite each other, so that the plug would turn away.
    """
    along = np.array([np.cos(turn), np.sin(turn)])
    across = np.array([-along[1], along[0]])
    ends = np.concatenate(lines).reshape(-1, 2)
    if not len(ends):
        return None
    aside = (float((ends @ across).min()) + float((ends @ across).max())) / 2.0
    seen = [_before_finger(one, along, across, aside) for one in lines]
    reaches = np.array([[_most(-one[:, 0]), _most(one[:, 0])] for one in seen])
    outer = reaches.max(axis=0)
    touches = np.all(reaches > outer - _FLAT, axis=1)
    step = float(levels[1] - levels[0])
    if (touching := step * int(touches.sum())) < _SHORTEST - 1e-9:
        return None
    points = np.concatenate(
        [one for one, is_held in zip(seen, touches, strict=True) if is_held]
    )
    left, right = (
        points[side * points[:, 0] > reach - _FLAT, 1]
        for side, reach in zip((-1.0, 1.0), outer, strict=True)
    )
    if max(left.min(), right.min()) > min(left.max(), right.max()) + _ASIDE:
        return None
    return Grip(
        turn=float(turn),
        middle=(outer[1] - outer[0]) / 2.0 * along + aside * across,
        width=float(outer.sum()),
        low=float(levels[0]) - step / 2.0,
        high=float(levels[touches].max()) + step / 2.0,
        touching=touching,
    )


def _most(values: Array) -> float:
    return float(values.max()) if len(values) else -np.inf


def _before_finger(lines: Array, along: Array, across: Array, aside: float) -> Array:
    """Return the corners of a section that are before the fingers, shape (points, 2).

    They are along and across the closing direction, cut off at the fingers' sides.
    """
    u, v = lines @ along, lines @ across - aside  # (lines, 2)
    half = _FINGER[1] / 2.0
    inside = np.abs(v) <= half
    points = [np.stack([u[inside], v[inside]], axis=1)]
    du, dv = u[:, 1] - u[:, 0], v[:, 1] - v[:, 0]
    for edge in (-half, half):  # where a line leaves the strip
        share = (edge - v[:, 0]) / np.where(dv == 0.0, 1.0, dv)
        cut = (dv != 0.0) & (share > 0.0) & (share < 1.0)
        at = (u[:, 0] + share * du)[cut]
        points.append(np.stack([at, np.full(len(at), edge)], axis=1))
    return np.concatenate(points)


class _Above:
    """Part of a mesh above a height, seen from above."""

    def __init__(self, mesh: Body, z: float) -> None:
        import shapely

        is_up = mesh.vertices[:, 2][mesh.faces] > z
        reaches = is_up.any(axis=1)
        corners, is_up = mesh.vertices[mesh.faces[reaches]], is_up[reaches]
        # what of a triangle is above, in six points of which some are one
        some = np.take_along_axis(corners, is_up.argmax(axis=1)[:, None, None], axis=1)
        own = np.where(is_up[:, :, None], corners, some)[:, :, :2]
        cut = np.where(_is_crossed(is_up)[:, :, None], _cuts(corners, z), own)
        points = np.concatenate([own, cut], axis=1)
        # a wall's triangle is a line from above, which a polygon could not be
        flat: Any = shapely.multipoints(points) if len(points) else []
        self.shapes: Any = shapely.convex_hull(flat)
        self._tree = shapely.STRtree(self.shapes)

    def meets(self, pads: Array) -> bool:
        """Say whether something is nearer to a finger than the air between them."""
        import shapely

        fingers = shapely.polygons(pads)
        return bool(len(self._tree.query(fingers, "dwithin", _AIR)[0]))

    def area(self, near: Any) -> Any:
        """Return what a stalk must leave free of an area, and the air to it."""
        import shapely

        found = self.shapes[self._tree.query(near, "dwithin", _STALK_AIR)]
        return shapely.union_all(found).buffer(_STALK_AIR, quad_segs=4)


def _feet(plug: Body) -> list[tuple[float, Any]]:
    """Return heights at which a stalk may begin [m], and the section there."""
    top = float(plug.vertices[:, 2].max())
    slicer = Slicer(plug.vertices, plug.faces)
    levels = [(top, top - 5e-5), *((top - d, top - d) for d in _DOWN)]
    return [(low, slicer.at(z).buffer(-_INSET)) for low, z in levels]


def _stalk(
    feet: list[tuple[float, Any]], bottom: float, socket: Body, up: float
) -> Stalk | None:
    """Return an extension of the plug that is clear of the socket, if any.

    Args:
        feet: Sections on which it may stand, see `_feet`.
        bottom: Height of the plug's lower end [m].
        socket: The mesh.
        up: Height to which the plug is raised [m].
    """
    top = feet[0][0]
    neck = max(top, float(socket.vertices[:, 2].max()) - up + _AIR)
    if neck + GRIP - bottom > _LONGEST:
        return None
    best: Stalk | None = None
    for low, foot in feet:
        free = foot.difference(_Above(socket, low + up).area(foot))
        free = free.buffer(-_THINNEST).buffer(_THINNEST, quad_segs=4).simplify(5e-5)
        if free.area >= _AREA and (best is None or free.area > 1.5 * best.outline.area):
            best = Stalk(outline=free, low=low, neck=neck, high=neck + GRIP)
    return best
