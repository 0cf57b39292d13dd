"""Contract of a plant: joint torques in for one control period, joint state out."""

import math
from typing import (
    TYPE_CHECKING,
    Annotated,
    Literal,
    Protocol,
    Self,
    TypeAlias,
)

import numpy as np
from pydantic import model_validator

from dovetail import _core
from dovetail.errors import ConfigError, PlantError
from dovetail.poses import Pose
from dovetail.robots.iiwa14 import INERTIA_SETS
from dovetail.robots.links import NOMINAL
from dovetail.settings import Range, settings
from dovetail.types import JOINTS, Array, Vec3, Vec7

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot
    from dovetail.workcell.workcell import Workcell

Engine: TypeAlias = Literal["mujoco", "bullet", "drake"]
"""Name of a physics engine."""
PLANTS: tuple[Engine, ...] = ("mujoco", "bullet", "drake")

CYCLE_UNITS: dict[str, str] = dict(_core.cycle_columns())
"""Unit of each column of a cycle log, by its name, in order. One row per control cycle:
time since reset; configuration and velocity as measured, noise included; overlay torque
sent, without gravity; TCP pose (wxyz) and twist by the controller's model from the
measured state; true contact force on the tool, world axes, of the cycle's
physics step where it was largest; f* of the target; flags as one number (FLAG_MASK).
C++ says which (cycle_row.hpp)."""

CYCLE_COLUMNS: tuple[str, ...] = tuple(CYCLE_UNITS)
"""Names of the columns of a cycle log."""

COLUMN: dict[str, int] = {name: i for i, name in enumerate(CYCLE_COLUMNS)}
"""Index of each column of a cycle log."""

_INERTIA_SETS = (*INERTIA_SETS, NOMINAL)
_OWNER = "dynamics"

FLAG_MASK: dict[str, int] = {
    name: (1 << width) - 1 << bit for name, (bit, width) in _core.flag_bits().items()
}
"""The bits of each flag in the column `flags`."""

# Ranges that a model of the arm and a twin share.
MASS_SCALE = Range(0.1, 10.0, "1", JOINTS)
GRAVITY_RESIDUAL = Range(-20.0, 20.0, "m/s2", ("x", "y", "z"))
DAMPING = Range(0.0, 100.0, "Nms/rad", JOINTS)
COULOMB = Range(0.0, 50.0, "Nm", JOINTS)
ARMATURE = Range(0.0, 10.0, "kg m2", JOINTS)
CONTACT_FRICTION = Range(0.0, 5.0, "1")
CONTACT_TIME = Range(1e-3, 0.1, "s")


def require_inertia_set(name: str, owner: str) -> None:
    """Refuse a published inertia set that there is not, and name those there are."""
    if name not in _INERTIA_SETS:
        raise ConfigError(
            f"{owner} inertia {name!r} is unknown; known sets: "
            f"{', '.join(_INERTIA_SETS)}"
        )


@settings(owner=_OWNER)
class JointDynamics:
    """Friction and rotors of the joints."""

    damping: Annotated[tuple[float, ...], DAMPING] = (0.5,) * 7
    """Viscous friction of each joint [Nms/rad]."""
    coulomb: Annotated[tuple[float, ...], COULOMB] = (0.0,) * 7
    """Dry friction of each joint [Nm]."""
    armature: Annotated[tuple[float, ...], ARMATURE] = (0.1,) * 7
    """Rotor inertia at each joint [kg m2]."""


@settings(owner=_OWNER)
class ContactDynamics:
    """Contact of the tool with fixture and table."""

    contact_friction: Annotated[float, CONTACT_FRICTION] = 0.3
    """Sliding friction coefficient of the tool on fixture and table [1]."""
    contact_time: Annotated[float, CONTACT_TIME] = 0.005
    """Time constant of contact [s]: 2 sqrt(m / k) of the mass m behind the tool on the
    stiffness k of joints, gripper and surfaces. It is the same at every control period:
    MuJoCo's physics step is at most half of it. Bullet's contacts always end within one
    step, at any value."""


@settings(owner=_OWNER)
class DynamicsConfig(JointDynamics, ContactDynamics):
    """The physics behind the torque: everything here may differ from the model."""

    inertia: str = "drake"
    """Published inertia set of the simulated arm; the iiwa 14's controller has drake,
    a robot with one set has nominal."""
    mass_scale: Annotated[tuple[float, ...], MASS_SCALE] = (1.0,) * 7
    """Mass and inertia of each link over the set's, payload included in link 7 [1]."""
    gravity_residual: Annotated[tuple[float, float, float], GRAVITY_RESIDUAL] = (
        0.0,
        0.0,
        0.0,
    )
    """True gravity minus the compensated one, world axes [m/s2]."""
    gravity_compensation: bool = True
    """The lowest level adds the nominal model's gravity torque, as the cabinet does."""
    physics_dt: Annotated[float, Range(1e-4, 5e-3, "s")] = 0.0025
    """Largest physics step [s]; a control period is split into equal steps."""

    @model_validator(mode="after")
    def _check_dynamics_config(self) -> Self:
        """Refuse numbers that no arm has, by name and index."""
        require_inertia_set(self.inertia, _OWNER)
        return self

    @classmethod
    def of_robot(cls, robot: "Robot") -> Self:
        """Return the dynamics that a robot's model has."""
        return cls(inertia=robot.links.inertia_set, **robot.motors.values())

    def is_compensated(self, robot: "Robot") -> bool:
        """Return True if gravity compensation by the robot's model misses no weight."""
        same = self.inertia == robot.links.inertia_set and set(self.mass_scale) == {1.0}
        return same and self.gravity_compensation and not any(self.gravity_residual)


