"""Plugs and ports of two optical connectors, from their sections.

The port's frame is in the middle of its mouth, z out of it; the plug's wide side lies
along x.

Reference:
    Sections: AI for Industry Challenge, SFP module and SC plug with their ports.
"""

import math
from typing import Literal, NamedTuple

import numpy as np

from dovetail.workcell.parts import IDENTITY, Part, Primitive

Kind = Literal["sfp", "sc"]


class Section(NamedTuple):
    """Section of a plug and of its port [m]."""

    plug: tuple[float, float]
    """Sides of the plug along x and y."""
    port: tuple[float, float]
    """Sides of the port's opening."""


SECTIONS: dict[str, Section] = {
    "sfp": Section((0.01375, 0.00845), (0.01400, 0.00895)),
    "sc": Section((0.0090, 0.0073), (0.0097, 0.0081)),
}
"""Sections of the connectors."""
DEPTH = 0.015
"""Depth of the port [m]."""
SUCCESS_DEPTH = 0.0135
"""Depth of the plug's end below the mouth that counts as plugged in [m]."""
LEAD = 0.001
"""Height and width of the slope round the mouth and round the plug's end [m]."""
LENGTH = 0.060
"""Length of the plug [m]; 20 mm of it are between the fingers."""
DENSITY = 1500.0
"""Density of the plug, filled plastics [kg/m3]."""
BOARD = 0.080
"""Side of the board around the port [m]."""
_PLUG_RGBA = (0.90, 0.55, 0.15, 1.0)


def plug(kind: Kind) -> Part:
    """Return the plug in the TCP's frame; the middle of its end face is the TCP."""
    x, y = SECTIONS[kind].plug
    half = np.array([x, y]) / 2.0
    layers = ((half - LEAD / 2.0, 0.0), (half, -LEAD), (half, -LENGTH))
    corners = [
        (sx * side[0], sy * side[1], z)
        for side, z in layers
        for sx in (-1.0, 1.0)
        for sy in (-1.0, 1.0)
    ]
    size = tuple(float(number) for corner in corners for number in corner)
    mass = DENSITY * x * y * LENGTH
    shape = Primitive("plug", "convex", size, np.zeros(3), IDENTITY, _PLUG_RGBA, mass)
    return Part(f"{kind} plug", (shape,))


def port(kind: Kind, widened: float) -> Part:
    """Return the board with the port, in the port's frame.

    Args:
        kind: Of connector.
        widened: By how much every gap is wider [m].
    """
    half = np.array(SECTIONS[kind].port) / 2.0 + widened
    outer, shapes = BOARD / 2.0, []
    for i in range(4):
        edge = float(half[i % 2])
        # Two walls reach the board's edge, the other two stand between them.
        along = outer if i % 2 == 0 else float(half[0])
        shapes += _wall(f"wall_{i}", edge, outer, along, math.pi * i / 2.0)
    return Part("port", tuple(shapes))


def _wall(
    name: str, edge: float, outer: float, along: float, angle: float
) -> list[Primitive]:
    """Return a wall whose face is `edge` from the axis, and its slope at the mouth."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def piece(part: str, profile: list[tuple[float, float]]) -> Primitive:
        corners = [(r, side * along, z) for r, z in profile for side in (-1.0, 1.0)]
        size = tuple((np.array(corners) @ turn).ravel().tolist())
        return Primitive(f"{name}_{part}", "convex", size, np.zeros(3))

    low = [(edge, -LEAD), (outer, -LEAD), (outer, -DEPTH), (edge, -DEPTH)]
    lip = [(edge + LEAD, 0.0), (outer, 0.0), (outer, -LEAD), (edge, -LEAD)]
    return [piece("low", low), piece("lip", lip)]
