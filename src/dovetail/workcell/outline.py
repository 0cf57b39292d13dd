"""Outlines of parts in the plane: read from a word, points or an SVG path, and offset.

An outline is a closed line of corners, counter-clockwise. The corners that stand for a
curve lie on it, and their chords at most `CURVE` away from it.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.types import Array
from dovetail.workcell.planar import why_invalid
from dovetail.workcell.svg_path import is_path, read_path

CURVE = 3e-5
"""Largest distance of a curve from the corners that stand for it [m]."""
MAX_CORNERS = 1000
"""Most corners of an outline, with its cutouts."""
REGULAR = {"triangle": 3, "square": 4, "pentagon": 5, "hexagon": 6, "octagon": 8}
"""Regular outlines that have a name, and how many sides."""
_OTHERS = {
    "polygon": (1, "its number of sides (3 to 100) and its width across flats"),
    "circle": (1, "its diameter"),
    "rectangle": (2, "its two sides"),
}
"""Other words for outlines: how many lengths each takes, and which."""
_MAX_SIDES = 100
_SIDE_MAX = 1.0  # [m] of an outline
_AREA_MIN = 1e-8  # [m2]: 0.1 mm x 0.1 mm
_SAME = 1e-9  # [m] up to which two corners are one
_SHARPEST = math.radians(15.0)
_TEXT_MAX = 100_000


class Outline(NamedTuple):
    """An area in the plane [m]."""

    outer: Array
    """Corners around it, counter-clockwise, shape (corners, 2)."""
    cutouts: tuple[Array, ...] = ()
    """Corners around what is left out, counter-clockwise."""

    def offset(self, distance: float) -> "Outline":
        """Return it with every edge moved outwards, cutouts made smaller [m].

        Raises:
            ConfigError: An edge vanishes; says where.
        """
        cutouts = tuple(offset_line(cutout, -distance) for cutout in self.cutouts)
        return Outline(offset_line(self.outer, distance), cutouts)

    def mirrored(self) -> "Outline":
        """Return it seen from the other side, turned about x."""
        return Outline(*_each(self, lambda line: line[::-1] * [1.0, -1.0]))


def _each(outline: Outline, change: Any) -> tuple[Array, tuple[Array, ...]]:
    return change(outline.outer), tuple(change(cutout) for cutout in outline.cutouts)


def read_outline(name: str, value: Any, unit: float, cutouts: Any = ()) -> Outline:
    """Return an outline as a part's file has it.

    Args:
        name: What it is the outline of, for messages.
        value: "hexagon 12" (across flats), "circle 12", "rectangle 20 10"; an SVG path,
            whose further lines are cutouts; or a list of points [x, y].
        unit: Of its numbers [m].
        cutouts: Outlines of what is left out, each written in the same way.

    Raises:
        ConfigError: It is none of these, has no area or crosses itself; says where.
    """
    lines = _read_lines(name, value, unit)
    if not isinstance(cutouts, list | tuple):
        raise ConfigError(f"cutouts of {name} are {_brief(cutouts)}; give a list")
    for index, cutout in enumerate(cutouts):
        line, *more = _read_lines(f"cutout {index} of {name}", cutout, unit)
        if more:
            raise ConfigError(f"cutout {index} of {name} has a cutout; give each alone")
        lines.append(line)
        if (count := sum(map(len, lines))) > MAX_CORNERS:
            raise ConfigError(
                f"{name} has {count} corners; allowed: up to {MAX_CORNERS}"
            )
    outer, *inner = lines
    _require_apart(name, [outer, *inner])
    return Outline(outer, tuple(inner))


def _require_apart(name: str, lines: list[Array]) -> None:
    """Refuse cutouts that meet one another or the outline."""
    if len(lines) == 1:
        return
    if why := why_invalid(lines[0], lines[1:]):
        raise ConfigError(f"cutouts of {name} must lie inside and apart: {why}")


def _read_lines(name: str, value: Any, unit: float) -> list[Array]:
    """Return the closed lines of an outline, each checked alone."""
    if isinstance(value, str):
        if len(value) > _TEXT_MAX:
            raise ConfigError(
                f"{name} has {len(value)} characters; allowed: up to {_TEXT_MAX}"
            )
        if is_path(value):
            path = read_path(name, value, CURVE / unit, MAX_CORNERS)
            lines = [line * unit for line in path]
        else:
            lines = [_word(name, value, unit)]
    else:
        lines = [_read_points(name, value) * unit]
    return [_checked(name, line) for line in lines]


def _read_points(name: str, value: Any) -> Array:
    if not isinstance(value, list | tuple) or not value:
        raise ConfigError(
            f"{name} is {_brief(value)}; give a word with a size such as 'hexagon 12', "
            "an SVG path, or a list of points [x, y]"
        )
    if len(value) > MAX_CORNERS:
        raise ConfigError(
            f"{name} has {len(value)} points; allowed: up to {MAX_CORNERS}"
        )
    for index, point in enumerate(value):
        if (
            not isinstance(point, list | tuple)
            or len(point) != 2
            or not all(map(_is_number, point))
        ):
            raise ConfigError(
                f"point {index} of {name} is {_brief(point)}; give two finite numbers, "
                "[x, y]"
            )
    return np.array(value, dtype=float)


def _is_number(value: Any) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and math.isfinite(value)


def _brief(value: Any) -> str:
    return str(value)[:60]


def _word(name: str, value: str, unit: float) -> Array:
    """Return the corners of "hexagon 12", "circle 12" or "rectangle 20 10"."""
    word, *sizes = value.split()[:4] or [""]
    words = (*REGULAR, *_OTHERS)
    if word not in words:
        raise ConfigError(
            f"{name} is {_brief(value)!r}, which is no outline; known words: "
            f"{', '.join(words)}; or give an SVG path such as "
            "'M 0 0 L 10 0 L 0 10 Z', or points"
        )
    needed, text = _OTHERS.get(word, (1, "its width across flats"))
    try:
        sides = REGULAR.get(word) or int(sizes.pop(0) if word == "polygon" else 0)
        numbers = [float(size) * unit for size in sizes]
    except (ValueError, IndexError):
        sides, numbers = 0, []
    is_polygon = word in (*REGULAR, "polygon")
    is_wrong = len(numbers) != needed or not all(0.0 < n <= _SIDE_MAX for n in numbers)
    if is_wrong or (is_polygon and not 3 <= sides <= _MAX_SIDES):
        raise ConfigError(
            f"{name} is {_brief(value)!r}; after {word} give {text}: numbers above 0, "
            f"at most {_SIDE_MAX / unit:g}, without a unit (units says it once)"
        )
    if word == "rectangle":
        x, y = (n / 2.0 for n in numbers)
        return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    inner = numbers[0] / 2.0
    if is_polygon:
        return _turns(inner / math.cos(math.pi / sides), sides, 0.5)
    return _turns(inner, _sides(inner, 2.0 * math.pi), 0.0)


def _turns(radius: float, count: int, shift: float) -> Array:
    angle = 2.0 * np.pi * (np.arange(count) + shift) / count
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _sides(radius: float, angle: float) -> int:
    """Return how many chords stand for an arc."""
    step = 2.0 * math.acos(max(1.0 - CURVE / radius, 0.5))
    return max(math.ceil(abs(angle) / step), 1)


def _checked(name: str, line: Array) -> Array:
    """Return a closed line counter-clockwise, each corner once, or refuse it."""
    after = np.roll(line, -1, axis=0)
    line = line[np.linalg.norm(line - after, axis=1) > _SAME]
    if len(line) < 3:
        raise ConfigError(f"{name} has {len(line)} different corners; needs three")
    if len(line) > MAX_CORNERS:
        raise ConfigError(
            f"{name} has {len(line)} corners; allowed: up to {MAX_CORNERS}"
        )
    if (farthest := float(np.abs(line).max())) > _SIDE_MAX:
        raise ConfigError(
            f"{name} reaches {farthest:g} m from its origin; allowed: up to "
            f"{_SIDE_MAX:g} m. Are the units right?"
        )
    area = signed_area(line)
    crossing = _find_crossing(line)
    is_thin = np.linalg.svd(line - line[0], compute_uv=False)[-1] < _SAME
    if is_thin or (not crossing and abs(area) < _AREA_MIN):
        raise ConfigError(
            f"{name} has an area of {1e6 * abs(area):g} mm2; needs at least "
            f"{1e6 * _AREA_MIN:g} mm2"
        )
    if crossing:
        i, j, (x, y) = crossing
        raise ConfigError(
            f"{name} crosses itself at ({1e3 * x:g}, {1e3 * y:g}) mm: its edges after "
            f"corners {i} and {j} meet; give the corners in their order around it"
        )
    return line if area > 0.0 else line[::-1]


def signed_area(line: Array) -> float:
    """Return the area inside a closed line [m2], negative if it runs clockwise."""
    x, y = line.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2.0


def area_centre(line: Array) -> Array:
    """Return the centre of the area inside a closed line [m], shape (2,)."""
    after = np.roll(line, -1, axis=0)
    area = line[:, 0] * after[:, 1] - line[:, 1] * after[:, 0]
    return ((line + after) * area[:, None]).sum(axis=0) / (3.0 * area.sum())


def _find_crossing(line: Array) -> tuple[int, int, tuple[float, float]] | None:
    """Return two edges that meet where they are no neighbours, and where."""
    count = len(line)
    a, b = line, np.roll(line, -1, axis=0)

    def side(p: Array, q: Array, r: Array) -> Array:
        u, v = q - p, r - p
        return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]

    for i in range(count - 1):
        # Neighbours share a corner; they cross where one runs back along the other.
        c, d = a[i + 1 :], b[i + 1 :]
        starts, ends = side(a[i], b[i], c), side(a[i], b[i], d)
        before, after = side(c, d, a[i]), side(c, d, b[i])
        hits = (starts * ends <= 0.0) & (before * after <= 0.0)
        is_flat = (starts == 0.0) & (ends == 0.0)
        along = b[i] - a[i]
        s, t = (c - a[i]) @ along, (d - a[i]) @ along
        overlap = np.minimum(np.maximum(s, t), along @ along) - np.maximum(
            np.minimum(s, t), 0.0
        )
        hits &= ~is_flat | (overlap >= 0.0)
        beside = [0] if i else [0, count - 2]
        for k in (k for k in beside if k < len(hits)):
            hits[k] = is_flat[k] and overlap[k] > 0.0
        if hits.any():
            k = int(np.flatnonzero(hits)[0])
            span = starts[k] - ends[k]
            share = starts[k] / span if span else 0.0
            x, y = c[k] + share * (d[k] - c[k])
            return i, i + 1 + k, (float(x), float(y))
    return None


def moved_corners(line: Array, distance: float) -> Array:
    """Return the corners of a closed line with its edges moved outwards [m].

    As `offset_line`, but none is refused: a corner that is sharper than 60 degrees
    moves twice the distance, and edges that vanish turn round.
    """
    along = np.roll(line, -1, axis=0) - line
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    before = np.roll(normals, 1, axis=0)
    spread = 1.0 + np.einsum("ij,ij->i", before, normals)
    moved = distance * (before + normals) / np.maximum(spread, 1e-9)[:, None]
    length = np.linalg.norm(moved, axis=1, keepdims=True)
    most = 2.0 * abs(distance)
    return line + moved * np.minimum(1.0, most / np.maximum(length, 1e-30))


def offset_line(line: Array, distance: float) -> Array:
    """Return a closed line with every edge moved outwards by a distance [m].

    Each corner stays the corner of its two edges: no corner is rounded or cut, so the
    distance between old and new edges is the same everywhere.

    Raises:
        ConfigError: A corner is too sharp, or an edge vanishes; says where.
    """
    along = np.roll(line, -1, axis=0) - line
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    before = np.roll(normals, 1, axis=0)
    spread = 1.0 + np.einsum("ij,ij->i", before, normals)
    if (sharp := spread < 1.0 - math.cos(_SHARPEST)).any():
        x, y = 1e3 * line[np.flatnonzero(sharp)[0]]
        raise ConfigError(
            f"the outline's corner at ({x:g}, {y:g}) mm is sharper than "
            f"{math.degrees(_SHARPEST):g} deg; blunt it"
        )
    moved = line + distance * (before + normals) / spread[:, None]
    edges = np.roll(moved, -1, axis=0) - moved
    if (gone := np.einsum("ij,ij->i", edges, along) <= _SAME).any():
        x, y = 1e3 * line[np.flatnonzero(gone)[0]]
        raise ConfigError(
            f"an offset of {1e3 * distance:g} mm leaves nothing of the outline's edge "
            f"at ({x:g}, {y:g}) mm; give a smaller gap or chamfer, or a coarser outline"
        )
    if crossing := _find_crossing(moved):
        x, y = (1e3 * v for v in crossing[2])
        raise ConfigError(
            f"an offset of {1e3 * distance:g} mm makes the outline cross itself at "
            f"({x:g}, {y:g}) mm; give a smaller gap or chamfer, or a wider outline"
        )
    return moved
