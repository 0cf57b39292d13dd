r"""Gravity torque that an arm inside the declared range may miss.

The limits were shown to hold with every link's mass off by a share :math:`e`, the
payload off by a mass that is a part of the last link, and gravity off by
:math:`\gamma` along each axis. With :math:`t_{ik}` the torques that link i takes where
gravity is 1 m/s2 along axis k, joint j then misses at most

.. math:: 9.81 \sum_i e_i |t_{iz}|
    + \gamma \sum_k \left(\Big|\sum_i t_{ik}\Big| + \sum_i e_i |t_{ik}|\right)

No arm of that range misses more. At a working pose the heaviest one misses as much.
"""

from dataclasses import replace

import numpy as np

from dovetail.control.proven import GRAVITY_ERROR
from dovetail.robots.robot import Robot
from dovetail.types import Array, Vec7

_GRAVITY = 9.81
_SHARE = 0.05


def allowed_gravity_error(robot: Robot, q: Vec7, declared: dict[str, float]) -> Vec7:
    """Return the gravity torque of each joint that may be missed [Nm].

    At least 5 % of the motor's torque: what friction looks like in a joint that
    carries little, such as A7.

    Args:
        robot: The model, tool included.
        q: Configuration [rad].
        declared: Largest `mass_error` [1] and `payload_error` [kg].
    """
    torques = _link_torques(robot, q)
    error = np.full(7, declared["mass_error"])
    error[-1] += declared["payload_error"] / robot.links.mass[-1]
    of_masses = np.einsum("i,kij->kj", error, np.abs(torques))
    of_axes = np.abs(torques.sum(axis=1)) + of_masses
    missed = _GRAVITY * of_masses[2] + GRAVITY_ERROR * of_axes.sum(axis=0)
    return np.asarray(np.maximum(missed, _SHARE * robot.limits.tau_max))


def _link_torques(robot: Robot, q: Vec7) -> Array:
    """Return the torques [Nm] of each link where gravity is 1 m/s2 along each axis.

    Shape (3, 7, 7): axis, link, joint. They are linear in a link's mass.
    """

    def torques(mass: Vec7) -> Array:
        heavy = replace(robot, links=replace(robot.links, mass=mass))
        return np.stack(
            [np.asarray(heavy.chain(e.tolist()).gravity(q)) for e in np.eye(3)]
        )

    mass = robot.links.mass
    doubled = [torques(mass * (1.0 + row)) for row in np.eye(7)]
    return np.stack(doubled, axis=1) - torques(mass)[:, None]
