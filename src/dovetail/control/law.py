"""Parts of the operational-space law, axes in twist order X Y Z C B A."""

from dataclasses import field
from typing import Annotated

import numpy as np

from dovetail.control.task_spec import AXES
from dovetail.settings import Range, settings
from dovetail.types import Vec6

_TASK_AXES = tuple(AXES)


@settings(eq=False)
class AxisGains:
    """Gains of the task axes."""

    stiffness: Annotated[Vec6, Range(0.0, 1e4, "1/s2", _TASK_AXES)] = field(
        default_factory=lambda: np.full(6, 400.0)
    )
    """Stiffness K of pose and hold axes [1/s2], unit mass."""
    damping_ratio: Annotated[Vec6, Range(0.0, 10.0, "1", _TASK_AXES)] = field(
        default_factory=lambda: np.full(6, 1.0)
    )
    """Damping ratio zeta of pose and hold axes [1]; D = 2 zeta sqrt(K)."""
    force_damping: Annotated[Vec6, Range(0.0, 200.0, "1/s", _TASK_AXES)] = field(
        default_factory=lambda: np.full(6, 0.0)
    )
    """Damping of force axes [1/s]; 0 is the paper: f* accelerates to the limits."""


@settings(eq=False)
class ClampConfig:
    """Bounds on the errors that the law uses, and on f*."""

    error_clamp_rotation: Annotated[float, Range(1e-3, np.pi, "rad")] = 0.09
    """Largest rotation error used [rad]: what turns a hand that is wedged. A turn is at
    most as quick as it times sqrt(K) / 2, 1.1 rad/s."""
    move_speed: Annotated[float, Range(1e-3, 1e4, "m/s")] = 0.25
    """Speed at which the desired position goes to one that jumps [m/s], beside the
    Target's own: a jump saturates joints, which then lack what holds the other axes."""
    turn_speed: Annotated[float, Range(1e-2, 1e4, "rad/s")] = 0.8
    """The same of the desired rotation [rad/s]."""
    error_clamp_position: Annotated[float, Range(1e-4, 2.0, "m")] = 0.1
    """Largest position error used [m]."""
    f_clamp_linear: Annotated[float, Range(1e-3, 1e3, "m/s2")] = 30.0
    """Largest f* on a translation axis [m/s2]."""
    f_clamp_angular: Annotated[float, Range(1e-3, 1e4, "rad/s2")] = 200.0
    """Largest f* on a rotation axis [rad/s2]."""


@settings(eq=False)
class IntegralConfig:
    """Integral term of pose and hold axes, against the steady offset left by the tare.

    In contact it presses up to its bound, so the bound is small.
    """

    integral_time: Annotated[float, Range(0.02, 1e3, "s")] = 0.1
    """Time constant with which it follows what pulls beside the tare [s]."""
    integral_clamp_linear: Annotated[float, Range(0.0, 10.0, "m/s2")] = 0.3
    """Largest integral term of a translation [m/s2]; over K it is the largest offset
    that it removes, 0.75 mm. 0 leaves a plain spring."""
    integral_clamp_angular: Annotated[float, Range(0.0, 50.0, "rad/s2")] = 0.3
    """The same of a rotation [rad/s2]."""


@settings(eq=False)
class NullSpaceGains:
    """Gains of the motion that the task leaves free."""

    k_null: Annotated[float, Range(0.0, 100.0, "1/s")] = 10.0
    """Null-space damping k [1/s]; it can only take energy out."""
    posture_stiffness: Annotated[float, Range(0.0, 1e3, "1/s2")] = 50.0
    """Null-space stiffness towards the configuration where the task began [1/s2]:
    without it the elbow falls where gravity compensation is wrong."""


@settings(eq=False)
class TaskInertiaConfig:
    """Computation of the task inertia from the joint-space inertia."""

    length_scale: Annotated[float, Range(1e-2, 10.0, "m/rad")] = 0.15
    """Length L that weighs rotation rows in the task inertia [m/rad]."""
    s0: Annotated[float, Range(1e-6, 10.0, "1/kg")] = 0.005
    """Task inertia eigenvalue below which a direction fades out [1/kg]. With rotor
    inertia in the model the tool-down home pose has 0.0145: 0.02 would fade there."""


@settings(eq=False)
class JointGains:
    """Gains of joint targets."""

    joint_stiffness: Annotated[float, Range(0.0, 1e4, "1/s2")] = 100.0
    """Stiffness K of joint targets [1/s2], each joint alone; 0.2 s to settle."""
    joint_damping_ratio: Annotated[float, Range(0.0, 10.0, "1")] = 1.0
    """Damping ratio zeta of joint targets [1]; D = 2 zeta sqrt(K)."""
