"""Tool on the flange, which holds a part."""

import math
from dataclasses import dataclass

import numpy as np

from dovetail.errors import ConfigError, did_you_mean
from dovetail.poses import matrix_from_quat, quat_about_z
from dovetail.robots.drawn import Drawn, bullet_file
from dovetail.robots.robot import ANY_GRIPPER
from dovetail.types import Array, Vec3, Vec4
from dovetail.workcell.parts import Primitive

MOUNT: Vec4 = quat_about_z(math.pi)
"""Rotation of the usual tool in the flange frame: half a turn about the flange's z.
With the tool down over the table A7 is near 0. Mounted straight, it was near its limit
of 175 deg on either side, and the elbow swung out to make up for it."""
_RGBA = (0.35, 0.37, 0.40, 1.0)
GRIP = 0.020
"""Length of a held part that is between the fingers [m]."""
OPENING_MAX = 0.110
"""Largest opening of any gripper, a WSG 50's [m]."""
_FINGER_MIN = 0.005  # [m] of finger below the gripper's body
_HOLDER_RADIUS = 0.020  # [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Gripper:
    """Facts of a parallel gripper, whose fingers move along its x."""

    name: str
    """As a cell file writes it."""
    body: tuple[float, float, float]
    """Half extents of its body [m]."""
    stroke: float
    """Largest opening of its fingers [m]."""
    mass: float
    """Mass with its fingers [kg]."""
    finger_mass: float
    """Mass of one finger [kg]."""
    rotation: Vec4
    """Rotation (wxyz) of its frame in the flange frame."""
    length: float | None = None
    """Usual distance from the flange to the held part's end [m]: its fingers are made
    for the part."""
    finger_end: float | None = None
    """Or distance from the flange to the ends of its fingers [m]: they are as they are,
    and a longer part stands out farther."""

    def end_of(self, reach: float) -> float:
        """Return the usual distance to the end of a part that stands out so far [m]."""
        if self.length is not None:
            return self.length
        assert self.finger_end is not None
        return self.finger_end - GRIP + reach


WSG50 = Gripper(
    name="wsg50",
    body=(0.073, 0.025, 0.03625),
    stroke=OPENING_MAX,
    mass=1.2,
    finger_mass=0.05,
    rotation=MOUNT,
    length=0.180,
)
"""The Weiss WSG 50: 146 x 50 x 72.5 mm, 1.2 kg (data sheet)."""
FRANKA_HAND = Gripper(
    name="franka_hand",
    body=(0.102, 0.0315, 0.0292),
    stroke=0.080,
    mass=0.73,
    finger_mass=0.015,
    rotation=quat_about_z(-math.pi / 4.0),
    finger_end=0.1121,
)
"""The Franka Hand: 0.73 kg, 80 mm of stroke, its fingertips 103.4 mm from the flange
and their ends 8.7 mm farther (product manual, franka_description)."""
ROBOTIQ_2F85 = Gripper(
    name="robotiq_2f85",
    body=(0.0625, 0.0375, 0.04),
    stroke=0.085,
    mass=0.9,
    finger_mass=0.061,
    rotation=MOUNT,
    finger_end=0.139,
)
"""The Robotiq 2F-85: 0.9 kg, 61 g of it in each finger's linkage, and 85 mm of stroke
(mujoco_menagerie, robotiq_2f85). On a Kinova its pads' middles are 120 mm from the
flange (the tool that Kinova's own interface sets), their ends 19 mm farther."""
GRIPPERS = {gripper.name: gripper for gripper in (WSG50, FRANKA_HAND, ROBOTIQ_2F85)}
"""Grippers by name."""
HOLDER = "none"
"""Name of a light holder in the place of a gripper."""
_HOLDER_LENGTH, _HOLDER_MASS = 0.05, 0.2  # [m] between flange and part, [kg]


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

    def held_by(self, gripper: str) -> "Tool":
        """Return another gripper about the same part; a tool without fingers stays."""
        if self.opening is None or gripper in (self.name, ANY_GRIPPER):
            return self
        if gripper not in (*GRIPPERS, HOLDER):
            raise ConfigError(
                f"gripper {gripper!r} is unknown{did_you_mean(gripper, GRIPPERS)}; "
                f"known: {', '.join(GRIPPERS)}, {HOLDER}, {ANY_GRIPPER}"
            )
        if gripper == HOLDER:
            length = self.reach + _HOLDER_LENGTH
            return bare_flange(reach=self.reach, length=length, mass=_HOLDER_MASS)
        return grip_with(GRIPPERS[gripper], opening=self.opening, reach=self.reach)


