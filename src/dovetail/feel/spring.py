"""The spring of a cabinet whose impedance is not off, felt by leaning on it.

An FRI client sends a position beside its torque. With stiffness 0 on the cabinet's side
it does nothing. With stiffness K, a position that is off by 0.02 rad pulls with as much
as 0.02 K, which the client's own controller has to hold against. Meanwhile all joints
are pushed to and fro, so that dry friction cannot hold for it.
"""

from typing import NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.fri_arm import FriArm
from dovetail.feel.excitation import random_times
from dovetail.feel.feeling import balance_of
from dovetail.feel.filled import longest_filled
from dovetail.feel.torque_balance import JointFit
from dovetail.plants.plant import COLUMN, FLAG_MASK
from dovetail.types import Array, Vec7

LEAN = np.array([0.02, -0.02, 0.02, -0.02, 0.01, -0.01, 0.01])
"""Offset of the sent position of each joint, to either side [rad]. Light joints give
way farther; with signs that alternate, the tool stays nearly where it is."""
ROUNDS = (0.25, 1.0)
"""Shares of `LEAN` that are used one after the other [1]: a stiff spring is found by
the small one, and is then not leaned on further."""
STIFF = 400.0
"""Stiffness that is found by little [Nm/rad]."""
PUSH = 0.01
"""Distance that the targets go to and fro meanwhile [rad]."""
LEAN_TIME = 0.8
"""Time on each side [s]."""
SIDES = (1.0, -1.0, 1.0, -1.0)
LEAN_RATE = 10.0
"""Rate at which the servo loop leans [1/s]; kLeanRate in cpp/src/servo_cycle.cpp."""
_STEP = 0.05


def feel_spring(
    arm: FriArm, q: Vec7, armature: Vec7, delay: float
) -> tuple[JointFit, ...]:
    """Lean on every joint at once, while the arm is held, and fit what it did.

    Args:
        arm: It rests at q.
        q: Where it is held [rad].
        armature: Rotor inertia that the model assumes [kg m2].
        delay: Delay of the loop [s].

    Raises:
        ArmError: The arm was stopped, or the motion ended.
    """
    inertia = np.asarray(arm.facts.robot.chain().inertia_matrix(q)) + np.diag(armature)
    period, fits = arm.facts.period, []
    for share in ROUNDS:
        log, leaned = _lean(arm, q, share * LEAN)
        rows = longest_filled(np.column_stack([log, leaned]), period)
        late = round(delay / period)  # the sent position acts as late as the torque
        fits = [
            balance_of(
                rows[late:],
                joint,
                inertia,
                period,
                share * LEAN[joint] * rows[: len(rows) - late, -1],
            ).solve(delay)
            for joint in range(7)
        ]
        if max(fit.sent_spring for fit in fits) > STIFF:
            break
    return tuple(fits)


class Side(NamedTuple):
    """A lean that was asked for."""

    since: float
    """The servo loop's time of the last cycle without it [s]."""
    side: float
    """The share of the lean [1]."""


def _lean(arm: FriArm, q: Vec7, lean: Vec7) -> tuple[Array, Array]:
    """Lean to both sides; return the cycle log, and the share reached in each row.

    On a real clock the arm moves on while this program computes, so the servo loop's
    own time gives the row that a lean begins with, not the requested step.
    """
    rng, push = np.random.default_rng(0), PUSH * np.sign(LEAN)
    sides = []
    try:
        for side in SIDES:
            arm.lean(side * lean)
            sides.append(Side(_last_answered(arm), side))
            for duration in random_times(LEAN_TIME, rng):
                arm.step(_core.Target(joint_mode=True, q_d=q + push), duration)
                push = -push
    finally:
        arm.lean(np.zeros(7))
    end = _last_answered(arm)
    for _ in range(10):
        arm.step(_core.Target(joint_mode=True, q_d=q), _STEP)
    log = arm.recent(arm.monitoring().time - sides[0].since)
    time, half = log[:, COLUMN["time"]], 0.5 * arm.facts.period
    log = log[(time > sides[0].since + half) & (time < end + half)]
    return log, leaned(log, sides, arm.facts.period)


def _last_answered(arm: FriArm) -> float:
    """Return the servo loop's time of the last cycle that was answered [s]."""
    state = arm.monitoring()
    return state.time - arm.facts.period * state.is_waiting


def leaned(log: Array, sides: list[Side], period: float) -> Array:
    """Return how far the servo loop has leaned in each cycle, as a share [1]."""
    begins = np.array([since for since, _ in sides]) + 0.5 * period
    index = np.searchsorted(begins, log[:, COLUMN["time"]]) - 1
    wanted = np.array([side for _, side in sides])[index]
    # The loop does not lean in a cycle that holds because its Target is late.
    is_held = log[:, COLUMN["flags"]].astype(np.int64) & FLAG_MASK["target_late"] != 0
    wanted[is_held] = 0.0
    rate = min(1.0, LEAN_RATE * period)
    share, shares = 0.0, np.empty(len(log))
    for i, value in enumerate(wanted):
        share += rate * (value - share)
        shares[i] = share
    return shares
