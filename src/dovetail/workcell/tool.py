"""What is mounted on the flange and holds a part."""

import math
from dataclasses import dataclass

import numpy as np

from dovetail.poses import quat_about_z
from dovetail.types import Vec4
from dovetail.workcell.parts import Primitive

MOUNT: Vec4 = quat_about_z(math.pi)
"""Rotation of the usual tool in the flange frame: half a turn about the flange's z.
With the tool down over the table A7 is near 0. Mounted straight, it was near its limit
of 175 deg on either side, and the elbow swung out to make up for it."""
_RGBA = (0.35, 0.37, 0.40, 1.0)
_BODY = (0.073, 0.025, 0.03625)  # WSG 50: 146 x 50 x 72.5 mm, stroke along x
_FINGER_MASS = 0.05  # [kg] each, of the gripper's mass
GRIP = 0.020
"""Length of a held part that is between the fingers [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tool:
    """A gripper, or whatever holds the part."""

    name: str
    """For messages."""
    primitives: tuple[Primitive, ...]
    """Its shapes, in the flange frame, with their masses."""
    length: float
    """Flange to the TCP along the flange's z [m]."""
    rotation: Vec4
    """Rotation (wxyz) of the TCP's frame in the flange frame."""


def wsg50(
    *, opening: float, reach: float, length: float = 0.180, mass: float = 1.2
) -> Tool:
    """Return the Weiss WSG 50 with a part between its fingers.

    Args:
        opening: Width of the part between the fingers [m].
        reach: How far the part stands out from its upper end to the TCP [m]; the
            fingers hold its first 20 mm.
        length: Flange to the TCP [m].
        mass: Gripper with fingers [kg] (data sheet).
    """
    end = length - reach + GRIP
    half = (end - 2.0 * _BODY[2]) / 2.0
    body = Primitive(
        "gripper",
        "box",
        _BODY,
        np.array([0.0, 0.0, _BODY[2]]),
        MOUNT,
        _RGBA,
        mass - 2.0 * _FINGER_MASS,
    )
    fingers = [
        Primitive(
            name,
            "box",
            (0.006, 0.010, half),
            np.array([sign * (opening / 2.0 + 0.006), 0.0, 2.0 * _BODY[2] + half]),
            MOUNT,
            _RGBA,
            _FINGER_MASS,
        )
        for name, sign in (("finger_left", -1.0), ("finger_right", 1.0))
    ]
    return Tool(
        name="wsg50", primitives=(body, *fingers), length=length, rotation=MOUNT
    )