def grip_with(
    gripper: Gripper,
    *,
    opening: float,
    reach: float,
    length: float | None = None,
    mass: float | None = None,
) -> Tool:
    """Return a gripper with a part between its fingers.

    Args:
        gripper: One of `GRIPPERS`.
        opening: Width of the part between the fingers [m].
        reach: How far the part stands out from its upper end to the TCP [m]; the
            fingers hold its first 20 mm.
        length: Flange to the TCP [m]; left out, the gripper's usual one.
        mass: Gripper with fingers [kg]; left out, its own.

    Raises:
        ConfigError: It opens too little, is too short for the part, or lighter than its
            fingers.
    """
    height = 2.0 * gripper.body[2]
    length = gripper.end_of(reach) if length is None else length
    mass = gripper.mass if mass is None else mass
    end = length - reach + GRIP
    if opening > gripper.stroke:
        raise ConfigError(
            f"the part is {opening:g} m wide between the fingers of a {gripper.name}, "
            f"which open {gripper.stroke:g} m: take a smaller part, turn it, or "
            "another tool in a cell file",
            name="tool",
            value=opening,
            unit="m",
            allowed=(0.0, gripper.stroke),
        )
    if end < (least := height + _FINGER_MIN):
        raise ConfigError(
            f"the tool is {length:g} m long, and the gripper's body and a part that "
            f"stands out by {reach:g} m take {least + reach - GRIP:g} m: give a longer "
            "tool or a shorter part",
            name="tool_length",
            value=length,
            unit="m",
        )
    if mass <= 2.0 * gripper.finger_mass:
        raise ConfigError(
            f"the gripper's mass is {mass:g} kg, its fingers alone have "
            f"{2.0 * gripper.finger_mass:g} kg; give the mass of both",
            name="tool_mass",
            value=mass,
            unit="kg",
        )
    return Tool(
        name=gripper.name,
        primitives=_shapes(gripper, opening, end, mass),
        length=length,
        rotation=gripper.rotation,
        opening=opening,
        reach=reach,
        drawn=_wsg50_drawn(opening, end) if gripper is WSG50 else (),
    )


def _shapes(
    gripper: Gripper, opening: float, end: float, mass: float
) -> tuple[Primitive, ...]:
    """Return body and fingers, which end there [m], so heavy together [kg]."""
    height = 2.0 * gripper.body[2]
    half = (end - height) / 2.0
    turn = matrix_from_quat(gripper.rotation)
    body = Primitive(
        "gripper",
        "box",
        gripper.body,
        np.array([0.0, 0.0, gripper.body[2]]),
        gripper.rotation,
        _RGBA,
        mass - 2.0 * gripper.finger_mass,
    )
    fingers = [
        Primitive(
            name,
            "box",
            (0.006, 0.010, half),
            _finger_at(gripper, turn, sign * (opening / 2.0 + 0.006), height + half),
            gripper.rotation,
            _RGBA,
            gripper.finger_mass,
        )
        for name, sign in (("finger_left", -1.0), ("finger_right", 1.0))
    ]
    return (body, *fingers)


def _finger_at(gripper: Gripper, turn: Array, x: float, z: float) -> Vec3:
    """Return where a finger is in the flange frame [m]."""
    if gripper is WSG50:  # half a turn about z, to the last bit
        return np.array([x, 0.0, z])
    return np.asarray(turn @ np.array([x, 0.0, z]))


def wsg50(
    *,
    opening: float,
    reach: float,
    length: float | None = None,
    mass: float | None = None,
) -> Tool:
    """Return the Weiss WSG 50 with a part between its fingers; see `grip_with`."""
    return grip_with(WSG50, opening=opening, reach=reach, length=length, mass=mass)


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
