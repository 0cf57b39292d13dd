"""Facts of a seven-joint arm: geometry, inertia, limits, motors, payload.

A `Robot` is plain data. The maths on it (pose, Jacobian, inertia matrix) is
`dovetail._core.Chain`, which `Robot.chain` builds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_from_matrix
from dovetail.robots.arrays import frozen_array
from dovetail.robots.drawn import Drawn
from dovetail.robots.geometry import Geometry
from dovetail.robots.inertia import merge_bodies, require_inertia
from dovetail.robots.kinematics import solve_pose
from dovetail.robots.links import Links
from dovetail.robots.motors import Motors
from dovetail.robots.robot_limits import RobotLimits
from dovetail.types import Array, Mat33, Vec3, Vec7

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dovetail import _core

GRAVITY = (0.0, 0.0, -9.81)
"""Gravity in world axes [m/s2]."""
ANY_GRIPPER = "any"
"""Gripper of an arm that says nothing of one."""


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
        object.__setattr__(self, "com", frozen_array(self.com, (3,), "payload com"))
        inertia = frozen_array(self.inertia, (3, 3), "payload inertia")
        require_inertia(inertia, "the payload")
        object.__setattr__(self, "inertia", inertia)


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """A serial arm of seven hinges, each about the z axis of its own frame.

    Arrays are read-only; two robots are equal only if they are the same object.
    """

    name: str
    """Name, for messages and files."""
    geometry: Geometry
    """Frames of joints, flange and tool."""
    links: Links
    """Masses and inertias of the links."""
    limits: RobotLimits
    """Limits of the joints: position, speed and torque."""
    motors: Motors = field(default_factory=Motors)
    """Friction and rotor inertia of the drives."""
    postures: Mapping[str, Vec7] = field(default_factory=dict)
    """Start configurations of inverse kinematics [rad], by name: "down" (the tool over
    the table), "forward" (the tool level), "rest". Without down: the joints' middle."""
    payload: Payload | None = None
    """Payload on the flange; it is already merged into mass, com and inertia."""
    gripper: str = "wsg50"
    """Name of the gripper that it usually carries, see `workcell.tool.GRIPPERS`; none
    is a light holder, and any the heaviest that it can brake with."""
    drawn: tuple[tuple[Drawn, ...], ...] = ((),) * 8
    """Meshes of base and links, in their frames; a link without one is drawn as a plain
    body. They are files of this machine, and do not go over a wire."""
    notes: tuple[str, ...] = ()
    """Unused parts of the file that it was read from; see `all_notes`."""

    def __post_init__(self) -> None:
        postures = {
            n: frozen_array(q, (7,), f"posture {n}") for n, q in self.postures.items()
        }
        object.__setattr__(self, "postures", postures)

    def __getstate__(self) -> dict[str, Any]:
        """Leave the cached C++ chain out, so that a robot can cross processes."""
        return {f.name: vars(self)[f.name] for f in fields(self)}

    def arrays(self) -> dict[str, Array]:
        """Return every array by its name: of geometry, links, limits and motors."""
        parts = self.geometry, self.links, self.limits, self.motors
        return {name: vars(part)[name] for part in parts for name in part.shapes}

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

    @property
    def all_notes(self) -> tuple[str, ...]:
        """Unused and assumed facts of its file, and of its motors."""
        return (*self.notes, *self.motors.notes)

    def posture(self, name: str) -> Vec7:
        """Return where inverse kinematics starts [rad]: a posture, or "down"."""
        middle = (self.limits.q_min + self.limits.q_max) / 2.0
        return self.postures.get(name, self.postures.get("down", middle))

    def with_inertia(self, name: str) -> Self:
        """Return the bare arm with another of its published inertia sets.

        Raises:
            ConfigError: The arm has no such set, or carries a tool already.
        """
        own, sets = self.links.inertia_set, self.links.inertia_sets
        if name == own:
            return self
        if name not in sets or self.payload is not None:
            known = dict.fromkeys((*sets, own))
            raise ConfigError(
                f"robot {self.name} has no inertia set {name!r}; known: "
                f"{', '.join(known)}"
                f"{'; take the bare robot' if self.payload is not None else ''}"
            )
        links = replace(self.links, inertia_set=name, **sets[name]._asdict())
        return replace(self, name=self.name.replace(own, name), links=links)

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
        links, flange = self.links, self.geometry.flange_position
        R = self.geometry.flange_rotation
        mass, com, inertia = merge_bodies(
            (float(links.mass[6]), links.com[6], links.inertia[6]),
            (payload.mass, flange + R @ payload.com, R @ payload.inertia @ R.T),
        )
        merged = {"mass": mass, "com": com, "inertia": inertia}
        arrays = {name: np.array(vars(links)[name]) for name in merged}
        for name, value in merged.items():
            arrays[name][6] = value
        rotation = np.eye(3) if tool_rotation is None else tool_rotation
        return replace(
            self,
            links=replace(links, **arrays),
            geometry=replace(
                self.geometry, tool_position=tool_position, tool_rotation=rotation
            ),
            payload=payload,
        )

    def chain(self, gravity: "Sequence[float]" = GRAVITY) -> "_core.Chain":
        """Build the C++ kinematics and dynamics of this robot.

        Args:
            gravity: Gravity in world axes [m/s2], shape (3,).
        """
        from dovetail import _core

        position, rotation = self.geometry.tool_in_link()
        return _core.Chain(
            origin_position=self.geometry.origin_position,
            origin_rotation=self.geometry.origin_rotation,
            mass=self.links.mass,
            com=self.links.com,
            inertia=self.links.inertia,
            tool_position=position,
            tool_rotation=rotation,
            gravity=frozen_array(gravity, (3,), "gravity"),
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
        limits = self.limits.q_min, self.limits.q_max
        return solve_pose(limits, self._chain, pose, q_seed, **options)
