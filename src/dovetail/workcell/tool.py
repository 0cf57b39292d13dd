"""Tool on the flange, which holds a part."""

import math
from dataclasses import dataclass

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import matrix_from_quat, quat_about_z
from dovetail.robots.drawn import Drawn, bullet_file
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
OPENING_MAX = 0.110
"""Stroke of a WSG 50: its largest opening [m]."""
_FINGER_MIN = 0.005  # [m] of finger below the gripper's body
_HOLDER_RADIUS = 0.020  # [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Tool:
    """A gripper, or another tool that holds the part."""

    name: str
    """For messages."""
    primitives: tuple[Primitive, ...]
    """Its shapes, in the flange frame, with their masses."""
    length: float
    """Flange to the TCP along the flange's z [m]."""
    rotation: Vec4
    """Rotation (wxyz) of the TCP's frame in the flange frame."""
    opening: float | None = None
    """Width of the part between the fingers [m]; None for a tool without fingers."""
    reach: float = 0.0
    """Length of the part from its upper end to the TCP [m]; 0 is unknown."""
    drawn: tuple[Drawn, ...] = ()
    """Meshes of the tool, in the flange frame; without any, its shapes are drawn."""

    @property
    def mass(self) -> float:
        """Mass without the part [kg]."""
        return sum(primitive.mass for primitive in self.primitives)


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

    Raises:
        ConfigError: It is too short for the part, or lighter than its fingers.
    """
    end = length - reach + GRIP
    if end < (least := 2.0 * _BODY[2] + _FINGER_MIN):
        raise ConfigError(
            f"the tool is {length:g} m long, and the gripper's body and a part that "
            f"stands out by {reach:g} m take {least + reach - GRIP:g} m: give a longer "
            "tool or a shorter part",
            name="tool_length",
            value=length,
            unit="m",
        )
    if mass <= 2.0 * _FINGER_MASS:
        raise ConfigError(
            f"the gripper's mass is {mass:g} kg, its fingers alone have "
            f"{2.0 * _FINGER_MASS:g} kg; give the mass of both",
            name="tool_mass",
            value=mass,
            unit="kg",
        )
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
        name="wsg50",
        primitives=(body, *fingers),
        length=length,
        rotation=MOUNT,
        opening=opening,
        reach=reach,
        drawn=_wsg50_drawn(opening, end),
    )


def bare_flange(*, reach: float, length: float, mass: float) -> Tool:
    """Return a holder between flange and part, in the place of a gripper.

    Args:
        reach: How far the part stands out from its upper end to the TCP [m].
        length: Flange to the TCP [m].
        mass: Of the holder [kg].

    Raises:
        ConfigError: The part is longer than that.
    """
    half = (length - reach) / 2.0
    if half < 0.001:
        raise ConfigError(
            f"the tool is {length:g} m long, and the part alone {reach:g} m: give at "
            f"least {reach + 0.002:g} m from the flange to the part's end",
            name="tool_length",
            value=length,
            unit="m",
        )
    holder = Primitive(
        "holder",
        "cylinder",
        (_HOLDER_RADIUS, half),
        np.array([0.0, 0.0, half]),
        MOUNT,
        _RGBA,
        mass,
    )
    return Tool(
        name="bare flange",
        primitives=(holder,),
        length=length,
        rotation=MOUNT,
        reach=reach,
    )


def _wsg50_drawn(opening: float, end: float) -> tuple[Drawn, ...]:
    """Return pybullet_data's gripper, opened so far, its fingers ending there [m]."""
    names = ("WSG50_110.stl", "GUIDE_WSG50_110.stl", "WSG-FMF.stl")
    found = [bullet_file("gripper", "meshes", name) for name in names]
    body, guide, finger = found
    if body is None or guide is None or finger is None:
        return ()
    turn = matrix_from_quat(MOUNT)
    drawn = [Drawn(body, np.zeros(3), turn, rgba=_RGBA)]
    for side in (np.eye(3), np.diag([-1.0, -1.0, 1.0])):
        # Both files in mm; the finger's inner face is at x = 3, its end at z = 130.5.
        for file, z in ((guide, 0.0), (finger, end - 0.1305)):
            at = np.array([-opening / 2.0 - 0.003, 0.0, z])
            one = Drawn(file, side @ at, side, (1e-3, 1e-3, 1e-3), _RGBA)
            drawn.append(one.seen_from(np.zeros(3), turn))
    return tuple(drawn)
