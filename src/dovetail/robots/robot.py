"""Facts of a seven-joint arm: geometry, inertia, limits, motors, payload.

A `Robot` is plain data. The maths on it (pose, Jacobian, inertia matrix) is
`dovetail._core.Chain`, which `Robot.chain` builds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_from_matrix
from dovetail.robots.drawn import Drawn
from dovetail.robots.inertia import merge_bodies, require_inertia
from dovetail.robots.kinematics import solve_pose
from dovetail.types import JOINTS, Array, Mat33, Vec3, Vec7

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dovetail import _core

GRAVITY = (0.0, 0.0, -9.81)
"""Gravity in world axes [m/s2]."""
NOMINAL = "nominal"
"""Name of the inertia set of a robot that has one only."""
_NO_ARRAYS = ("name", "postures", "inertia_set", "inertia_sets", "payload", "drawn")
_SHAPES: Mapping[str, tuple[int, ...]] = {
    "origin_position": (7, 3),
    "origin_rotation": (7, 3, 3),
    "com": (7, 3),
    "inertia": (7, 3, 3),
    "flange_rotation": (3, 3),
    "tool_rotation": (3, 3),
    "flange_position": (3,),
    "tool_position": (3,),
}
"""Of what has not one number for each joint."""


class InertiaSet(NamedTuple):
    """Masses of the seven links, as one source publishes them."""

    mass: Array
    """Link masses [kg], shape (7,)."""
    com: Array
    """Centres of mass in the link frames [m], shape (7, 3)."""
    inertia: Array
    """Inertias about the com, link axes [kg m2], shape (7, 3, 3)."""


def array_shapes() -> dict[str, tuple[int, ...]]:
    """Return the shape of each field of a Robot that is an array."""
    names = [f.name for f in fields(Robot) if f.name not in _NO_ARRAYS]
    return {name: _SHAPES.get(name, (7,)) for name in names}


def _frozen(value: Any, shape: tuple[int, ...], name: str) -> Array:
    """Copy to a read-only float array of this shape, or say what is wrong."""
    array = np.array(value, dtype=float, order="C")
    if array.shape != shape:
        raise ConfigError(f"{name} has shape {array.shape}; it must be {shape}")
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ConfigError(f"{name}{list(index)} is {array[index]}: it must be finite")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, kw_only=True, eq=False)
class Payload:
    """A rigid body mounted on the flange."""

    mass: float
    """Mass [kg], >= 0."""
    com: Vec3
    """Centre of mass in the flange frame [m], shape (3,)."""
    inertia: Mat33
    """Inertia about the centre of mass, flange axes [kg m2], shape (3, 3)."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass >= 0.0):
            raise ConfigError(f"payload mass is {self.mass} kg: it must be >= 0")
        object.__setattr__(self, "com", _frozen(self.com, (3,), "payload com"))
        inertia = _frozen(self.inertia, (3, 3), "payload inertia")
        require_inertia(inertia, "the payload")
        object.__setattr__(self, "inertia", inertia)


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """A serial arm of seven hinges, each about the z axis of its own frame.

    Arrays are read-only; two robots are equal only if they are the same object.
    """

    name: str
    """Name, for messages and files."""
    origin_position: Array
    """Joint origins in the parent link [m], shape (7, 3)."""
    origin_rotation: Array
    """Joint frames in the parent link at q = 0, shape (7, 3, 3)."""
    mass: Vec7
    """Link masses [kg], shape (7,); the payload is part of link 7."""
    com: Array
    """Link centres of mass in the link frame [m], shape (7, 3)."""
    inertia: Array
    """Link inertias about the com, link axes [kg m2], shape (7, 3, 3)."""
    flange_position: Vec3
    """Flange in the link-7 frame [m], shape (3,)."""
    flange_rotation: Mat33 = field(default_factory=lambda: np.eye(3))
    """Flange axes in the link-7 frame, shape (3, 3)."""
    tool_position: Vec3 = field(default_factory=lambda: np.zeros(3))
    """TCP in the flange frame [m], shape (3,)."""
    tool_rotation: Mat33 = field(default_factory=lambda: np.eye(3))
    """TCP axes in the flange frame, shape (3, 3)."""
    q_min: Vec7
    """Lower joint limits [rad], shape (7,)."""
    q_max: Vec7
    """Upper joint limits [rad], shape (7,)."""
    dq_max: Vec7
    """Joint speed limits [rad/s], shape (7,)."""
    tau_max: Vec7
    """Motor torque limits [Nm], gravity included, shape (7,)."""
    damping: Vec7 = field(default_factory=lambda: np.full(7, 0.5))
    """Viscous friction of the joints that the model assumes [Nms/rad], shape (7,)."""
    armature: Vec7 = field(default_factory=lambda: np.full(7, 0.1))
    """Rotor inertia at the joints that the model assumes [kg m2], shape (7,)."""
    postures: Mapping[str, Vec7] = field(default_factory=dict)
    """Where inverse kinematics starts [rad], by name: "down" (the tool over a table),
    "forward" (the tool level), "rest". Without down: the middle of the joints."""
    inertia_set: str = NOMINAL
    """Name of the inertia set that mass, com and inertia are."""
    inertia_sets: Mapping[str, InertiaSet] = field(default_factory=dict)
    """Other published sets of the same arm, by name; see `with_inertia`."""
    payload: Payload | None = None
    """What the flange carries; it is already merged into mass, com and inertia."""
    drawn: tuple[tuple[Drawn, ...], ...] = ((),) * 8
    """What base and links are drawn as, in their frames; a link of none as a plain
    body. Of this machine: it does not go over a wire."""

    def __post_init__(self) -> None:
        for name, shape in array_shapes().items():
            value = _frozen(vars(self)[name], shape, f"robot {name}")
            object.__setattr__(self, name, value)
        postures = {
            n: _frozen(q, (7,), f"posture {n}") for n, q in self.postures.items()
        }
        object.__setattr__(self, "postures", postures)
        for i, joint in enumerate(JOINTS):
            if self.mass[i] <= 0.0:
                raise ConfigError(
                    f"mass of link {joint} is {self.mass[i]} kg: it must be > 0"
                )
            require_inertia(self.inertia[i], f"link {joint}")
            if self.q_min[i] >= self.q_max[i]:
                raise ConfigError(
                    f"joint {joint} has q_min {self.q_min[i]} rad >= "
                    f"q_max {self.q_max[i]} rad"
                )
            for name, unit in (("dq_max", "rad/s"), ("tau_max", "Nm")):
                if vars(self)[name][i] <= 0.0:
                    value = vars(self)[name][i]
                    raise ConfigError(f"{name}[{joint}] is {value} {unit}: must be > 0")
        rotations = [*zip(JOINTS, self.origin_rotation, strict=True)]
        rotations += [("flange", self.flange_rotation), ("tool", self.tool_rotation)]
        for name, R in rotations:
            if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
                raise ConfigError(f"rotation of {name} is no rotation: {R.tolist()}")

    def __getstate__(self) -> dict[str, Any]:
        """Leave the cached C++ chain out, so that a robot can cross processes."""
        return {f.name: vars(self)[f.name] for f in fields(self)}

    @classmethod
    def from_mjcf(cls, path: str | Path, **options: Any) -> Self:
        """Read the arm from an MJCF file; see `from_file.load_robot`."""
        from dovetail.robots.from_file import load_robot

        return cls(**load_robot(Path(path), "mujoco", **options))

    @classmethod
    def from_urdf(cls, path: str | Path, **options: Any) -> Self:
        """Read the arm from a URDF file; see `from_file.load_robot`."""
        from dovetail.robots.from_file import load_robot

        return cls(**load_robot(Path(path), "robot", **options))

    def posture(self, name: str) -> Vec7:
        """Return where inverse kinematics starts [rad]: a posture, or "down"."""
        usual = self.postures.get("down", (self.q_min + self.q_max) / 2.0)
        return self.postures.get(name, usual)

    def with_inertia(self, name: str) -> Self:
        """Return the bare arm with another of its published inertia sets.

        Raises:
            ConfigError: The arm has no such set, or carries a tool already.
        """
        if name == self.inertia_set:
            return self
        if name not in self.inertia_sets or self.payload is not None:
            known = dict.fromkeys((*self.inertia_sets, self.inertia_set))
            raise ConfigError(
                f"robot {self.name} has no inertia set {name!r}; known: "
                f"{', '.join(known)}"
                f"{'; take the bare robot' if self.payload is not None else ''}"
            )
        one = self.inertia_sets[name]
        label = self.name.replace(self.inertia_set, name)
        return replace(self, name=label, inertia_set=name, **one._asdict())

    def with_tool(
        self, payload: Payload, tool_position: Vec3, tool_rotation: Mat33 | None = None
    ) -> Self:
        """Mount a tool: merge its inertia into link 7 and move the TCP.

        Args:
            payload: Mass properties in the flange frame.
            tool_position: TCP in the flange frame [m], shape (3,).
            tool_rotation: TCP axes in the flange frame; default the flange's axes.

        Raises:
            ConfigError: The robot already carries a payload.
        """
        if self.payload is not None:
            raise ConfigError(
                f"robot {self.name} already carries {self.payload.mass} kg: "
                "mount the tool on the bare robot"
            )
        R = self.flange_rotation
        mass, com, inertia = merge_bodies(
            (float(self.mass[6]), self.com[6], self.inertia[6]),
            (
                payload.mass,
                self.flange_position + R @ payload.com,
                R @ payload.inertia @ R.T,
            ),
        )
        merged = {"mass": mass, "com": com, "inertia": inertia}
        arrays = {name: np.array(vars(self)[name]) for name in merged}
        for name, value in merged.items():
            arrays[name][6] = value
        rotation = np.eye(3) if tool_rotation is None else tool_rotation
        return replace(
            self,
            **arrays,
            payload=payload,
            tool_position=tool_position,
            tool_rotation=rotation,
        )

    def chain(self, gravity: "Sequence[float]" = GRAVITY) -> "_core.Chain":
        """Build the C++ kinematics and dynamics of this robot.

        Args:
            gravity: Gravity in world axes [m/s2], shape (3,).
        """
        from dovetail import _core

        R = self.flange_rotation
        return _core.Chain(
            origin_position=self.origin_position,
            origin_rotation=self.origin_rotation,
            mass=self.mass,
            com=self.com,
            inertia=self.inertia,
            tool_position=self.flange_position + R @ self.tool_position,
            tool_rotation=R @ self.tool_rotation,
            gravity=_frozen(gravity, (3,), "gravity"),
        )

    @cached_property
    def _chain(self) -> "_core.Chain":
        return self.chain()

    def tool_pose(self, q: Vec7) -> Pose:
        """Return the TCP's pose in the world at configuration q [rad]."""
        position, rotation = self._chain.pose(np.asarray(q, dtype=float))
        return Pose(np.array(position), quat_from_matrix(rotation))

    def inverse_kinematics(self, pose: Pose, q_seed: Vec7, **options: Any) -> Vec7:
        """Find a configuration with the TCP at a pose; see `kinematics.solve_pose`."""
        limits = self.q_min, self.q_max
        return solve_pose(limits, self._chain, pose, q_seed, **options)
