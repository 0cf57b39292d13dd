"""Peg, gripper, hole block and table from one set of numbers, for every engine.

Frames: the robot's base is the world's origin and the table's top is z = 0. The hole
frame sits in the middle of the hole's mouth, z out of the hole. The tool frame (TCP)
sits in the middle of the peg's end face, z out of the flange; the peg is inserted and
aligned when ``R_world_tool = R_world_hole @ Rx(pi)``. The triangle has a corner on its
+x axis, so this turn maps it onto the hole. The gripper is mounted half a turn about
the flange's z: with the tool down over the table A7 is near 0. Mounted straight, it was
near its limit of 175 deg on either side, and the elbow swung out to make up for it.

Everything convex is a box or a cylinder (the triangle peg alone is a prism), because
convex meshes carry a margin in PyBullet.
"""

import math
from dataclasses import dataclass
from numbers import Real
from typing import Literal, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, matrix_from_quat, quat_about_z, quat_multiply
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot import Payload, Robot
from dovetail.types import Mat33, Vec3, Vec4

PegShape = Literal["square", "triangle", "round"]
PEG_SHAPES: tuple[PegShape, ...] = ("square", "triangle", "round")

_SIDES = {"square": 4, "triangle": 3, "round": 36}
"""Walls of the hole: its edges, or the flats that stand for a circle."""
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
_MOUNT = quat_about_z(math.pi)
"""Rotation of the tool in the flange frame."""
_GRIPPER_RGBA = (0.35, 0.37, 0.40, 1.0)
_PEG_RGBA = (0.90, 0.55, 0.15, 1.0)
_BLOCK_RGBA = (0.45, 0.60, 0.75, 1.0)
_TABLE_RGBA = (0.80, 0.78, 0.74, 1.0)


