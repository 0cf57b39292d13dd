"""Two meshes of an assembled pair as slabs of sections: what a part.toml lists."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.errors import ConfigError
from dovetail.meshes.conversion import DENSITY, Conversion, Stalk
from dovetail.meshes.exactness import REACH, PieceSections, Shifted, exactness_of
from dovetail.meshes.hold import Hold, find_hold
from dovetail.meshes.part_folder import part_table
from dovetail.meshes.read import Mesh, read_meshes
from dovetail.meshes.slabs import Slab, Tolerance, lines_of, slabs_of
from dovetail.meshes.way import NEAR, Way, find_way
from dovetail.poses import TOOL_DOWN
from dovetail.tasks.insert.task import Insert
from dovetail.types import Vec3
from dovetail.workcell.part_file import read_pair
from dovetail.workcell.parts import Part
from dovetail.workcell.planar import import_shapely
from dovetail.workcell.tool import GRIP

COARSE = 4e-4
"""Tolerance of what is not near the other part [m]."""
FAR = 2e-3
"""Tolerance of a socket beside the box about the plug's way [m]."""
_SHARE = 0.04
"""Tolerance near the other part, as a share of the gap."""
_FINE = (5e-6, 2e-5)
"""Least and largest tolerance near the other part [m]."""
_STEP = 1e-4
"""Thickness of a slab below which no slope is followed [m]."""
_COARSER = (2.0, 4.0)
"""Factors by which it is coarser where there are too many pieces."""
_PRESSED = 5e-6
"""Gap between most of the walls below which a plug is pressed in [m]."""
_PRESS_FIT = (
    "a press fit does not go in where parts are rigid, as in a simulation; widen the "
    "socket in CAD"
)
_UNDER = 5e-3
"""Depth to which a floor is continued below the plug's end [m]."""
_LENGTHS = 0.030, 0.110
"""Least and largest length of a held part [m]."""
_SPARE = 2e-3
"""Height of the fingers above the socket in the end [m]."""


def convert_files(
    plug: str | Path,
    socket: str | Path,
    *,
    units: str | None = None,
    axis: str | None = None,
    density: float = DENSITY,
) -> Conversion:
    """Return the pair in two files of meshes; see `read_meshes` and `convert`."""
    both = read_meshes(plug, socket, units)
    return convert(*both, axis=axis, density=density)


def convert(
    plug: Mesh,
    socket: Mesh,
    *,
    axis: str | None = None,
    density: float = DENSITY,
    name: str = "",
) -> Conversion:
    """Return a pair of meshes as slabs.

    Args:
        plug: Where it stands in the end.
        socket: In the same frame.
        axis: Way in, see `find_way`.
        density: Of the held part [kg/m3].
        name: Of the part; the plug's without one.

    Raises:
        ConfigError: The parts are not in a common frame, overlap, or the plug does not
            go in straight; says where.
    """
    way = find_way(plug, socket, axis)
    gap = way.gap()
    if gap is None:
        raise ConfigError(
            "plug and socket do not mate: their walls are not beside one another",
            name="mesh",
        )
    mouth_z = way.mouth()
    mouth = _mouth(way, mouth_z)
    depth = mouth_z - way.plug.low
    own, other = (
        one._replace(vertices=one.vertices @ way.turn.T - mouth)
        for one in (plug, socket)
    )
    stalk, hold, reasons = _stalk(own, other, depth)
    if gap.median < _PRESSED:
        reasons.append(
            f"the gap is {1e3 * gap.median:.3f} mm between most of the walls: "
            f"{_PRESS_FIT}, by 0.05 mm all round or more"
        )
    elif way.pressed is not None:
        place = ", ".join(f"{1e3 * v:.4g}" for v in way.pressed.at)
        reasons.append(
            f"the plug is a little wider than the socket on its way, about ({place}) "
            f"mm: {_PRESS_FIT} there, by 0.1 mm or more, or export round faces finer"
        )
    levels = np.unique([*way.plug.jumps, *way.socket.jumps])[::-1] - mouth[2]
    found = Conversion(
        name=name or plug.name,
        plug=way.mesh,
        socket=socket,
        axis=way.axis,
        turn=way.turn,
        mouth=mouth,
        depth=depth,
        gap=gap._replace(at=gap.at - mouth),
        is_through=way.is_through(),
        levels=levels,
        held=(),
        fixture=(),
        stalk=stalk,
        hold=hold,
        density=density,
        reasons=tuple(reasons),
    )
    judged = _judged(_cut(found, way, 1.0), way)
    for coarser in _COARSER:
        if judged.exactness is not None:
            break
        judged = _judged(_cut(found, way, coarser), way)
    return judged


def _cut(conversion: Conversion, way: Way, coarser: float) -> Conversion:
    """Return a conversion with its slabs, so many times thicker than usual."""
    fine = math.sqrt(coarser) * float(np.clip(_SHARE * conversion.gap.low, *_FINE))
    mouth = conversion.mouth
    near = max(NEAR, conversion.gap.high + 2e-4)
    held = _plug_slabs(way, near, fine, coarser * _STEP)
    fixture = _socket_slabs(way, near, fine, coarser * _STEP, float(mouth[2]))
    return replace(
        conversion,
        held=tuple(moved(slab, mouth) for slab in held),
        fixture=tuple(moved(slab, mouth) for slab in fixture),
        tolerance=fine,
    )


