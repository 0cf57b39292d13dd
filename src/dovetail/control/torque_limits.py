"""Torque limits that cannot hold an arm are refused where a controller is built."""

import warnings
from typing import TYPE_CHECKING

import numpy as np

from dovetail.control.available import as_key, carrying, largest_gravity, samples
from dovetail.errors import TorqueError, UnprovenWarning
from dovetail.types import JOINTS

if TYPE_CHECKING:
    from dovetail.control.config import LimitConfig
    from dovetail.robots.robot import Robot

_GRAVITY_ROOM = 1.2  # times gravity: less is warned of


def check_torque(robot: "Robot", limits: "LimitConfig") -> None:
    """Refuse torque limits that cannot hold the arm; warn of those that barely can.

    It is called wherever a controller is built.

    Args:
        robot: The controller's model, tool and payload included.
        limits: Limits for it.

    Raises:
        TorqueError: Gravity takes the whole torque of a joint somewhere inside its
            limits; names the joint, its torque and what gravity takes.
    """
    model = limits
    span = tuple(map(as_key, (limits.q_min, limits.q_max, limits.dq_max)))
    gravity, tau_max = largest_gravity(robot, *span), np.asarray(limits.tau_max)
    enough = _GRAVITY_ROOM * gravity
    if (gravity >= tau_max).any():
        i = int(np.argmax(gravity / tau_max))
        raise TorqueError(
            f"tau_max[{JOINTS[i]}] is {tau_max[i]:g} Nm; gravity alone takes up to "
            f"{gravity[i]:.3g} Nm there inside the joint limits of {robot.name}"
            f"{carrying(robot)}: the arm would fall. Give at least {enough[i]:.3g} "
            "Nm, a lighter tool, or a narrower q_min and q_max",
            JOINTS[i],
            "gravity",
            {"gravity": float(gravity[i])},
        )
    if (enough > tau_max).any():
        i = int(np.argmax(gravity / tau_max))
        warnings.warn(
            f"tau_max[{JOINTS[i]}] is {tau_max[i]:g} Nm, of which gravity takes up to "
            f"{gravity[i]:.3g} Nm; less than {_GRAVITY_ROOM:g} times that is unproven: "
            f"give at least {enough[i]:.3g} Nm",
            UnprovenWarning,
            stacklevel=3,
        )
        return
    at = samples(robot, *span)
    braking = (at.inertia + np.diag(model.armature)) @ (limits.eta * limits.ddq_max)
    bias = np.abs(at.coriolis) + model.damping * np.abs(at.dq)
    most = (braking + bias + np.abs(at.gravity)).max(axis=0)
    if (most > tau_max).any():
        i = int(np.argmax(most / tau_max))
        warnings.warn(
            f"tau_max[{JOINTS[i]}] is {tau_max[i]:g} Nm; to brake from full speed "
            f"takes up to {most[i]:.3g} Nm, gravity included: less is unproven; lower "
            f"dq_max ({limits.dq_max[i]:.3g} rad/s) or ddq_max "
            f"({limits.ddq_max[i]:.3g} rad/s2)",
            UnprovenWarning,
            stacklevel=3,
        )