class Primitive(NamedTuple):
    """One collision shape in its parent frame."""

    name: str
    kind: Literal["box", "cylinder", "prism"]
    size: tuple[float, ...]
    """box: half extents x y z; cylinder: radius, half height; prism: circumradius of
    the triangle, half height [m]. Cylinder and prism stand along z."""
    position: Vec3
    quat_wxyz: Vec4
    rgba: tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class SceneConfig:
    """The geometry of the task: what is held, and what it goes into."""

    peg: PegShape = "square"
    """Shape of peg and hole."""
    clearance: float = 0.0005
    """Gap between peg and hole on each side [m]; 0.06 mm to 4 mm is tested."""
    peg_width: float = 0.030
    """Side of the square or triangle, diameter of the round peg [m]."""
    hole_depth: float = 0.030
    """Depth of the hole [m]."""
    success_depth: float = 0.028
    """Depth of the peg's end below the mouth that counts as inserted [m]."""
    chamfer: float = 0.0
    """Width and depth of a 45 degree chamfer around the mouth [m]; 0 is none."""
    block_width: float = 0.100
    """Outer side of the hole block [m]."""
    floor_thickness: float = 0.0
    """Material under the hole [m]; 0 is a through hole in a plate above the table."""
    tool_length: float = 0.180
    """Flange to the peg's end, the TCP [m]."""
    peg_length: float = 0.070
    """Length of the peg, of which 20 mm are between the fingers [m]."""
    gripper_mass: float = 1.2
    """Mass of the Weiss WSG 50 with its fingers [kg] (data sheet)."""
    peg_density: float = 2700.0
    """Density of the peg, aluminium [kg/m3]."""

    def __post_init__(self) -> None:
        """Refuse a geometry that cannot be built."""
        if self.peg not in PEG_SHAPES:
            raise ConfigError(
                f"scene peg {self.peg!r} is unknown; known shapes: "
                f"{', '.join(PEG_SHAPES)}"
            )
        _require_range("clearance", self.clearance, 0.0, 0.010, "m")
        _require_range("peg_width", self.peg_width, 0.005, 0.060, "m")
        _require_range("hole_depth", self.hole_depth, 0.005, 0.060, "m")
        _require_range("success_depth", self.success_depth, 0.001, self.hole_depth, "m")
        _require_range("chamfer", self.chamfer, 0.0, self.hole_depth / 2.0, "m")
        _require_range("block_width", self.block_width, 0.080, 0.300, "m")
        _require_range("floor_thickness", self.floor_thickness, 0.0, 0.050, "m")
        _require_range("peg_length", self.peg_length, 0.040, 0.110, "m")
        _require_range("tool_length", self.tool_length, 0.130, 0.300, "m")
        _require_range("gripper_mass", self.gripper_mass, 0.2, 5.0, "kg")
        _require_range("peg_density", self.peg_density, 100.0, 20000.0, "kg/m3")

    @property
    def block_height(self) -> float:
        """Height of the hole block [m]."""
        return self.hole_depth + self.floor_thickness

    @property
    def num_walls(self) -> int:
        """How many flat walls the hole has."""
        return _SIDES[self.peg]

    @property
    def inner_radius(self) -> float:
        """Distance from the peg's axis to its flats [m]."""
        if self.peg == "triangle":
            return self.peg_width / (2.0 * math.sqrt(3.0))
        return self.peg_width / 2.0

    def peg_primitive(self) -> Primitive:
        """Return the peg in the flange frame; its end face is the TCP."""
        half = self.peg_length / 2.0
        position = np.array([0.0, 0.0, self.tool_length - half])
        side = self.peg_width / 2.0
        if self.peg == "square":
            size: tuple[float, ...] = (side, side, half)
            return Primitive("peg", "box", size, position, _MOUNT, _PEG_RGBA)
        if self.peg == "round":
            size = (side, half)
            return Primitive("peg", "cylinder", size, position, _MOUNT, _PEG_RGBA)
        size = (2.0 * self.inner_radius, half)
        return Primitive("peg", "prism", size, position, _MOUNT, _PEG_RGBA)

    def tool_primitives(self) -> list[Primitive]:
        """Return gripper, fingers and peg in the flange frame."""
        body = (0.073, 0.025, 0.03625)  # WSG 50: 146 x 50 x 72.5 mm, stroke along x
        finger_end = self.tool_length - self.peg_length + 0.020
        half = (finger_end - 2.0 * body[2]) / 2.0
        parts = [
            Primitive(
                "gripper",
                "box",
                body,
                np.array([0.0, 0.0, body[2]]),
                _MOUNT,
                _GRIPPER_RGBA,
            )
        ]
        for name, sign in (("finger_left", -1.0), ("finger_right", 1.0)):
            x = sign * (self.peg_width / 2.0 + 0.006)
            position = np.array([x, 0.0, 2.0 * body[2] + half])
            size = (0.006, 0.010, half)
            parts.append(Primitive(name, "box", size, position, _MOUNT, _GRIPPER_RGBA))
        return [*parts, self.peg_primitive()]

    def block_primitives(self) -> list[Primitive]:
        """Return the hole block in the hole frame: a wall per edge, a floor if any.

        The hole is the intersection of half planes, so each wall may reach past the
        corners: a wall is material outside its own edge and nothing else.
        """
        outer = self.block_width / 2.0
        walls = []
        if self.floor_thickness > 0.0:
            size = (outer, outer, self.floor_thickness / 2.0)
            z = -self.hole_depth - self.floor_thickness / 2.0
            at = np.array([0.0, 0.0, z])
            walls.append(Primitive("floor", "box", size, at, _IDENTITY, _BLOCK_RGBA))
        edge = self.inner_radius + self.clearance
        for i in range(self.num_walls):
            walls += self._wall(i, edge, outer)
        return walls

    def _wall(self, index: int, edge: float, outer: float) -> list[Primitive]:
        """Return the boxes of one wall, whose face is `edge` from the axis."""
        count = self.num_walls
        # Outward normals; the triangle's corner on +x lies between two of them.
        angle = 2.0 * math.pi * (index + 0.5 * (self.peg == "triangle")) / count
        along = outer if count <= 4 else 1.2 * outer * math.tan(math.pi / count)
        if self.peg == "square" and index % 2 == 1 and self.chamfer == 0.0:
            along = edge  # no overlap with the other two walls: fewer contacts
        depth, chamfer = self.hole_depth, self.chamfer

        def box(name: str, near: float, far: float, top: float) -> Primitive:
            size = ((far - near) / 2.0, along, (depth + top) / 2.0)
            local = np.array([(near + far) / 2.0, 0.0, (top - depth) / 2.0])
            return _turned(f"{name}_{index}", size, local, angle, _IDENTITY)

        if chamfer == 0.0:
            return [box("wall", edge, outer, 0.0)]
        # The triangle between lowered and full wall: a box whose face is the slope.
        thickness = chamfer / math.sqrt(2.0)
        middle = np.array([edge + chamfer / 2.0, 0.0, -chamfer / 2.0])
        normal = np.array([-1.0, 0.0, 1.0]) / math.sqrt(2.0)
        tilt = np.array([math.cos(math.pi / 8), 0.0, -math.sin(math.pi / 8), 0.0])
        slope = (thickness, along, thickness / 2.0)
        local = middle - normal * thickness / 2.0
        return [
            box("wall", edge + chamfer, outer, 0.0),
            box("lip", edge, edge + chamfer, -chamfer),
            _turned(f"chamfer_{index}", slope, local, angle, tilt),
        ]

    def table_primitive(self) -> Primitive:
        """Return the table in the world, its top at z = 0."""
        size = (0.8, 0.8, 0.05)
        position = np.array([0.4, 0.0, -0.05])
        return Primitive("table", "box", size, position, _IDENTITY, _TABLE_RGBA)

    def payload(self) -> Payload:
        """Return mass, centre and inertia of gripper and peg, in the flange frame."""
        parts = self.tool_primitives()
        fingers = 0.05  # [kg] each, of the gripper's mass
        side, height = self.peg_width, self.peg_length
        area = {
            "square": side**2,
            "round": math.pi * side**2 / 4.0,
            "triangle": math.sqrt(3.0) / 4.0 * side**2,
        }[self.peg]
        masses = [
            self.gripper_mass - 2.0 * fingers,
            fingers,
            fingers,
            self.peg_density * area * height,
        ]
        total = sum(masses)
        com = sum(
            (m * part.position for m, part in zip(masses, parts, strict=True)),
            start=np.zeros(3),
        )
        com = com / total
        inertia = np.zeros((3, 3))
        for m, part in zip(masses, parts, strict=True):
            d = part.position - com
            inertia += m * (_unit_inertia(part) + (d @ d) * np.eye(3) - np.outer(d, d))
        return Payload(mass=total, com=com, inertia=inertia)

    def robot(self, inertia: str = "drake") -> Robot:
        """Return the iiwa 14 with gripper and peg; its tool frame is the peg's end."""
        return iiwa14(inertia).with_tool(
            self.payload(),
            tool_position=np.array([0.0, 0.0, self.tool_length]),
            tool_rotation=matrix_from_quat(_MOUNT),
        )

    def require_reachable(self, robot: Robot, hole: Pose) -> None:
        """Check that the peg can stand in the hole, tool down, above the table.

        Raises:
            ConfigError: With how far the hole is out of reach [m].
        """
        z = float(hole.position[2])
        if z < self.block_height:
            raise ConfigError(
                f"hole at z = {z:.4f} m: its block is {self.block_height:.4f} m high "
                f"and would be {self.block_height - z:.4f} m inside the table; raise "
                "the hole"
            )
        shoulder, elbow, wrist, tip = _arm_points(robot)
        upper = float(np.linalg.norm(elbow - shoulder))
        fore = float(np.linalg.norm(wrist - elbow))
        bend = min(float(robot.q_max[3]), math.pi)
        nearest = math.sqrt(upper**2 + fore**2 + 2 * upper * fore * math.cos(bend))
        R_hole = matrix_from_quat(hole.quat_wxyz)
        for depth in (0.0, self.hole_depth):
            above = float(np.linalg.norm(tip - wrist)) - depth
            reach = float(
                np.linalg.norm(hole.position + R_hole[:, 2] * above - shoulder)
            )
            excess = max(reach - 0.99 * (upper + fore), nearest - reach)
            if excess > 0.0:
                side = "too far" if reach > nearest else "too near"
                raise ConfigError(
                    f"hole at {np.round(hole.position, 4).tolist()} m is {side} by "
                    f"{excess:.3f} m: with the tool down the wrist would be "
                    f"{reach:.3f} m from the shoulder, {nearest:.3f} to "
                    f"{0.99 * (upper + fore):.3f} m can be reached; move the hole"
                )


