"""Rigid parts as primitives, with mass and colour, the same for every engine."""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, matrix_from_quat, quat_about_z, quat_multiply
from dovetail.types import Array, Mat33, Vec3, Vec4
from dovetail.workcell.hull import solid_of, thickness
from dovetail.workcell.joints import Joint

IDENTITY: Vec4 = np.array([1.0, 0.0, 0.0, 0.0])
"""No rotation (wxyz)."""
_SIZES = {"box": 3, "cylinder": 2, "prism": 2, "convex": 12}
"""Numbers in the size of each kind; a convex may have more, three for a corner."""
_THIN = 1e-6
"""Least thickness of a convex [m]."""


class Primitive(NamedTuple):
    """One collision shape in the frame of its part."""

    name: str
    kind: Literal["box", "cylinder", "prism", "convex"]
    size: tuple[float, ...]
    """box: half extents x y z; cylinder: radius, half height; prism: circumradius of
    the triangle, half height [m]. Cylinder and prism stand along z, a corner of the
    prism on x. convex, the hull of points: x y z of each, one after the other [m]."""
    position: Vec3
    """Centre [m]; of a convex the place of its 0 0 0."""
    quat_wxyz: Vec4 = IDENTITY
    rgba: tuple[float, float, float, float] = (0.45, 0.60, 0.75, 1.0)
    mass: float = 0.0
    """Mass [kg], spread evenly; only what an arm carries needs one."""

    def moved(self, position: Vec3, quat_wxyz: Vec4) -> "Primitive":
        """Return it in a frame in which its own frame lies at this pose."""
        return self._replace(
            position=position + exact_rotation(quat_wxyz) @ self.position,
            quat_wxyz=quat_multiply(quat_wxyz, self.quat_wxyz),
        )

    def vertices(self) -> Array:
        """Return the corners of a convex or a prism in its own frame, (corners, 3)."""
        if self.kind == "convex":
            return np.array(self.size).reshape(-1, 3)
        radius, half = self.size
        turns = (0.0, 2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0)
        return np.array(
            [
                (radius * math.cos(angle), radius * math.sin(angle), z)
                for z in (-half, half)
                for angle in turns
            ]
        )

    def centre(self) -> Vec3:
        """Return the centre of mass in the part's frame [m]."""
        if self.kind != "convex":
            return self.position
        R = exact_rotation(self.quat_wxyz)
        return self.position + R @ solid_of(self.size).centre

    def require_size(self, whose: str) -> None:
        """Refuse a size that no engine can build.

        Args:
            whose: What it is a shape of, for the message.

        Raises:
            ConfigError: Names the shape, the number and what is allowed.
        """
        if wrong := _wrong_size(self.kind, self.size):
            raise ConfigError(f"shape {self.name!r} of {whose}, a {wrong}")

    def corners(self) -> Array:
        """Return corners around it in the part's frame, shape (corners, 3).

        Those of a convex, else the eight of the box around it.
        """
        if self.kind == "convex":
            R = matrix_from_quat(self.quat_wxyz)
            return self.position + self.vertices() @ R.T
        across = self.size[:2] if self.kind == "box" else (self.size[0],) * 2
        half = np.array([*across, self.size[-1]])
        signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T
        return self.position + (signs * half) @ matrix_from_quat(self.quat_wxyz).T


def exact_rotation(quat_wxyz: Vec4) -> Mat33:
    """Return a rotation matrix whose quarter and half turns are exact."""
    return matrix_from_quat(quat_wxyz).round(12)


def turned_box(
    name: str,
    size: tuple[float, ...],
    position: Vec3,
    angle: float,
    tilt: Vec4 = IDENTITY,
) -> Primitive:
    """Return a box described at angle 0, turned about the part's z: a wall of a ring.

    Args:
        name: Of the box.
        size: Half extents x y z before the turn [m].
        position: Its centre before the turn [m].
        angle: Turn about z [rad].
        tilt: Its own rotation (wxyz) before the turn.
    """
    turn = quat_about_z(angle)
    place = matrix_from_quat(turn) @ position
    return Primitive(name, "box", size, place, quat_multiply(turn, tilt))


