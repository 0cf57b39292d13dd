r"""Gravity torque that compensation misses: its allowed size, and the true load.

**Allowed.** The limits were shown to hold with every link's mass off by a share
:math:`e`, the payload off by a mass that is a part of the last link, and gravity off by
:math:`\gamma` along each axis. With :math:`t_{ik}` the torques that link i takes where
gravity is 1 m/s2 along axis k, joint j then misses at most

.. math:: 9.81 \sum_i e_i |t_{iz}|
    + \gamma \sum_k \left(\Big|\sum_i t_{ik}\Big| + \sum_i e_i |t_{ik}|\right)

No arm of that range misses more. At a working pose the heaviest one misses as much.

**Explained.** A load at the flange that the cabinet does not know takes the torque

.. math:: g_e = 9.81 \left(m\, J_{z} + \sum_k (m c_k)\, (\omega \times R e_k)_z\right)

of every joint: linear in its mass m and its first moments m c. At one configuration
only the three combinations that gravity turns about can be seen; of the others the
smallest load is taken, as no more can be known.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dovetail.control.proven import GRAVITY_ERROR, unproven
from dovetail.doctor.check import Check, signed
from dovetail.doctor.torque_balance import JointFit
from dovetail.robots.robot import Robot
from dovetail.types import JOINTS, Array, Vec3, Vec7

EXPLAINED = 0.9
"""Share of a gravity error from which a load may be its cause, and is named [1]."""
CERTAIN = 0.995
"""The same from which it is its cause, also inside the declared range [1]: links that
are all too heavy look like a load, but of random arms inside that range at most 2 in
100 so exactly like one of more than 1 kg."""
NOTHING = 0.3
"""Gravity error of every joint below which none is explained [Nm]."""
LIGHTEST, FARTHEST = 0.05, 0.5
"""Least mass [kg] and farthest centre of mass [m] of a load that is believed."""
_GRAVITY = 9.81
_SHARE = 0.05
_UNEXPLAINED = (
    "check the mounting's inclination, and identify the arm (dovetail identify); the "
    "limits are unproven for it, with a tare, too"
)
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


def check_gravity_error(
    robot: Robot, q: Vec7, fits: Sequence[JointFit], declared: dict[str, float]
) -> Check:
    """Compare the missed gravity with the declared range, and name the true load.

    Args:
        robot: The model, tool included.
        q: Configuration of the diagnosis [rad].
        fits: Torque balances of A1 to A7.
        declared: Largest declared errors of the model.
    """
    error = np.array([fit.offset for fit in fits])
    spread = np.array([fit.spread_of("offset") for fit in fits])
    load = explain_by_load(robot, q, error, spread)
    detail = f"{signed(error)} Nm missed"
    if np.abs(error).max() > NOTHING:
        detail += f"; {_load_text(robot, load)}"
    allowed = allowed_gravity_error(robot, q, declared)
    worst = int(np.argmax(np.abs(error) / allowed))
    is_outside = abs(error[worst]) > allowed[worst]
    is_load = _is_plausible(robot, load)
    problems = unproven(payload_error=abs(load.mass), declared=declared)
    if problems and is_load and (is_outside or load.explained > CERTAIN):
        return Check("gravity error", "broken", f"{detail}: {problems[0]}")
    if is_outside:
        return Check(
            "gravity error",
            "broken",
            f"{detail}: at {JOINTS[worst]} that is {abs(error[worst]):.1f} Nm; inside "
            f"the declared range it is 0 to {allowed[worst]:.1f} Nm: "
            + ("correct the load data" if is_load else _UNEXPLAINED),
        )
    return Check("gravity error", "ok", detail)


def _load_text(robot: Robot, load: MissedLoad) -> str:
    """Name the load that explains a gravity error, if there is one."""
    if not _is_plausible(robot, load):
        return (
            "no load at the flange explains it: the masses of the arm's own links "
            "differ, or gravity's direction (the mounting's inclination). A tare takes "
            "it off before each try"
        )
    (mass, com), (whole, where) = _declared_load(robot), _total_load(robot, load)
    return (
        f"a load of {whole:.2f} kg at {signed(1e3 * where, 0)} mm from the flange "
        f"would explain {100 * load.explained:.0f} % of it, in place of {mass:.2f} kg "
        f"at {signed(1e3 * com, 0)} mm (one pose does not tell where it is along "
        "gravity)"
    )


def _is_plausible(robot: Robot, load: MissedLoad) -> bool:
    """Return True if a flange may carry the load and it explains most of the error."""
    whole, where = _total_load(robot, load)
    is_near = bool(np.linalg.norm(where) < FARTHEST)
    return load.explained > EXPLAINED and whole > LIGHTEST and is_near


def _declared_load(robot: Robot) -> tuple[float, Vec3]:
    payload = robot.payload
    return (0.0, np.zeros(3)) if payload is None else (payload.mass, payload.com)


def _total_load(robot: Robot, load: MissedLoad) -> tuple[float, Vec3]:
    return load.total(*_declared_load(robot))
