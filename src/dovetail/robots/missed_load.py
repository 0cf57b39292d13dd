r"""Load at the flange that gravity compensation leaves out.

It takes the torque

.. math:: g_e = 9.81 \left(m\, J_{z} + \sum_k (m c_k)\, (\omega \times R e_k)_z\right)

of every joint: linear in its mass m and its first moments m c. At one configuration
only the three combinations that gravity turns about can be seen; of the others the
smallest load is taken, as no more can be known.
"""

from typing import NamedTuple

import numpy as np

from dovetail.robots.robot import Robot
from dovetail.types import Array, Vec3, Vec7

EXPLAINED = 0.9
"""Share of a gravity error from which a load may be its cause, and is named [1]."""
LIGHTEST, FARTHEST = 0.05, 0.5
"""Least mass [kg] and farthest centre of mass [m] of a load that is believed; with less
mass the flange is bare, and has no centre."""
BELOW_NOTHING = 0.2
"""Mass below zero that a bare flange may seem to carry, by friction and noise [kg]."""
_GRAVITY = 9.81
_SIZES = np.array([1.0, 0.1, 0.1, 0.1])
"""Usual error of the mass [kg], and of its moments [kg m]."""
_CUT = 0.02
"""Directions seen less than this share of the best are left as they are declared."""


class MissedLoad(NamedTuple):
    """Correction to be added to the load data at the flange."""

    mass: float
    """Mass [kg]."""
    moment: Vec3
    """Mass times centre of mass, flange axes [kg m], shape (3,)."""
    explained: float
    """Share of the gravity error's square that goes away with it [1]."""

    def total(self, mass: float, com: Vec3) -> tuple[float, Vec3]:
        """Return mass [kg] and centre of mass [m] of the load with a declared one."""
        whole = mass + self.mass
        if whole < 1e-3:
            return whole, np.asarray(com, dtype=float)
        return whole, (mass * np.asarray(com) + self.moment) / whole


def explain_by_load(robot: Robot, q: Vec7, error: Vec7, spread: Vec7) -> MissedLoad:
    """Return the load that explains gravity errors best.

    Args:
        robot: The model, tool included.
        q: Configuration at which they were measured [rad].
        error: True minus compensated gravity torque of each joint [Nm].
        spread: Standard deviation of each [Nm].
    """
    weight = 1.0 / np.maximum(spread, 0.02)
    weight /= weight.max()
    terms = load_torques(robot, q) * _SIZES
    scaled = np.linalg.lstsq(weight[:, None] * terms, weight * error, rcond=_CUT)[0]
    left = weight * (error - terms @ scaled)
    whole = float(np.sum((weight * error) ** 2))
    share = 1.0 - float(left @ left) / whole if whole > 0.0 else 0.0
    load = scaled * _SIZES
    return MissedLoad(float(load[0]), load[1:], share)


def load_torques(robot: Robot, q: Vec7) -> Array:
    """Return the torques [Nm] of 1 kg at the flange and of 1 kg m along its axes.

    Shape (7, 4): what gravity compensation has to add for each.
    """
    chain = robot.chain()
    _, R_tool = chain.pose(q)
    R = np.asarray(R_tool) @ robot.geometry.tool_rotation.T  # flange axes in the world
    jacobian = np.asarray(chain.jacobian(q))
    linear, angular = jacobian[:3], jacobian[3:]
    to_flange = -R @ robot.geometry.tool_position
    columns = [linear[2] + _turned(angular, to_flange)]
    columns += [_turned(angular, R[:, k]) for k in range(3)]
    return _GRAVITY * np.stack(columns, axis=1)


def _turned(angular: Array, lever: Vec3) -> Vec7:
    """Return the upward part of omega x lever of every joint."""
    return angular[0] * lever[1] - angular[1] * lever[0]


def is_plausible(robot: Robot, load: MissedLoad) -> bool:
    """Return True if a flange may carry the load and it explains most of the error.

    It may carry nothing: the declared tool is not there.
    """
    whole, where = load.total(*declared_load(robot))
    can_be = whole > -BELOW_NOTHING
    if whole > LIGHTEST:
        can_be = bool(np.linalg.norm(where) < FARTHEST)
    return load.explained > EXPLAINED and can_be


def declared_load(robot: Robot) -> tuple[float, Vec3]:
    """Return mass [kg] and centre of mass [m] of the model's payload."""
    payload = robot.payload
    return (0.0, np.zeros(3)) if payload is None else (payload.mass, payload.com)
