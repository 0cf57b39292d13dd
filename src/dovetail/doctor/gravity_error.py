r"""Gravity torque that compensation misses: its allowed size, and the true load.

**Allowed.** The limits were shown to hold with every link's mass off by a share
:math:`e`, the payload off by a mass that is a part of the last link, and gravity off by
:math:`\gamma` along each axis. With :math:`t_{ik}` the torques that link i takes where
gravity is 1 m/s2 along axis k, joint j then misses at most

.. math:: 9.81 \sum_i e_i |t_{iz}|
    + \gamma \sum_k \left(\Big|\sum_i t_{ik}\Big| + \sum_i e_i |t_{ik}|\right)

No arm of that range misses more. At a working pose the heaviest one misses as much.

**Explained.** See `robots.missed_load`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dovetail.control.proven import GRAVITY_ERROR, unproven
from dovetail.doctor.check import Check, signed
from dovetail.doctor.torque_balance import JointFit
from dovetail.robots.missed_load import (
    LIGHTEST,
    MissedLoad,
    declared_load,
    explain_by_load,
    is_plausible,
)
from dovetail.robots.robot import Robot
from dovetail.types import JOINTS, Array, Vec7

CERTAIN = 0.995
"""Share from which a load is its cause, also inside the declared range [1]: links that
are all too heavy look like a load, but of random arms inside that range at most 2 in
100 so exactly like one of more than 1 kg."""
NOTHING = 0.3
"""Gravity error of every joint below which none is explained [Nm]."""
_GRAVITY = 9.81
_SHARE = 0.05
_UNEXPLAINED = (
    "check the mounting's inclination, and identify the arm (dovetail identify); the "
    "limits are unproven for it, with a tare, too"
)


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


def worst_miss(
    robot: Robot, q: Vec7, error: Vec7, declared: dict[str, float]
) -> tuple[int, float, bool]:
    """Return the joint whose gravity error is the largest share of what is allowed.

    Args:
        robot: The model, tool included.
        q: Configuration at which it was measured [rad].
        error: Of each joint [Nm].
        declared: Largest `mass_error` [1] and `payload_error` [kg].

    Returns:
        Its index, what is allowed there [Nm], and whether its error is beyond that.
    """
    allowed = allowed_gravity_error(robot, q, declared)
    shares = np.abs(error) / allowed
    worst = int(np.argmax(shares))
    return worst, float(allowed[worst]), bool(shares[worst] > 1.0)


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
    """Compare the gravity that a diagnosis misses with the declared range.

    Args:
        robot: The model, tool included.
        q: Configuration of the diagnosis [rad].
        fits: Torque balances of A1 to A7.
        declared: Largest declared errors of the model.
    """
    error = np.array([fit.offset for fit in fits])
    spread = np.array([fit.spread_of("offset") for fit in fits])
    return check_missed(robot, q, error, spread, declared)


def check_missed(
    robot: Robot,
    q: Vec7,
    error: Vec7,
    spread: Vec7,
    declared: dict[str, float],
    name: str = "gravity error",
) -> Check:
    """Compare missed gravity with the declared range, and name the true load.

    Args:
        robot: The model, tool included.
        q: Configuration at which it was measured [rad].
        error: True minus compensated gravity torque of each joint [Nm].
        spread: Standard deviation of each [Nm].
        declared: Largest declared errors of the model.
        name: The check's.
    """
    load = explain_by_load(robot, q, error, spread)
    detail = f"{signed(error)} Nm missed"
    if np.abs(error).max() > NOTHING:
        detail += f"; {_load_text(robot, load)}"
    worst, allowed, is_outside = worst_miss(robot, q, error, declared)
    is_load = is_plausible(robot, load)
    problems = unproven(payload_error=abs(load.mass), declared=declared)
    # A bare flange is what light links or gravity's direction may look like, too.
    is_there = load.total(*declared_load(robot))[0] >= LIGHTEST
    is_certain = is_there and load.explained > CERTAIN
    if problems and is_load and (is_outside or is_certain):
        return Check(name, "broken", f"{detail}: {problems[0]}")
    if is_outside:
        return Check(
            name,
            "broken",
            f"{detail}: at {JOINTS[worst]} that is {abs(error[worst]):.1f} Nm; inside "
            f"the declared range it is 0 to {allowed:.1f} Nm: "
            + ("correct the load data" if is_load else _UNEXPLAINED),
        )
    return Check(name, "ok", detail)


def _load_text(robot: Robot, load: MissedLoad) -> str:
    """Name the load that explains a gravity error, if there is one."""
    if not is_plausible(robot, load):
        return (
            "no load at the flange explains it: the masses of the arm's own links "
            "differ, or gravity's direction (the mounting's inclination). A tare takes "
            "it off before each try"
        )
    (mass, com), (whole, where) = (
        declared_load(robot),
        load.total(*declared_load(robot)),
    )
    if whole < LIGHTEST:
        return (
            f"a bare flange, without the declared {mass:.2f} kg, would explain "
            f"{100 * load.explained:.0f} % of it; so may the masses of the arm's own "
            "links, or gravity's direction. A tare takes it off before each try"
        )
    return (
        f"a load of {whole:.2f} kg at {signed(1e3 * where, 0)} mm from the flange "
        f"would explain {100 * load.explained:.0f} % of it, in place of {mass:.2f} kg "
        f"at {signed(1e3 * com, 0)} mm (one pose does not tell where it is along "
        "gravity)"
    )
