"""A pair of meshes, checked: what was read, how it goes in, what may hold it."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dovetail.errors import ConfigError
from dovetail.meshes.body import Inertia, inertia_of
from dovetail.meshes.conversion import Conversion
from dovetail.meshes.exactness import PieceSections
from dovetail.meshes.gaps import Clearance, gaps_at
from dovetail.meshes.hold import Hold, find_hold
from dovetail.meshes.part_folder import part_table
from dovetail.meshes.read import Mesh
from dovetail.meshes.slices import Slicer
from dovetail.poses import TOOL_DOWN
from dovetail.workcell.part_file import read_pair
from dovetail.workcell.parts import Part

_HEIGHTS = 41
"""Heights at which the gap is measured."""
_LARGE = 0.2
"""Longest side of a plug from which its unit is asked for [m]."""
_SIMPLER = (
    "Many triangles on rounded edges need many pieces: export the mesh coarser, leave "
    "small roundings out, or blunt what ends in a point"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Check:
    """Facts of a pair; all heights and places are in the part's frame."""

    conversion: Conversion
    """The pair as slabs."""
    plug: Mesh
    """Plug in the part's frame."""
    socket: Mesh
    """Socket in the part's frame."""
    hold: Hold
    """Ways to hold the plug."""
    clearance: Clearance
    """Gap between the meshes, over the height."""
    pieces: Clearance | None
    """Gap between the convex pieces; None where they cannot be built."""
    parts: tuple[Part, ...]
    """Convex pieces of the plug, with its stalk, and of the socket; empty where they
    cannot be built."""
    problems: tuple[str, ...]
    """Reasons against it, with what to do; empty is go."""

    @property
    def is_go(self) -> bool:
        """True where the pair can be trained as it is."""
        return not self.problems

    @cached_property
    def inertia(self) -> Inertia:
        """Mass and inertia of the plug at the conversion's density."""
        return inertia_of(self.plug, self.conversion.density)


def check_pair(conversion: Conversion, begin: Callable[[str], None]) -> Check:
    """Return the facts of a pair.

    Args:
        conversion: The pair as slabs.
        begin: Called with the name of each part of the work, as it begins.
    """
    plug, socket = (
        conversion.in_part(mesh) for mesh in (conversion.plug, conversion.socket)
    )
    begin("look for a hold")
    hold = conversion.hold or find_hold(plug, socket, conversion.depth)
    begin("measure the gap")
    meshes = (Slicer(one.vertices, one.faces) for one in (plug, socket))
    levels = heights(plug, conversion.depth)
    parts = _parts(conversion)
    pieces = [PieceSections(one) for one in parts]
    inexact = conversion.exactness.why_not() if conversion.exactness else []
    reasons = [
        f"{reason}. {_SIMPLER}" if reason in inexact else reason
        for reason in (*conversion.reasons, *filter(None, [hold.why_not()]))
    ]
    return Check(
        conversion=conversion,
        plug=plug,
        socket=socket,
        hold=hold,
        clearance=_clearance(levels, *meshes),
        pieces=_clearance(levels, *pieces) if pieces else None,
        parts=parts,
        problems=tuple(dict.fromkeys([*_unit_doubt(conversion, reasons), *reasons])),
    )


def _unit_doubt(conversion: Conversion, reasons: Sequence[str]) -> list[str]:
    """Ask for the unit where a pair is no go and its plug is large."""
    mesh = conversion.plug
    side = float(np.ptp(mesh.vertices, axis=0).max())
    if not reasons or side < _LARGE:
        return []
    return [
        f"the plug's longest side is {1e3 * side:.4g} mm in {mesh.units} "
        f"({mesh.units_from}); most parts that a gripper inserts are smaller: is it in "
        "another unit? Give --units"
    ]


def _parts(conversion: Conversion) -> tuple[Part, ...]:
    """Return the convex pieces of plug and socket, none where they cannot be built."""
    try:
        pair = read_pair(json.dumps(part_table(conversion)))
    except ConfigError:  # a reason of the conversion
        return ()
    end = np.array([0.0, 0.0, -pair.depth])
    held = tuple(one.moved(end, TOOL_DOWN) for one in pair.held.primitives)
    return Part("held", held), pair.make_fixture(0.0)


def _clearance(
    levels: list[float], plug: Slicer | PieceSections, socket: Slicer | PieceSections
) -> Clearance:
    found = (gaps_at(z, plug.at(z), socket.at(z)) for z in levels)
    return Clearance(levels=tuple(found))


def heights(plug: Mesh, depth: float) -> list[float]:
    """Return heights from the plug's end to the mouth, or to its top if that is lower.

    Args:
        plug: In the part's frame.
        depth: Depth of its end [m].
    """
    top = min(0.0, float(plug.vertices[:, 2].max()))
    inset = (top + depth) / (4.0 * _HEIGHTS)
    return np.linspace(-depth + inset, top - inset, _HEIGHTS).tolist()
