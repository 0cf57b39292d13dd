"""Shapes of a part as its file lists them: an outline from one height to another."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

import numpy as np
from pydantic import model_validator

from dovetail.errors import ConfigError
from dovetail.poses import quat_about_z
from dovetail.settings import Range, settings
from dovetail.types import Array
from dovetail.workcell.hull import solid_of, thinner
from dovetail.workcell.outline import Outline, moved_corners, read_outline
from dovetail.workcell.parts import IDENTITY, Primitive
from dovetail.workcell.sections import areas_offset, convex_pieces

_LENGTH = Range(-1.0, 1.0, "m")
_MAX_CORNERS = 500
_LEAN_MAX = 0.2  # [m]
_RECTANGLES = {"square": (0, 0), "rectangle": (0, 1)}
"""Words of outlines that become boxes, and which of their numbers are x and y."""


@settings(owner="shape")
class Shape:
    """One shape: an outline between two heights, or the hull of corners."""

    outline: Any = None
    """See `read_outline`; circle, square and rectangle become cylinder and box."""
    cutouts: Any = ()
    """Outlines of what is left out."""
    z: tuple[Annotated[float, _LENGTH], Annotated[float, _LENGTH]] | None = None
    """Lowest and highest height of the outline."""
    at: tuple[Annotated[float, _LENGTH], Annotated[float, _LENGTH]] = (0.0, 0.0)
    """Place of the outline's origin."""
    turn_deg: Annotated[float, Range(-360.0, 360.0, "deg")] = 0.0
    """Turn of the outline about its origin."""
    lean: Any = None
    """Way [x, y] of each corner of the outline, then of its cutouts, from the middle
    height to the upper one; the same back to the lower one. Left out, it is upright."""
    corners: Any = None
    """Points [x, y, z] whose hull the shape is, in place of an outline."""

    @model_validator(mode="after")
    def _check_shape(self) -> Self:
        """Refuse a shape that is neither or both."""
        if (self.outline is None) == (self.corners is None):
            raise ConfigError("give a shape either an outline with z, or corners")
        if self.corners is not None and (self.z or self.lean) is not None:
            raise ConfigError("corners have their own heights: leave z and lean out")
        if self.outline is not None and (self.z is None or not self.z[0] < self.z[1]):
            raise ConfigError(
                f"z is {self.z}; give the lowest and the highest height of the outline"
            )
        return self


def read_shape(name: str, table: Any, unit: float) -> Shape:
    """Return a shape from its table in a file.

    Args:
        name: Of the shape, for messages.
        table: As the file has it.
        unit: Of its lengths [m].

    Raises:
        ConfigError: It is no shape; names what is wrong.
    """
    if not isinstance(table, Mapping):
        raise ConfigError(
            f"{name} is {str(table)[:60]}; give a table such as "
            '{ outline = "hexagon 12", z = [-20, 40] }'
        )
    try:
        scaled = {
            key: scale(key, value, unit) if key in ("z", "at") else value
            for key, value in table.items()
        }
        return Shape(**scaled)
    except ConfigError as error:
        error.args = (f"{name}: {error}",)
        raise