class Plant(Protocol):
    """A simulated arm in its workcell: torques in, joint state out."""

    cell: "Workcell"
    """Workcell, as simulated."""
    robot: "Robot"
    """The nominal arm: the model whose gravity is compensated."""

    @property
    def dynamics(self) -> DynamicsConfig:
        """The physics behind the torque."""
        ...

    def reset(self, q: Vec7, fixture: Pose) -> None:
        """Put the arm at rest at q [rad] and the fixture at its pose; time becomes 0.

        Raises:
            ConfigError: The fixture is out of reach, or q is not seven finite numbers.
        """
        ...

    def move_fixture(self, fixture: Pose) -> None:
        """Put the fixture at a pose at once, the arm's motion untouched.

        The engines take it for standing where it is: what lies on it is pushed aside,
        not dragged along. Small moves in every control period are smooth.

        Raises:
            ConfigError: The fixture is out of reach.
        """
        ...

    def grasp(self, offset: Pose) -> None:
        """Displace the held part in the fingers, from the next reset on.

        Args:
            offset: The part's frame in the TCP's, which stays where it is.
        """
        ...

    def push(self, force: Vec3) -> None:
        """Push the TCP with a force [N], world axes, until the next push or `reset`."""
        ...

    def read(self) -> tuple[Vec7, Vec7]:
        """Return the measured configuration [rad] and velocity [rad/s]."""
        ...

    def apply(self, tau: Vec7, dt: float) -> None:
        """Hold the overlay torque tau [Nm] for dt [s]; gravity is compensated inside.

        Raises:
            PlantError: The simulation diverged.
        """
        ...

    def run_cycles(
        self,
        controller: _core.Controller,
        target: _core.Target,
        cycles: int,
        period: float,
    ) -> tuple[Array, Vec7, Vec7]:
        """Run the controller against the plant.

        Returns:
            Log of shape (cycles, len(CYCLE_COLUMNS)), and configuration [rad] and
            velocity [rad/s] as measured after the last cycle.

        Raises:
            PlantError: The simulation diverged.
        """
        ...

    def part_positions(self) -> Array:
        """Return the true positions of the parts' joints [rad, m], as in the cell."""
        ...

    def contact_force(self) -> Vec3:
        """Return the force on the tool in the last physics step [N], world."""
        ...

    def contact_force_peak(self) -> Vec3:
        """Return the largest such force during the last `apply` [N], world."""
        ...

    def tool_pose(self) -> Pose:
        """Return the true pose of the TCP in the world, from the engine."""
        ...

    def configure(self, dynamics: DynamicsConfig) -> None:
        """Change the dynamics; call `reset` before the next torque."""
        ...

    def seed(self, seed: int) -> None:
        """Start the noise again; an ideal plant has none."""
        ...

    def attach_channel(self, channel: _core.Channel) -> None:
        """Put a twin's delay and noise between controller and joints."""
        ...

    def close(self) -> None:
        """Release the engine; harmless when repeated."""
        ...


class DrivenPlant(Plant, Protocol):
    """A plant with what a cabinet has at the joints: drives of its own, and brakes."""

    @property
    def command_delay(self) -> float:
        """Delay until a twin's commands act [s]; 0 for an ideal plant."""
        ...

    def apply(self, tau: Vec7, dt: float, drive: Vec7 | None = None) -> None:
        """Hold torques for dt [s]; gravity is compensated inside.

        Args:
            tau: Overlay torque [Nm], late and noisy on a twin: it comes over a wire.
            dt: Time [s].
            drive: Torque of the arm's own drives [Nm], which acts at once.

        Raises:
            PlantError: The simulation diverged.
        """
        ...

    def drop_commands(self) -> None:
        """Forget overlay torques that are still on their way."""
        ...

    def close_brakes(self, torque: Vec7) -> None:
        """Add dry friction [Nm] to every joint, until `open_brakes` or `reset`."""
        ...

    def open_brakes(self) -> None:
        """Take the brakes' friction away, the arm at rest."""
        ...


def physics_steps(period: float, physics_dt: float) -> int:
    """Return into how many physics steps a control period [s] is split."""
    if not (math.isfinite(period) and period > 0.0):
        raise PlantError(f"control period is {period} s; it must be > 0")
    return max(1, math.ceil(period / physics_dt - 1e-9))


def require_configuration(q: Vec7) -> Vec7:
    """Return q as seven finite numbers [rad] or say which one is not."""
    q = np.asarray(q, dtype=float)
    if q.shape != (7,):
        raise ConfigError(f"configuration has shape {q.shape}, needs (7,)")
    for joint, value in zip(JOINTS, q, strict=True):
        if not math.isfinite(value):
            raise ConfigError(f"configuration q[{joint}] is {value} rad")
    return q
