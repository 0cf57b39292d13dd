"""A held part and its fixture from a `part.toml`: numbers, no code.

Both are drawn as they stand when the task is done: z up, out of the fixture, the middle
of the opening's mouth at 0 0 0. The short form makes both from one outline and a gap.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache, partial
from itertools import islice
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import model_validator

from dovetail.errors import ConfigError
from dovetail.poses import TOOL_DOWN
from dovetail.reading import parse_json
from dovetail.settings import Range, names_in, settings, unknown_settings
from dovetail.types import Array
from dovetail.workcell.outline import Outline, offset_line, read_outline
from dovetail.workcell.part_text import BOTH, UNITS, read_name
from dovetail.workcell.parts import Part, Primitive
from dovetail.workcell.sections import is_convex
from dovetail.workcell.shapes import (
    Shape,
    extrude,
    hull_of,
    primitives,
    read_shape,
    scale,
    volume,
)

MAX_SHAPES = 500
"""Most shapes that a part lists."""
MAX_PIECES = 3000
"""Most convex pieces of a fixture."""
MAX_HELD_PIECES = 1000
"""Most convex pieces of a held part; each step moves them all."""
_GAP = Range(0.0, 0.010, "m")
_DENSITY = Range(1.0, 25000.0, "kg/m3")
_WALL = 0.015
"""Least wall around an opening, where the block's side is not given [m]."""
_HELD_RGBA = (0.90, 0.55, 0.15, 1.0)


class Pair(NamedTuple):
    """A held part and the fixture that it goes into."""

    name: str
    """For messages and titles."""
    held: Part
    """Held part in the TCP's frame."""
    make_fixture: Callable[[float], Part]
    """Builds the fixture in its own frame, with every gap this much wider [m]."""
    gap: float
    """Between held part and fixture on each side [m]."""
    depth: float
    """Depth of the held part's end below the mouth when the task is done [m]."""
    opening: Array | None = None
    """Corners of the opening seen from above [m], shape (corners, 2), if known."""


@settings(owner="part")
class ShortForm:
    """A plug and its socket from one outline."""

    outline: Any
    """Outline of the plug seen from above, see `read_outline`."""
    cutouts: Any = ()
    """Outlines of its cutouts, each of which goes around a pin of the socket."""
    depth: Annotated[float, Range(0.002, 0.060, "m")]
    """Depth of the socket [m]."""
    gap: Annotated[float, _GAP]
    """Gap between plug and socket on each side [m]."""
    length: Annotated[float, Range(0.030, 0.110, "m")]
    """Length of the plug [m]; 20 mm of it are between the fingers."""
    chamfer: Annotated[float, Range(0.0, 0.030, "m")] = 0.0
    """Width and depth of a 45 degree chamfer around the socket's mouth [m]."""
    density: Annotated[float, _DENSITY] = 2700.0
    """Density of the plug, aluminium [kg/m3]."""
    through: bool = False
    """Without a floor: a socket in a plate."""
    floor: Annotated[float, Range(0.001, 0.050, "m")] = 0.010
    """Thickness of the floor [m]."""
    block: Annotated[float, Range(0.010, 0.300, "m")] | None = None
    """Side of the block around the socket [m]; left out, 15 mm more all round."""

    @model_validator(mode="after")
    def _check_short_form(self) -> Self:
        """Refuse a chamfer that is deeper than half of the socket."""
        if self.chamfer > (most := self.depth / 2.0):
            raise ConfigError(
                f"chamfer is {self.chamfer:g} m; allowed: 0 to {most:g} m in a socket "
                f"{self.depth:g} m deep",
                name="chamfer",
            )
        return self


_LENGTHS = ("depth", "gap", "length", "chamfer", "floor", "block")


@lru_cache(maxsize=512)
def read_pair(text: str) -> Pair:
    """Return the pair that a definition describes.

    Args:
        text: A definition, see `part_text.whole_part`. Nothing in it is executed, and
            no file is read.

    Raises:
        ConfigError: Names the key, its value and what is allowed.
        MissingDependencyError: It has an outline, and shapely is not installed.
    """
    table = parse_json(text, "the part", is_finite=True)
    if not isinstance(table, dict):
        raise ConfigError(f"the part is {text[:60]!r}; give a table of settings")
    name = read_name(table)
    try:
        return _pair(name, table)
    except ConfigError as error:
        error.args = (f"part {name!r}: {error}",)
        raise