def scale(key: str, value: Any, unit: float) -> Any:
    """Return a length, or a list of lengths, in metres.

    Raises:
        ConfigError: It is no number.
    """
    if isinstance(value, list | tuple):
        return tuple(scale(key, one, unit) for one in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{key} is {str(value)[:60]!r}; give a number in the units")
    return float(value) * unit


def primitives(
    name: str, shape: Shape, unit: float, thinner_by: float
) -> Iterator[Primitive]:
    """Yield the convex shapes that an engine builds.

    Args:
        name: They are called NAME_0, NAME_1, ...
        shape: The shape.
        unit: Of its outline's numbers [m].
        thinner_by: How far its sides move inwards [m].

    Raises:
        ConfigError: The outline is wrong, or nothing is left of it.
    """
    if shape.corners is not None:
        yield _hull(name, shape.corners, unit, thinner_by)
        return
    assert shape.z is not None
    turn = quat_about_z(np.radians(shape.turn_deg)) if shape.turn_deg else IDENTITY
    low, high = shape.z
    place = np.array([*shape.at, (low + high) / 2.0])
    outline = read_outline(f"outline of {name}", shape.outline, unit, shape.cutouts)
    half = (high - low) / 2.0
    if shape.lean is not None:
        lean = _read_lean(name, shape.lean, outline, unit)
        for one in _leaning(name, outline, lean, half, thinner_by):
            yield one._replace(position=place, quat_wxyz=turn)
        return
    radius = float(np.linalg.norm(outline.outer[0])) - thinner_by
    outlines = areas_offset(outline, -thinner_by) if thinner_by else [outline]
    word = shape.outline.split()[0] if isinstance(shape.outline, str) else ""
    if word == "circle" and not shape.cutouts:
        yield Primitive(f"{name}_0", "cylinder", (radius, half), place, turn)
    elif word in _RECTANGLES and not shape.cutouts:
        x, y = outlines[0].outer.max(axis=0).tolist()
        yield Primitive(f"{name}_0", "box", (x, y, half), place, turn)
    else:
        pieces = [one for area in outlines for one in convex_pieces(area)]
        for one in _upright(name, pieces, -half, half):
            yield one._replace(position=place, quat_wxyz=turn)


def extrude(name: str, outline: Outline, low: float, high: float) -> list[Primitive]:
    """Return an outline from one height to another, as convex pieces [m]."""
    return _upright(name, convex_pieces(outline), low, high)


def _upright(
    name: str, pieces: list[Array], low: float, high: float
) -> list[Primitive]:
    return [
        hull_of(
            f"{name}_{i}",
            np.vstack([np.insert(piece, 2, z, axis=1) for z in (low, high)]),
        )
        for i, piece in enumerate(pieces)
    ]


def _read_lean(name: str, value: Any, outline: Outline, unit: float) -> Array:
    """Return the way of each corner up to the upper height, shape (corners, 2)."""
    count = sum(map(len, (outline.outer, *outline.cutouts)))
    listed = list(value) if isinstance(value, list | tuple) else []
    if len(listed) != count or not all(
        isinstance(one, list | tuple) and len(one) == 2 for one in listed
    ):
        raise ConfigError(
            f"lean of {name} is {str(value)[:60]}; give a way [x, y] for each of its "
            f"{count} corners"
        )
    lean = np.array(scale(f"lean of {name}", listed, unit))
    if not (np.abs(lean) <= _LEAN_MAX).all():
        raise ConfigError(
            f"lean of {name} is up to {np.abs(lean).max():g} m; allowed: up to "
            f"{_LEAN_MAX:g} m"
        )
    return lean


def _leaning(
    name: str, outline: Outline, lean: Array, half: float, thinner_by: float
) -> list[Primitive]:
    """Return an outline whose corners lean, as convex pieces.

    It is cut at the middle height; a piece is the hull of where its corners are at the
    lower and at the upper height.
    """
    lines = (outline.outer, *outline.cutouts)
    corners = np.vstack(lines)
    index = {(x, y): i for i, (x, y) in enumerate(corners.tolist())}
    if thinner_by:
        outwards = [-thinner_by, *[thinner_by] * len(outline.cutouts)]
        corners = np.vstack(
            [moved_corners(*both) for both in zip(lines, outwards, strict=True)]
        )
    pieces = []
    for piece in convex_pieces(outline):
        rows = [index[x, y] for x, y in piece.tolist()]
        ends = [
            np.insert(corners[rows] + sign * lean[rows], 2, sign * half, axis=1)
            for sign in (-1.0, 1.0)
        ]
        pieces.append(hull_of(f"{name}_{len(pieces)}", np.vstack(ends)))
    return pieces


def hull_of(name: str, corners: Array) -> Primitive:
    """Return the hull of points as a shape."""
    return Primitive(name, "convex", tuple(corners.ravel().tolist()), np.zeros(3))


def _hull(name: str, corners: Any, unit: float, thinner_by: float) -> Primitive:
    if not isinstance(corners, list | tuple) or not 4 <= len(corners) <= _MAX_CORNERS:
        raise ConfigError(
            f"corners of {name} are {str(corners)[:60]}; give 4 to {_MAX_CORNERS} "
            "points [x, y, z]"
        )
    for index, corner in enumerate(corners):
        if not isinstance(corner, list | tuple) or len(corner) != 3:
            raise ConfigError(
                f"corner {index} of {name} is {str(corner)[:60]}; give three numbers, "
                "[x, y, z]"
            )
    points = np.array(scale(f"corners of {name}", corners, unit))
    hull_of(name, points).require_size("a part")
    if thinner_by:
        moved = thinner(points, thinner_by)
        if moved is None:
            raise ConfigError(
                f"{1e3 * thinner_by:g} mm less on each side leaves nothing of {name}"
            )
        points = moved
    return hull_of(f"{name}_0", points)


def volume(shape: Primitive) -> float:
    """Return the volume of a shape [m3]."""
    if shape.kind == "box":
        return 8.0 * float(np.prod(shape.size))
    if shape.kind == "cylinder":
        radius, half = shape.size
        return 2.0 * np.pi * radius**2 * half
    return solid_of(shape.size).volume
