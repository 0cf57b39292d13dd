"""Parts of the limits: each one is enforced in C++ and has a flag.

Values are those that benchmarks/adversary.py shows to hold (docs/safety.md).
"""

from dataclasses import field
from typing import Annotated, Any, Self

import numpy as np
from pydantic import model_validator

from dovetail.control.proven import DECLARED, unproven
from dovetail.errors import ConfigError
from dovetail.options import Delay
from dovetail.settings import Range, settings
from dovetail.types import JOINTS, Array, Vec3, Vec7

SCHEMES = ("qp", "paper")
BOUNDS = ("viability", "paper-corrected", "paper-printed")

NEAR_SPEED = Range(1e-4, 10.0, "m/s")
NEAR_PRESS = Range(1e-3, 1e3, "m/s2")

_XYZ = ("X", "Y", "Z")


@settings(eq=False)
class JointLimits:
    """Limits of each joint, and what is kept free before them."""

    q_min: Annotated[Vec7, Range(-10.0, 10.0, "rad", JOINTS)]
    """Lower joint limits [rad]."""
    q_max: Annotated[Vec7, Range(-10.0, 10.0, "rad", JOINTS)]
    """Upper joint limits [rad]."""
    dq_max: Annotated[Vec7, Range(1e-3, 20.0, "rad/s", JOINTS)]
    """Joint speed limits [rad/s]."""
    tau_max: Annotated[Vec7, Range(1e-2, 1e4, "Nm", JOINTS)]
    """Motor torque limits [Nm], gravity included."""
    ddq_max: Annotated[Vec7, Range(1e-2, 1e3, "rad/s2", JOINTS)]
    """Joint acceleration A that the motors can always give [rad/s2]."""
    taper_brake: Annotated[Vec7, Range(1e-2, np.inf, "rad/s2", JOINTS)] = field(
        default_factory=lambda: np.full(7, np.inf)
    )
    """Fall of the speed limit towards a position limit [rad/s2]: at the distance d from
    it, it is sqrt(o^2 + 2 d taper_brake) - o, where o is taper_offset."""
    taper_offset: Annotated[Vec7, Range(0.0, 10.0, "rad/s", JOINTS)] = field(
        default_factory=lambda: np.zeros(7)
    )
    """See taper_brake [rad/s]."""
    dtau_max: Annotated[Vec7, Range(1e-3, np.inf, "Nm/s", JOINTS)] = field(
        default_factory=lambda: np.full(7, np.inf)
    )
    """Largest change of the commanded torque [Nm/s]."""
    jerk_max: Annotated[Vec7, Range(1.0, np.inf, "rad/s3", JOINTS)] = field(
        default_factory=lambda: np.full(7, np.inf)
    )
    """Change of a joint's acceleration that dtau_max always allows [rad/s3]: what the
    limits brake in time for."""
    eta: Annotated[float, Range(0.05, 1.0, "1")] = 0.6
    """Share of ddq_max planned for braking [1]; the rest covers model error."""
    delta_q: Annotated[float, Range(0.0, 0.5, "rad")] = 0.002
    """Margin before a joint limit [rad]."""
    delta_v: Annotated[float, Range(0.0, 0.9, "1")] = 0.01
    """Margin below the joint speed limit, as a share of it [1]."""

    @model_validator(mode="after")
    def _check_joint_limits(self) -> Self:
        """Refuse a joint without room."""
        _require_room("q", self.q_min, self.q_max, JOINTS, "rad", 2 * self.delta_q)
        return self


@settings(eq=False)
class ToolLimits:
    """Limits of the TCP: walls in the world, speed and acceleration."""

    walls: bool = True
    """Enforce the Cartesian limits of the TCP, near_speed and near_press included."""
    x_min: Annotated[Vec3, Range(-10.0, 10.0, "m", _XYZ)]
    """Lower walls of the TCP in the world [m]."""
    x_max: Annotated[Vec3, Range(-10.0, 10.0, "m", _XYZ)]
    """Upper walls of the TCP in the world [m]."""
    dx_max: Annotated[Vec3, Range(1e-3, 10.0, "m/s", _XYZ)] = field(
        default_factory=lambda: np.full(3, 0.5)
    )
    """TCP speed limit per axis [m/s]."""
    ddx_max: Annotated[Vec3, Range(1e-2, 1e3, "m/s2", _XYZ)] = field(
        default_factory=lambda: np.full(3, 5.0)
    )
    """TCP acceleration limit per axis [m/s2]."""
    eta_wall: Annotated[float, Range(0.05, 1.0, "1")] = 0.5
    """Share of ddx_max planned for braking before a wall [1]."""
    delta_x: Annotated[float, Range(0.0, 0.2, "m")] = 0.005
    """Margin before a wall [m]."""
    jerk_wall: Annotated[float, Range(1.0, np.inf, "m/s3")] = np.inf
    """Change of the TCP's acceleration that dtau_max leaves [m/s3]: what walls brake
    in time for."""

    @model_validator(mode="after")
    def _check_tool_limits(self) -> Self:
        """Refuse walls without room."""
        _require_room("x", self.x_min, self.x_max, _XYZ, "m", 2 * self.delta_x)
        return self


