"""A gear on a stalk, and the plate with its shaft and the gear that it meshes with.

Both gears have the same involute teeth. A tooth of the held one lies on its +x axis,
where the standing one has a gap: the gears mesh when the held gear's frame is the
shaft's, and at every whole number of teeth from there.

Reference:
    ISO 53:1998: pressure angle 20 degrees, addendum 1 and dedendum 1.25 modules.
"""

import math
from typing import Any

import numpy as np

from dovetail.types import Array
from dovetail.workcell.parts import IDENTITY, Part, Primitive

MODULE = 0.002
"""Pitch diameter per tooth [m]."""
TEETH = 20
"""Teeth of either gear."""
BACKLASH = 0.0004
"""Play between the flanks at the pitch circle, both together [m]."""
PITCH = 2.0 * math.pi / TEETH
"""Angle from tooth to tooth [rad]."""
DISTANCE = MODULE * TEETH
"""From the shaft to the axis of the standing gear [m]."""
SHAFT_RADIUS = 0.005
"""Radius of the shaft [m]."""
DEPTH = 0.020
"""From the shaft's end to the shoulder that the gear comes to lie on [m]."""
SUCCESS_DEPTH = 0.0185
"""Depth of the gear's lower face below the shaft's end that counts as meshed [m]."""
FACE = 0.012
"""Width of either gear along its axis [m]: the shaft's end is 8 mm higher than the
standing gear, so that the shaft is found first and then the teeth."""
LEAD = 0.0006
"""Height and width of the slope at the end of each tooth [m]."""
DENSITY = 2700.0
"""Density of the held gear, aluminium [kg/m3]."""
STALK_RADIUS, STALK_LENGTH = 0.008, 0.030
"""Stalk that the fingers hold, above the hub [m]."""
REACH = DEPTH + 0.004 + STALK_LENGTH
"""From the upper end of the stalk to the gear's lower face [m]."""

_ANGLE = math.radians(20.0)
_PITCH_RADIUS = MODULE * TEETH / 2.0
_BASE = _PITCH_RADIUS * math.cos(_ANGLE)
_TIP, _ROOT = _PITCH_RADIUS + MODULE, _PITCH_RADIUS - 1.25 * MODULE
_HUB = 0.012
_PLATE = 0.006
_FLANK = 5
"""Points of a flank; the hull between them lies inside the involute, by 2 um."""
_FLATS, _SIDES = 12, 24
"""Walls of the bore, and sides of what is round."""
_HELD_RGBA = (0.90, 0.55, 0.15, 1.0)


def _involute(radius: float) -> float:
    """Return the angle of an involute at a radius, from where it begins [rad]."""
    turn = math.sqrt((radius / _BASE) ** 2 - 1.0)
    return turn - math.atan(turn)


def half_thickness(radius: float) -> float:
    """Return half the angle that a tooth takes at a radius from the axis [rad]."""
    at_pitch = (math.pi * MODULE - BACKLASH) / (4.0 * _PITCH_RADIUS)
    return at_pitch + _involute(_PITCH_RADIUS) - _involute(max(radius, _BASE))


def tooth_outline() -> Array:
    """Return the outline of the tooth on +x [m], shape (points, 2): a convex one."""
    radii = np.array([_ROOT, *np.linspace(_BASE, _TIP, _FLANK)])
    angles = np.array([half_thickness(radius) for radius in radii])
    flank = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
    return np.vstack([flank, flank[::-1] * [1.0, -1.0]])


def _teeth(name: str, top: float, first: float, *, lead: int, rgba: tuple) -> list:
    """Return the teeth of a gear about z, narrower at the end where they meet others.

    Args:
        name: Of the gear.
        top: Height of its upper face [m].
        first: Angle of the first tooth [rad].
        lead: +1, the slope is at the upper end, or -1.
        rgba: Colour.
    """
    outline = tooth_outline()
    middle = outline.mean(axis=0)
    narrow = middle + (outline - middle) * (1.0 - LEAD / np.ptp(outline, axis=0))
    ends = (top, top - FACE) if lead > 0 else (top - FACE, top)
    z = np.array([ends[0], ends[0] - lead * LEAD, ends[1]])
    layers = zip((narrow, outline, outline), z, strict=True)
    corners = np.vstack(
        [np.column_stack([xy, np.full(len(xy), h)]) for xy, h in layers]
    )
    mass = DENSITY * FACE * _area(outline)
    shapes = []
    for i in range(TEETH):
        angle = first + i * PITCH
        c, s = math.cos(angle), math.sin(angle)
        turned = corners @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        shapes.append(
            Primitive(
                f"{name}_tooth_{i}",
                "convex",
                tuple(turned.ravel().tolist()),
                np.zeros(3),
                IDENTITY,
                rgba,
                mass,
            )
        )
    return shapes