@dataclass(frozen=True, eq=False)
class Moving:
    """Shapes of a part that move together on one joint."""

    joint: Joint
    """Their joint."""
    primitives: tuple[Primitive, ...]
    """The shapes, in the part's frame, at joint position 0."""

    def __post_init__(self) -> None:
        """Refuse a piece without inertia.

        Raises:
            ConfigError: It has no mass.
        """
        object.__setattr__(self, "primitives", tuple(self.primitives))
        mass = sum(shape.mass for shape in self.primitives)
        if not mass > 0.0:
            raise ConfigError(
                f"what moves on joint {self.joint.name!r} has a mass of {mass:g} kg; "
                "give its shapes a mass above 0",
                name="mass",
                value=mass,
                unit="kg",
                allowed=(0.0, math.inf),
            )

    def moved(self, position: Vec3, quat_wxyz: Vec4) -> "Moving":
        """Return it in a frame in which its part's frame lies at this pose."""
        shapes = tuple(s.moved(position, quat_wxyz) for s in self.primitives)
        return Moving(self.joint.moved(position, quat_wxyz), shapes)

    def at(self, q: float) -> tuple[Primitive, ...]:
        """Return its shapes at a joint position [rad, m], in the part's frame."""
        position, R = self.joint.turn(q)
        half = 0.0 if self.joint.kind == "slide" else 0.5 * q
        quat = np.array([math.cos(half), *(math.sin(half) * self.joint.axis)])
        return tuple(
            s._replace(
                position=position + R @ s.position,
                quat_wxyz=quat_multiply(quat, s.quat_wxyz),
            )
            for s in self.primitives
        )

    def corners(self) -> Array:
        """Return corners of its shapes' boxes at both stops and the start [m].

        Returns:
            In the part's frame, shape (corners, 3).
        """
        places = (*self.joint.stops, self.joint.start)
        return np.vstack([s.corners() for q in places for s in self.at(q)])

    def inertia(self) -> float:
        """Return the inertia at its joint, the rest standing still [kg m2, kg]."""
        mass, com, about = mass_centre_inertia(self.primitives)
        joint = self.joint
        if joint.kind == "slide":
            return mass + joint.armature
        arm = np.cross(joint.axis, com - joint.origin)
        turning = joint.axis @ about @ joint.axis + mass * (arm @ arm)
        return float(turning) + mass * joint.lead**2 + joint.armature


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid body, and what moves on it, each piece on a joint."""

    name: str
    """For messages."""
    primitives: tuple[Primitive, ...]
    """Its shapes, in the part's own frame."""
    moving: tuple[Moving, ...] = ()
    """Shapes that turn, slide or screw on it; shapes of one part pass through each
    other."""

    def __post_init__(self) -> None:
        """Refuse shapes that no engine can build.

        Raises:
            ConfigError: Names the shape, the number and what is allowed.
        """
        object.__setattr__(self, "primitives", tuple(self.primitives))
        object.__setattr__(self, "moving", tuple(self.moving))
        if not self.primitives:
            raise ConfigError(f"part {self.name} has no shape; give one primitive")
        joints = [piece.joint.name for piece in self.moving]
        if twice := [name for name in joints if joints.count(name) > 1]:
            raise ConfigError(f"part {self.name} has two joints {twice[0]!r}")
        shapes = [s for piece in (self, *self.moving) for s in piece.primitives]
        names = Counter(primitive.name for primitive in shapes)
        for primitive in shapes:
            name, kind, mass = primitive.name, primitive.kind, primitive.mass
            if names[name] > 1:
                raise ConfigError(f"part {self.name} has two shapes {name!r}")
            if kind not in _SIZES:
                raise ConfigError(
                    f"shape {name!r} of part {self.name} is a {kind!r}; known: "
                    f"{', '.join(_SIZES)}"
                )
            primitive.require_size(f"part {self.name}")
            if not 0.0 <= mass < math.inf:
                raise ConfigError(
                    f"shape {name!r} of part {self.name} has a mass of {mass} kg; "
                    "needs 0 or more"
                )

    @cached_property
    def corners(self) -> Array:
        """Corners of the boxes around the shapes, in the part's frame [m].

        What moves counts at both its stops and where it starts.
        """
        fixed = [primitive.corners() for primitive in self.primitives]
        return np.vstack([*fixed, *(piece.corners() for piece in self.moving)])

    def lowest(self, pose: Pose) -> float:
        """Return the height of the lowest corner with the part at a pose [m]."""
        up = matrix_from_quat(pose.quat_wxyz)[2]
        return float(pose.position[2] + (self.corners @ up).min())


def _wrong_size(kind: str, size: tuple[float, ...]) -> str:
    """Return why no engine can build a shape of this size; empty where one can."""
    if kind != "convex":
        if len(size) == _SIZES[kind] and all(0.0 < s < 10.0 for s in size):
            return ""
        needed = f"{_SIZES[kind]} numbers above 0 and below 10"
        return f"{kind}, has the size {size} m; give {needed}"
    if len(size) % 3 or len(size) < _SIZES[kind]:
        return (
            f"convex, has {len(size)} numbers; give x y z of each corner, at least "
            "four corners"
        )
    if not all(-10.0 < s < 10.0 for s in size):
        return "convex, has a corner beyond 10 m; give numbers between -10 and 10 m"
    if (thin := thickness(np.array(size).reshape(-1, 3))) < _THIN:
        return (
            f"convex, is {1e3 * thin:g} mm thick; give corners that are not in one "
            f"plane: at least {1e3 * _THIN:g} mm"
        )
    return ""


def unit_inertia(primitive: Primitive) -> Mat33:
    """Return the inertia about the own centre per mass [m2], axes of the part."""
    if primitive.kind == "convex":
        own = solid_of(primitive.size).inertia
    elif primitive.kind == "box":
        x, y, z = (2.0 * s for s in primitive.size)
        own = np.diag([y * y + z * z, x * x + z * z, x * x + y * y]) / 12.0
    else:
        radius, half = primitive.size
        # A disc has r^2/4 about a diameter; an equilateral triangle R^2/8.
        across = radius**2 / (4.0 if primitive.kind == "cylinder" else 8.0)
        side = across + (2.0 * half) ** 2 / 12.0
        own = np.diag([side, side, 2.0 * across])
    R = exact_rotation(primitive.quat_wxyz)
    return R @ own @ R.T


def mass_centre_inertia(shapes: Iterable[Primitive]) -> tuple[float, Vec3, Mat33]:
    """Return mass [kg], centre [m] and inertia about the centre [kg m2] of shapes."""
    shapes = list(shapes)
    total = sum(shape.mass for shape in shapes)
    com: Vec3 = sum((s.mass * s.centre() for s in shapes), start=np.zeros(3)) / total
    inertia = np.zeros((3, 3))
    for shape in shapes:
        d = shape.centre() - com
        own = unit_inertia(shape) + (d @ d) * np.eye(3) - np.outer(d, d)
        inertia += shape.mass * own
    return total, com, inertia


def require_steppable(pieces: Iterable[Moving], h: float) -> None:
    """Refuse a spring that is too stiff for a physics step.

    Args:
        pieces: With their joints.
        h: Physics step [s].

    Raises:
        ConfigError: Names stiffness, inertia, step and the largest stiffness.
    """
    for piece in pieces:
        piece.joint.require_steppable(piece.inertia(), h)