@settings(eq=False)
class ApproachLimits:
    """Limits of the TCP below a Target's near plane."""

    near_speed: Annotated[float, NEAR_SPEED] = 0.5
    """TCP speed limit per axis below a Target's near plane [m/s]: contact at this
    speed is what the tool must bear. It holds for force, pose and hold axes with walls
    on; not on a free axis, nor for a joint target."""
    near_press: Annotated[float, NEAR_PRESS] = 1e3
    """Largest f* there against the plane's normal, a Target's tare not counted [m/s2]:
    times the effective mass, about 10 kg, it is the force of standing on a rim. It
    acts from 2 mm above the plane on, more and more, and whole below it."""


@settings()
class DeclaredErrors:
    """Largest declared differences between the arm and its model.

    The margins of the limits are made for them.
    """

    delay: Annotated[Delay, Range(0.0, 0.05, "s")] = DECLARED["delay"]
    """Largest delay from a measurement to the torque it leads to [s]. The period is not
    counted; margins, intervals and rates are made for it."""
    mass_error: Annotated[float, Range(0.0, 0.5, "1")] = DECLARED["mass_error"]
    """Largest error of a link's mass, as a share [1]."""
    payload_error: Annotated[float, Range(0.0, 5.0, "kg")] = DECLARED["payload_error"]
    """Largest error of the payload's mass [kg]."""

    def declared_errors(self) -> dict[str, Any]:
        """Return the declared errors alone, by name."""
        return {name: vars(self)[name] for name in DECLARED}

    def beyond_proven(self) -> list[str]:
        """Say what is declared beyond the table: value, range and remedy of each."""
        return [f"as declared, {text}" for text in unproven(**self.declared_errors())]


@settings(eq=False)
class DisturbanceConfig:
    """Reaction to pushes and to motions that no Target explains."""

    estimate_rate: Annotated[float, Range(0.0, 1e3, "1/s")] = 60.0
    """Bandwidth of the disturbance estimate [1/s]; 0 is off. A loop with a delay bears
    about 0.9 over delay and period."""
    passive: bool = True
    """Limiters only brake against what the estimate says. Off, a contact is a feedback
    that grows; it can be off to show that."""
    brake_rate: Annotated[float, Range(0.0, 1e3, "1/s")] = 60.0
    """Rate of that braking [1/s]."""
    last_line: bool = True
    """End a motion that no Target explains: an oscillation, a limiter that drives or
    pushes, a joint that is too fast. Off only to show what it ends."""
    authority: Annotated[float, Range(1.0, 100.0, "1")] = 4.0
    """Most braking beyond a limit, over ddq_max and ddx_max [1]."""


@settings(eq=False)
class PredictionConfig:
    """The model that the limits predict with."""

    damping: Annotated[Vec7, Range(0.0, 100.0, "Nms/rad", JOINTS)] = field(
        default_factory=lambda: np.full(7, 0.0)
    )
    """Joint damping that the prediction assumes [Nms/rad]."""
    armature: Annotated[Vec7, Range(0.0, 100.0, "kg m2", JOINTS)] = field(
        default_factory=lambda: np.full(7, 0.0)
    )
    """Rotor inertia that the prediction assumes [kg m2]."""
    mid_interval: bool = True
    """Evaluate the model half a period ahead; five times less prediction error."""


@settings(eq=False)
class SaturationConfig:
    """Scheme that keeps accelerations inside the limits."""

    scheme: str = "qp"
    """Saturation scheme: qp (default) or paper (SCS then SJS, corrected)."""
    bounds: str = "viability"
    """Bound formula: viability (default), paper-corrected or paper-printed."""
    kappa: Annotated[float, Range(1.0, 1e3, "1")] = 5.0
    """Interval of the bounds over the period [1]; larger chatters less."""
    s0_wall: Annotated[float, Range(1e-9, 10.0, "1/kg")] = 1e-3
    """Wall mobility below which SCS fades a wall out [1/kg]."""
    rho: Annotated[float, Range(1.0, 1e9, "1")] = 1e6
    """Weight of the wall slack in the QP [1]: walls yield to joints only, but once the
    last line has ended the motion to what holds the tool."""
    exact_sjs: bool = False
    """Paper scheme: continue SJS with an active set to the QP's answer."""

    @model_validator(mode="after")
    def _check_saturation_config(self) -> Self:
        """Refuse an unknown scheme or formula."""
        for name, known in (("scheme", SCHEMES), ("bounds", BOUNDS)):
            if (word := vars(self)[name]) not in known:
                raise ConfigError(f"unknown {name} {word!r}; known: {', '.join(known)}")
        return self


def _require_room(
    name: str, low: Array, high: Array, labels: tuple[str, ...], unit: str, room: float
) -> None:
    """Refuse a range that its margins fill."""
    for i, label in enumerate(labels):
        if high[i] - low[i] <= room:
            raise ConfigError(
                f"{name}_min[{label}] is {low[i]:g} {unit} and "
                f"{name}_max[{label}] is {high[i]:g} {unit}: the range must be "
                f"wider than {room:g} {unit}"
            )