def _area(outline: Array) -> float:
    x, y = outline.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _ring(name: str, inner: float, outer: float, low: float, high: float) -> list:
    """Return the wedges of a ring about z whose bore is made of flats."""
    half = math.pi / _FLATS
    across = np.array([inner, outer]) * math.tan(half)
    section = np.array(
        [
            (inner, -across[0]),
            (outer, -across[1]),
            (outer, across[1]),
            (inner, across[0]),
        ]
    )
    mass = DENSITY * (high - low) * _area(section)
    shapes = []
    for i in range(_FLATS):
        c, s = math.cos(2.0 * half * i), math.sin(2.0 * half * i)
        xy = section @ np.array([[c, s], [-s, c]])
        corners = [(*point, z) for z in (low, high) for point in xy.tolist()]
        size = tuple(float(number) for corner in corners for number in corner)
        shapes.append(
            Primitive(
                f"{name}_{i}", "convex", size, np.zeros(3), IDENTITY, _HELD_RGBA, mass
            )
        )
    return shapes


def _round(
    name: str, radii: tuple[float, float], low: float, high: float, **more: Any
) -> Primitive:
    """Return a round piece about z, as a hull of 24 sides: a cylinder or a cone.

    Args:
        name: Of the piece.
        radii: At its lower and its upper end [m].
        low: Height of its lower end [m].
        high: Of its upper end [m].
        more: Place, colour and mass.
    """
    angles = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = [
        np.column_stack([radius * rim, np.full(_SIDES, z)])
        for radius, z in zip(radii, (low, high), strict=True)
    ]
    size = tuple(np.vstack(rings).ravel().tolist())
    return Primitive(name, "convex", size, more.pop("at", np.zeros(3)), **more)


def gear(clearance: float) -> Part:
    """Return the gear in the TCP's frame: its lower face is z = 0, the tool above.

    Args:
        clearance: Gap between bore and shaft [m].
    """
    bore = SHAFT_RADIUS + clearance
    # The tool's z points down: what is above has negative z, and +y is -y of the shaft.
    rim = _ROOT * math.cos(math.pi / _FLATS)
    low, hub = -FACE, -(DEPTH + 0.004)
    stalk = _round(
        "gear_stalk",
        (STALK_RADIUS, STALK_RADIUS),
        hub - STALK_LENGTH,
        hub,
        rgba=_HELD_RGBA,
        mass=DENSITY * math.pi * STALK_RADIUS**2 * STALK_LENGTH,
    )
    return Part(
        "gear",
        (
            *_teeth("gear", 0.0, 0.0, lead=1, rgba=_HELD_RGBA),
            *_ring("gear_disc", bore, rim, low, 0.0),
            *_ring("gear_hub", bore, _HUB, hub, low),
            stalk,
        ),
    )


def station(widened: float) -> Part:
    """Return plate, shaft and standing gear; the frame is at the shaft's end, z up.

    Args:
        widened: By how much the shaft's radius is smaller [m].
    """
    top, radius = FACE - DEPTH, SHAFT_RADIUS - widened
    apart = np.array([DISTANCE, 0.0, 0.0])
    half = np.array([DISTANCE / 2.0 + _TIP, _TIP + 0.004])
    steel = (0.45, 0.60, 0.75, 1.0)
    teeth = _teeth("standing", top, PITCH / 2.0, lead=1, rgba=steel)
    return Part(
        "gear station",
        (
            Primitive(
                "plate",
                "box",
                (*half.tolist(), _PLATE / 2.0),
                np.array([DISTANCE / 2.0, 0.0, -DEPTH - _PLATE / 2.0]),
            ),
            _round("shaft", (radius, radius), -DEPTH, -LEAD),
            _round("shaft_end", (radius, radius - LEAD), -LEAD, 0.0),
            _round("standing_disc", (_ROOT, _ROOT), top - FACE, top, at=apart),
            *(tooth._replace(position=apart) for tooth in teeth),
        ),
    )
