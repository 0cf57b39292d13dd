"""A clip and the rail with the slot that it goes into.

The slot's frame sits in the middle of its mouth, z out of the slot.
"""

import math

import numpy as np

from dovetail.workcell.parts import IDENTITY, Part, Primitive, turned_box

WIDTH = 0.030
"""Side of the clip's square section [m]."""
LENGTH = 0.070
"""Length of the clip [m]; 20 mm of it are between the fingers."""
DENSITY = 2700.0
"""Density of the clip, aluminium [kg/m3]."""
DEPTH = 0.030
"""Depth of the slot [m]."""
SUCCESS_DEPTH = 0.028
"""Depth of the clip's end below the mouth that counts as clipped on [m]."""
RAIL_WIDTH = 0.100
"""Outer side of the rail around the slot [m]."""
_CLIP_RGBA = (0.90, 0.55, 0.15, 1.0)


def clip() -> Part:
    """Return the clip in the TCP's frame; its end face is the TCP."""
    half, side = LENGTH / 2.0, WIDTH / 2.0
    mass = DENSITY * WIDTH**2 * LENGTH
    centre = np.array([0.0, 0.0, -half])
    size = (side, side, half)
    return Part(
        "clip", (Primitive("clip", "box", size, centre, IDENTITY, _CLIP_RGBA, mass),)
    )


def rail(clearance: float) -> Part:
    """Return the rail in the slot's frame: four walls about the slot.

    Args:
        clearance: Gap between clip and slot on each side [m].
    """
    edge, outer = WIDTH / 2.0 + clearance, RAIL_WIDTH / 2.0
    at = np.array([(edge + outer) / 2.0, 0.0, -DEPTH / 2.0])
    walls = []
    for i in range(4):
        along = outer if i % 2 == 0 else edge  # no overlap: fewer contacts
        size = ((outer - edge) / 2.0, along, DEPTH / 2.0)
        walls.append(turned_box(f"wall_{i}", size, at, 2.0 * math.pi * i / 4))
    return Part("slot", tuple(walls))