def _pair(name: str, table: Mapping[str, Any]) -> Pair:
    rest = {key: value for key, value in table.items() if key not in ("units", "name")}
    unit = _unit(table, None)
    if "shapes" in rest:
        raise ConfigError(
            "it lists the shapes of one part; to insert it, name two parts in a file: "
            'held = "plug.toml", fixture = "socket.toml" and gap'
        )
    if not set(BOTH) & set(rest):
        return _short_pair(name, _short_form(rest, unit), unit)
    _require_known(rest, (*BOTH, "gap"), "a pair")
    for key in (*BOTH, "gap"):
        if key not in rest:
            raise ConfigError(f"{key} is missing; a pair has held, fixture and gap")
    gap = Gap(gap=scale("gap", rest["gap"], unit)).gap
    held, density = _read_shapes("held", rest["held"], unit)
    fixture, _ = _read_shapes("fixture", rest["fixture"], unit)
    pieces = _limited("held part", held(0.0), MAX_HELD_PIECES).primitives
    lowest = min(float(one.corners()[:, 2].min()) for one in pieces)
    if lowest > -0.001:
        raise ConfigError(
            f"the held part's lowest point is at z = {1e3 * lowest:g} mm, which is not "
            "in the fixture: draw both parts as they stand when the task is done, the "
            "mouth at z = 0",
            name="held",
        )
    make = lru_cache(maxsize=4)(lambda widened: _limited("fixture", fixture(widened)))
    _ = make(0.0)  # refuses what cannot be
    return Pair(
        name,
        _in_tool("held part", pieces, -lowest, density),
        make,
        gap,
        -lowest,
    )


@settings(owner="part")
class Gap:
    """The gap of a pair."""

    gap: Annotated[float, _GAP]
    """Between held part and fixture on each side [m]."""


@settings(owner="part")
class OnePart:
    """Facts of a part beside its shapes."""

    density: Annotated[float, _DENSITY] = 2700.0
    """Density [kg/m3]; counted for each shape, also where they overlap."""


def _unit(table: Mapping[str, Any], usual: float | None) -> float:
    """Return the unit of a table's lengths [m]."""
    word = table.get("units")
    if word is None and usual is not None:
        return usual
    if word not in UNITS:
        said = "is missing" if word is None else f"is {str(word)[:40]!r}"
        raise ConfigError(
            f'units {said}; say what its lengths are in, such as units = "mm"; known: '
            f"{', '.join(UNITS)}",
            name="units",
            value=word,
            allowed=tuple(UNITS),
        )
    return UNITS[word]


def _require_known(table: Iterable[str], known: Iterable[str], whose: str) -> None:
    if unknown := set(table) - set(known):
        raise unknown_settings(unknown, known, whose)


def _short_form(table: Mapping[str, Any], unit: float) -> ShortForm:
    known = (*names_in(ShortForm), *BOTH, "shapes", "units", "name")
    _require_known(table, known, "a part")
    scaled = {
        key: scale(key, value, unit) if key in _LENGTHS else value
        for key, value in table.items()
    }
    return ShortForm(**scaled)


def _read_shapes(
    name: str, table: Any, usual: float
) -> tuple[Callable[[float], Iterator[Primitive]], float]:
    """Return what builds the shapes of one part, and its density [kg/m3]."""
    if not isinstance(table, Mapping):
        raise ConfigError(f"{name} is {str(table)[:60]!r}; give a table with shapes")
    unit = _unit(table, usual)
    _require_known(table, ("shapes", "density", "units", "name"), name)
    listed = table.get("shapes")
    if not isinstance(listed, list) or not 1 <= len(listed) <= MAX_SHAPES:
        count = len(listed) if isinstance(listed, list) else "no list of"
        raise ConfigError(f"{name} has {count} shapes; give 1 to {MAX_SHAPES}")
    given = {key: table[key] for key in ("density",) if key in table}
    shapes = [
        (key, read_shape(key, one, unit))
        for key, one in ((f"{name}_{i}", one) for i, one in enumerate(listed))
    ]
    return partial(_build, shapes, unit), OnePart(**given).density


def _build(
    shapes: list[tuple[str, Shape]], unit: float, thinner_by: float
) -> Iterator[Primitive]:
    for name, shape in shapes:
        yield from primitives(name, shape, unit, thinner_by)


def _limited(name: str, pieces: Iterable[Primitive], most: int = MAX_PIECES) -> Part:
    """Return a part, or refuse it before more is built than an engine can bear."""
    found = tuple(islice(pieces, most + 1))
    if len(found) > most:
        raise ConfigError(
            f"the {name} has more than {most} convex pieces: fewer shapes, or fewer "
            "corners"
        )
    return Part(name, found)


def _in_tool(
    name: str, pieces: Iterable[Primitive], depth: float, density: float
) -> Part:
    """Return a held part in the TCP's frame, with its mass."""
    end = np.array([0.0, 0.0, -depth])
    return _limited(
        name,
        (
            one.moved(end, TOOL_DOWN)._replace(
                mass=density * volume(one), rgba=_HELD_RGBA
            )
            for one in pieces
        ),
    )