def _judged(conversion: Conversion, way: Way) -> Conversion:
    """Return a conversion with its pieces beside the meshes, and why it is no go."""
    text = json.dumps(part_table(conversion))
    reasons = list(conversion.reasons)
    try:
        pair = read_pair(text)
    except ConfigError as error:
        return replace(conversion, reasons=(*reasons, str(error)))
    end = np.array([0.0, 0.0, -pair.depth])
    held = Part("held", tuple(p.moved(end, TOOL_DOWN) for p in pair.held.primitives))
    fixture = pair.make_fixture(0.0)
    exactness = exactness_of(
        (
            Shifted(way.plug, conversion.mouth, way.without_empty_openings),
            Shifted(way.socket, conversion.mouth),
        ),
        (PieceSections(held), PieceSections(fixture)),
        conversion.gap,
    )
    reasons += exactness.why_not()
    try:
        Insert(part=text)
    except ConfigError as error:
        reasons.append(str(error))
    return replace(
        conversion,
        exactness=exactness,
        pieces=(len(held.primitives), len(fixture.primitives)),
        mass=sum(one.mass for one in pair.held.primitives),
        reasons=tuple(reasons),
    )


def moved(slab: Slab, origin: Vec3) -> Slab:
    """Return a slab in a frame with this origin [m]."""
    x, y, z = origin.tolist()
    return slab._replace(
        low=slab.low - z,
        high=slab.high - z,
        outer=slab.outer - [x, y],
        cutouts=tuple(line - [x, y] for line in slab.cutouts),
    )


def _mouth(way: Way, z: float) -> Vec3:
    """Return the middle of the mouth, in the axes of the way [m]."""
    x0, y0, x1, y1 = way.swept(z - 1e-5).bounds
    return np.array([(x0 + x1) / 2.0, (y0 + y1) / 2.0, z])


def _plug_slabs(way: Way, near: float, fine: float, step: float) -> list[Slab]:
    """Return the plug, without openings that nothing of the socket comes into.

    What is longer than a gripper's part is left out at the top: it is held lower.
    """
    passed = _Near(lambda low, _: way.socket_above(low - REACH), near)
    return slabs_of(
        way.plug,
        way.plug.low,
        min(way.plug.high, way.plug.low + _LENGTHS[1] - 1e-6),
        Tolerance(passed, fine, COARSE, step),
        way.without_empty_openings,
    )


def _socket_slabs(
    way: Way, near: float, fine: float, step: float, mouth: float
) -> list[Slab]:
    """Return the socket: exact in a box about the plug's way, plain beside it."""
    shapely = import_shapely()
    end = way.plug.low
    low = max(way.socket.low, end - _UNDER - 1e-3)
    high = way.socket.high
    nothing = shapely.Polygon()
    passed = _Near(
        lambda _, z: way.swept(z + REACH) if z > end - REACH else nothing, near
    )
    x0, y0, x1, y1 = way.swept(mouth - 1e-5).buffer(near + 5e-4).bounds
    box = shapely.box(x0, y0, x1, y1)

    def plain(area: Any) -> Any:
        beside = area.difference(box)
        closed = beside.buffer(FAR / 2.0, quad_segs=2).buffer(-FAR / 2.0, quad_segs=2)
        return closed.difference(box)

    slabs = slabs_of(
        way.socket,
        low,
        high,
        Tolerance(passed, fine, COARSE, step),
        lambda area: area.intersection(box),
    )
    slabs += slabs_of(
        way.socket, low, high, Tolerance(lambda *_: nothing, fine, FAR), plain
    )
    if way.is_through():
        return slabs
    return [
        slab._replace(low=min(slab.low, end - _UNDER))
        if slab.low <= low + 1e-6 and slab.lean is None
        else slab
        for slab in slabs
    ]


class _Near:
    """Area about what another part passes, by height, each computed once."""

    def __init__(self, passed: Callable[[float, float], Any], near: float) -> None:
        self._passed, self._near = passed, near
        self._known: dict[int, tuple[Any, Any]] = {}

    def __call__(self, low: float, high: float) -> Any:
        area = self._passed(low, high)
        key = id(area)
        if key not in self._known:
            self._known[key] = area, area.buffer(self._near, quad_segs=4)
        return self._known[key][1]


def _stalk(
    plug: Mesh, socket: Mesh, depth: float
) -> tuple[Stalk | None, Hold | None, list[str]]:
    """Return what the fingers hold above the plug, if it needs that, and why not.

    It is a stalk on the plug's top or, where only fingers beside the plug find room,
    their tips.

    Args:
        plug: In the part's frame.
        socket: In the part's frame.
        depth: Of the plug's end [m].
    """
    above = max(float(socket.vertices[:, 2].max()), 0.0)
    needed = max(depth + above + GRIP + _SPARE, _LENGTHS[0])
    if needed > _LENGTHS[1]:
        reason = (
            f"the held part must be {1e3 * needed:.4g} mm long to reach the end; a "
            f"WSG 50 holds up to {1e3 * _LENGTHS[1]:g} mm"
        )
        return None, None, [reason]
    length = float(plug.vertices[:, 2].max()) + depth
    if length >= needed - _SPARE + 2e-4:
        return None, None, []
    hold = find_hold(plug, socket, depth)
    high = math.ceil(1e3 * needed) / 1e3 - depth
    if (reason := hold.why_not()) is not None:
        return None, hold, [reason]
    if hold.stalk is not None:
        lines = tuple(lines_of(hold.stalk.outline))
        return Stalk(outlines=lines, low=hold.stalk.low, high=high), hold, []
    assert hold.grip is not None
    tips = tuple((tip, ()) for tip in hold.grip.tips())
    return Stalk(outlines=tips, low=hold.grip.low, high=high), hold, []
