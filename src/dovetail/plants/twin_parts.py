"""The parts of a twin: its arm, the way to its joints and back, and contact."""

from typing import Annotated, Self

from pydantic import model_validator

from dovetail.plants.plant import (
    ARMATURE,
    CONTACT_FRICTION,
    CONTACT_TIME,
    COULOMB,
    DAMPING,
    GRAVITY_RESIDUAL,
    MASS_SCALE,
    Engine,
    require_inertia_set,
)
from dovetail.settings import Range, settings


@settings(owner="twin")
class TwinRun:
    """Description of a twin, its engine and its random numbers."""

    description: str
    """Description of the twin, one line."""
    engine: Engine
    """Physics engine: another one than the policy was trained in."""
    seed: Annotated[int, Range(0, 2**63 - 1, "1")]
    """Seed of the noise, >= 0."""


@settings(owner="twin")
class TwinArm:
    """Arm of a twin: masses, gravity, friction and rotors."""

    inertia: str
    """Published inertia set of the arm; the controller's is drake."""
    mass_scale: Annotated[tuple[float, ...], MASS_SCALE]
    """Mass and inertia of each link over the set's, payload in link 7 [1]."""
    gravity_residual: Annotated[tuple[float, float, float], GRAVITY_RESIDUAL]
    """True gravity minus the compensated one, world axes [m/s2]."""
    damping: Annotated[tuple[float, ...], DAMPING]
    """Viscous friction of each joint [Nms/rad]."""
    coulomb: Annotated[tuple[float, ...], COULOMB]
    """Dry friction of each joint [Nm]."""
    armature: Annotated[tuple[float, ...], ARMATURE]
    """Rotor inertia at each joint [kg m2]."""

    @model_validator(mode="after")
    def _check_twin_arm(self) -> Self:
        """Refuse an inertia set that there is not, and a number out of range."""
        require_inertia_set(self.inertia, "twin")
        return self


@settings(owner="twin")
class TwinChannel:
    """Between controller and joints: how late a torque acts, and the noise."""

    command_delay: Annotated[float, Range(0.0, 0.1, "s")]
    """Delay of the torque command [s], the same at every control period: where it is no
    whole number of physics steps, a change of the torque takes one step to come."""
    torque_noise: Annotated[float, Range(0.0, 20.0, "Nm")]
    """Standard deviation of the torque, per joint and command [Nm]."""
    position_noise: Annotated[float, Range(0.0, 0.01, "rad")]
    """Standard deviation of the encoders, per joint and reading [rad]."""
    velocity_noise: Annotated[float, Range(0.0, 0.5, "rad/s")]
    """Standard deviation of the measured velocity, per joint and reading [rad/s]."""


@settings(owner="twin")
class TwinContact:
    """Contact of the tool in a twin."""

    contact_friction: Annotated[float, CONTACT_FRICTION]
    """Sliding friction coefficient of the tool [1]."""
    contact_time: Annotated[float, CONTACT_TIME]
    """Time constant of contact [s], see `DynamicsConfig`; MuJoCo only."""