def _arm_points(robot: Robot) -> tuple[Vec3, Vec3, Vec3, Vec3]:
    """Return shoulder, elbow, wrist and tool point at the zero configuration."""
    T = np.eye(4)
    origins = []
    for p, R in zip(robot.origin_position, robot.origin_rotation, strict=True):
        T = T @ _transform(p, R)
        origins.append(T[:3, 3])
    tip = T @ _transform(robot.tool_position, robot.tool_rotation)
    return origins[1], origins[3], origins[5], tip[:3, 3]


def _transform(position: Vec3, rotation: Mat33) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, position
    return T


def _turned(
    name: str, size: tuple[float, ...], local: Vec3, angle: float, tilt: Vec4
) -> Primitive:
    """Return a block part described at angle 0, turned about the hole's axis."""
    turn = quat_about_z(angle)
    position = matrix_from_quat(turn) @ local
    return Primitive(
        name, "box", size, position, quat_multiply(turn, tilt), _BLOCK_RGBA
    )


def _unit_inertia(part: Primitive) -> Mat33:
    """Return the inertia about the own centre per mass [m2], axes of the frame."""
    if part.kind == "box":
        x, y, z = (2.0 * s for s in part.size)
        return np.diag([y * y + z * z, x * x + z * z, x * x + y * y]) / 12.0
    radius, half = part.size
    # A disc has r^2/4 about a diameter; an equilateral triangle R^2/8.
    across = radius**2 / (4.0 if part.kind == "cylinder" else 8.0)
    side = across + (2.0 * half) ** 2 / 12.0
    return np.diag([side, side, 2.0 * across])


def _require_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    """Refuse a size outside its range, saying the range."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ConfigError(
            f"scene {name} is {value!r}; give a number from {low:g} to {high:g} {unit}"
        )
    if not low <= value <= high:
        raise ConfigError(
            f"scene {name} is {value:g} {unit}, allowed is {low:g} to {high:g} {unit}"
        )