def _short_pair(name: str, form: ShortForm, unit: float) -> Pair:
    plug = read_outline("outline", form.outline, unit, form.cutouts)
    top = form.length - form.depth
    held = _in_tool(
        "plug", extrude("plug", plug, -form.depth, top), form.depth, form.density
    )
    _ = _socket(form, plug, 0.0)  # refuses what cannot be
    return Pair(
        name,
        held,
        partial(_socket, form, plug),
        form.gap,
        form.depth,
        plug.offset(form.gap).outer,
    )


def _socket(form: ShortForm, plug: Outline, widened: float) -> Part:
    """Return the socket of a plug: a block with the plug's outline and the gap."""
    gap, depth, chamfer = form.gap + widened, form.depth, form.chamfer
    if gap < 0.0:
        raise ConfigError(
            f"clearance_offset {widened * 1e3:g} mm makes the gap of "
            f"{form.gap * 1e3:g} mm negative; allowed is {-form.gap * 1e3:g} mm and "
            "more"
        )
    mouth = plug.offset(gap)
    reach = float(np.abs(mouth.outer).max()) + chamfer
    half = reach + _WALL if form.block is None else form.block / 2.0
    if half < reach + 1e-3:
        raise ConfigError(
            f"block is {2e3 * half:g} mm; the socket in it needs at least "
            f"{2e3 * (reach + 1e-3):g} mm",
            name="block",
        )
    square = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    wide = offset_line(mouth.outer, chamfer) if chamfer else mouth.outer
    if is_convex(mouth.outer):
        pieces = _sectors(mouth.outer, wide, (depth, chamfer), half)
    else:
        ring = Outline(square, (mouth.outer,))
        pieces = extrude("socket", ring, -depth, -chamfer)
        if chamfer:
            pieces += extrude("mouth", Outline(square, (wide,)), -chamfer, 0.0)
            pieces += _slopes(mouth.outer, wide, chamfer)
    for index, cutout in enumerate(mouth.cutouts):
        pieces += extrude(f"pin_{index}", Outline(cutout), -depth, 0.0)
    if not form.through:
        at = np.array([0.0, 0.0, -depth - form.floor / 2.0])
        size = (half, half, form.floor / 2.0)
        pieces.append(Primitive("floor", "box", size, at))
    return _limited("socket", pieces)


def _sectors(
    near: Array, far: Array, depths: tuple[float, float], half: float
) -> list[Primitive]:
    """Return what lies outside each edge of a convex opening, up to the block's sides.

    Between two edges the pieces meet in the corner's bisector, on which a chamfer's
    corners lie, too. So a piece has wall and slope, and there is one for each edge.

    Args:
        near: Corners of the opening [m].
        far: Those of its mouth, wider by the chamfer [m].
        depths: Of the opening, and of the chamfer [m].
        half: Half side of the block [m].
    """
    depth, chamfer = depths
    out = offset_line(near, 1.0) - near
    distances = (half * np.sign(out) - near) / np.where(out == 0.0, np.inf, out)
    distances[out == 0.0] = np.inf
    ends = near + distances.min(axis=1, keepdims=True) * out
    angles = np.arctan2(ends[:, 1], ends[:, 0])
    pieces = []
    for i in range(len(near)):
        j = (i + 1) % len(near)
        span = (angles[j] - angles[i]) % (2.0 * np.pi)
        rim = [ends[i], ends[j]]
        for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
            if (np.arctan2(y, x) - angles[i]) % (2.0 * np.pi) < span:
                rim.append(half * np.array([x, y]))
        levels = [(near, -depth), (near, -chamfer)][: 2 if chamfer else 1]
        corners = [np.insert(line[[i, j]], 2, z, axis=1) for line, z in levels]
        corners.append(np.insert(far[[i, j]], 2, 0.0, axis=1))
        corners += [np.insert(np.array(rim), 2, z, axis=1) for z in (-depth, 0.0)]
        pieces.append(hull_of(f"socket_{i}", np.vstack(corners)))
    return pieces


def _slopes(near: Array, far: Array, height: float) -> list[Primitive]:
    """Return the wedges between an opening and its wider mouth, one for each edge."""
    wedges = []
    for i in range(len(near)):
        edge = [i, (i + 1) % len(near)]
        low = np.insert(np.vstack([near[edge], far[edge]]), 2, -height, axis=1)
        high = np.insert(far[edge], 2, 0.0, axis=1)
        wedges.append(hull_of(f"slope_{i}", np.vstack([low, high])))
    return wedges
