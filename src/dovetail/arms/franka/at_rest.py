"""A Franka at rest, before it is moved: what it measures, and the load it knows of."""

from typing import Any, NamedTuple

import numpy as np

from dovetail.types import Vec3, Vec7

SAMPLES = 200
"""States that are averaged; one comes every millisecond."""
_GRAVITY = [0.0, 0.0, -9.81]


class Rest(NamedTuple):
    """Means of an arm that its own controller holds, and its load data."""

    q: Vec7
    """Configuration [rad]."""
    measured: Vec7
    """Torque of the joints by their sensors, gravity included [Nm]."""
    external: Vec7
    """Rest of it that the arm's own model, load included, does not explain [Nm]."""
    is_measured: bool
    """False where not even noise is measured: a simulator without sensors."""
    hand: float
    """Mass of the end effector that Desk knows [kg]."""
    mass: float
    """Mass of end effector and load [kg]."""
    com: Vec3
    """Their centre of mass in the flange frame [m]."""
    gravity: Vec7 | None = None
    """Gravity by the arm's own model, load included [Nm]; None where not asked for."""
    held: Vec7 | None = None
    """Torque that holds it beyond what it compensates [Nm]; None before a motion."""


def look(arm: Any, *, ask_model: bool = False) -> Rest:
    """Read the states of an arm that no program moves.

    Args:
        arm: libfranka's.
        ask_model: Read the arm's own model, too.
    """
    states = [arm.read_once() for _ in range(SAMPLES)]
    q = np.array([state.q for state in states])
    measured = np.array([state.tau_J for state in states])
    external = np.array([state.tau_ext_hat_filtered for state in states])
    last = states[-1]
    gravity = None
    if ask_model:
        last.O_ddP_O = _GRAVITY  # what a simulator does not say
        gravity = np.array(arm.load_model().gravity(last))
    return Rest(
        q.mean(axis=0),
        measured.mean(axis=0),
        external.mean(axis=0),
        bool(np.ptp(measured, axis=0).any()),
        last.m_ee,
        last.m_total,
        np.array(last.F_x_Ctotal),
        gravity,
    )
