"""Spring stiffness of a cabinet whose impedance is not off, measured by leaning on it.

An FRI client sends a position beside its torque. With stiffness 0 on the cabinet's side
it does nothing. With stiffness K, a position that is off by 0.02 rad pulls with as much
as 0.02 K, which the client's own controller has to hold against. Meanwhile all joints
are pushed to and fro, so that dry friction cannot hold for it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail import _core
from dovetail.arms.fri_arm import FriArm
from dovetail.doctor.check import Check, signed
from dovetail.doctor.excitation import random_times
from dovetail.doctor.log_gaps import longest_filled
from dovetail.doctor.torque_balance import JointFit, balance_of, inertia_with_rotors
from dovetail.plants.plant import COLUMN, FLAG_MASK
from dovetail.types import JOINTS, Array, Vec7

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
SPRING_MIN = 10.0
"""Stiffness that counts as one of the cabinet's [Nm/rad]."""
FIXED_MIN = 100.0
"""The same to a fixed position, where friction is mistaken for some [Nm/rad]."""
FRICTION, FRICTION_MAX = 0.5, 6.0
"""Viscous friction of a joint that is taken for its own, and the most that may be its
own, dry friction mistaken for some included [Nms/rad]."""
SENT_RATE = 2.0 * np.pi * 20.0
"""Of the filter between measured and sent position [1/s]; `ServoParams`."""
EXACT = 0.15
"""Share within which a stiffness is said to be known [1]."""
_SPREADS, _SURE = 5.0, 3.0
_STEP = 0.05


def measure_spring(arm: FriArm, q: Vec7, delay: float) -> tuple[JointFit, ...]:
    """Lean on every joint at once, while the arm is held, and fit what it did.

    Args:
        arm: It rests at q.
        q: Configuration at rest [rad].
        delay: Delay of the loop [s].

    Raises:
        ArmError: The arm was stopped, or the motion ended.
    """
    inertia, period, fits = inertia_with_rotors(arm, q), arm.facts.period, []
    for share in ROUNDS:
        log, share_reached = _lean(arm, q, share * LEAN)
        rows = longest_filled(np.column_stack([log, share_reached]), period)
        leans = share * np.outer(LEAN, rows[:, -1])
        fits = [
            balance_of(rows, joint, inertia, period, leans[joint]).solve(delay)
            for joint in range(7)
        ]
        if max(fit.sent_spring for fit in fits) > STIFF:
            break
    return tuple(fits)


def check_spring(
    fits: Sequence[JointFit],
    before: Sequence[JointFit],
    delay: float,
    inertia: Array,
    period: float,
) -> Check:
    """Report the cabinet's impedance if it is on.

    Args:
        fits: Torque balances of the joints while they were leaned on.
        before: Torque balances without a lean, where the joints moved farther.
        delay: Measured delay of the loop [s].
        inertia: The model's inertia with rotors [kg m2], shape (7, 7).
        period: Control period [s].
    """
    name = "cabinet's spring"
    spring = np.array([fit.sent_spring for fit in fits])
    spread = np.array([fit.spread_of("sent_spring") for fit in fits])
    detail = f"{signed(spring, 0)} Nm/rad"
    is_sprung = (spring > SPRING_MIN) & (spring > _SPREADS * spread)
    if not is_sprung.any():
        return Check(name, "ok", f"none: {detail}")
    lag = 1.0 / SENT_RATE + delay + 0.5 * period  # of a sent position
    damping = np.array([fit.damping for fit in before]) - spring * lag
    critical = 2.0 * np.sqrt(np.maximum(spring, 0.0) * inertia.diagonal())

    def ratio(friction: float) -> float:
        """Weigh a joint by its critical damping: the heavy ones tell most."""
        return float((damping - friction) @ critical / (critical @ critical))

    said = "no damping is seen"
    if ratio(FRICTION_MAX) > 0.0:
        said = (
            f"it adds damping, too, a ratio of about {ratio(FRICTION):.1f}: set it to "
            "0 in the control mode of the Java application"
        )
    return Check(
        name,
        "broken",
        f"{detail}: the cabinet adds stiffness of "
        f"{_stiffness(spring, spread, is_sprung)}{_where(is_sprung)}: "
        f"set it to 0; {said}",
    )


def _stiffness(spring: Array, spread: Array, is_sprung: NDArray[np.bool_]) -> str:
    """Return the stiffness of the joints with a spring, or its lower bound."""
    about = float(np.median(spring[is_sprung]))
    doubt = float(np.median(spread[is_sprung])) / np.sqrt(np.count_nonzero(is_sprung))
    sure = about - _SURE * doubt
    if sure > (1.0 - EXACT) * about:
        return f"about {_round(about):g} Nm/rad"
    return (
        f"at least {_round(sure):g} Nm/rad (dry friction, or answers that came late, "
        f"leave {_round(about - sure):g} Nm/rad open)"
    )


def check_fixed_spring(fits: Sequence[JointFit]) -> Check | None:
    """Report a spring that pulls joints back to where they were; None without one."""
    spring = np.array([fit.stiffness for fit in fits])
    spread = np.array([fit.spread_of("stiffness") for fit in fits])
    is_sprung = (spring > FIXED_MIN) & (spring > _SPREADS * spread)
    if not is_sprung.any():
        return None
    return Check(
        "spring",
        "broken",
        f"{signed(spring, 0)} Nm/rad: something pulls the arm back to where it stands "
        f"with about {_round(float(np.median(spring[is_sprung]))):g} Nm/rad"
        f"{_where(is_sprung)}: the cabinet's impedance (set its stiffness to 0), or a "
        "contact",
    )


def _where(is_sprung: NDArray[np.bool_]) -> str:
    """Name the joints, where it is not all of them."""
    if is_sprung.all():
        return ""
    names = [name for name, sprung in zip(JOINTS, is_sprung, strict=True) if sprung]
    return f" at {', '.join(names)}"


def _round(value: float) -> float:
    """Return two digits, as no more is known."""
    return float(f"{value:.2g}")


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
    return log, reached(log, sides, arm.facts.period)


def _last_answered(arm: FriArm) -> float:
    """Return the servo loop's time of the last cycle that was answered [s]."""
    state = arm.monitoring()
    return state.time - arm.facts.period * state.is_waiting


def reached(log: Array, sides: list[Side], period: float) -> Array:
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
