"""Diagnosis of an arm: push every joint a little, and fit its motion."""

import os
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm
from dovetail.arms.fri_arm import FriArm
from dovetail.control.proven import unproven
from dovetail.doctor.cabinet_spring import (
    check_fixed_spring,
    check_spring,
    measure_spring,
)
from dovetail.doctor.check import Check
from dovetail.doctor.excitation import excite
from dovetail.doctor.gravity_error import check_gravity_error
from dovetail.doctor.log_gaps import longest_filled
from dovetail.doctor.loop_delay import LoopDelay, check_delay, estimate_delay
from dovetail.doctor.torque_balance import JointFit, balance_of, inertia_with_rotors
from dovetail.errors import ArmError
from dovetail.plants.plant import COLUMN
from dovetail.types import JOINTS, Array, Vec7

PUSH_TIME, PAUSE = 2.0, 0.3
"""Time that a joint is pushed, and the pause before the next [s]."""
TRIES = 5
"""Times that a joint is pushed until a push is free enough of gaps."""
ENOUGH = 0.5
"""Share of a push that must be free of gaps [1]."""
_STEP = 0.05


class ArmDiagnosis(NamedTuple):
    """Properties of an arm that its own small torques show."""

    delay: LoopDelay
    """From a torque command to motion."""
    fits: tuple[JointFit, ...]
    """The torque balance of A1 to A7 with that delay."""
    turned: float
    """Largest turn of a joint [rad]."""


def diagnose_arm(
    arm: Arm,
    q: Vec7,
    *,
    integration_step: float = 0.0,
    seconds: float = PUSH_TIME,
    seed: int = 0,
) -> ArmDiagnosis:
    """Push one joint after the other around q.

    Args:
        arm: It rests at q; its joint targets are as stiff as `excitation.STIFFNESS`.
        q: Configuration at rest [rad].
        integration_step: Step of the simulation behind the arm [s], 0 for a real one.
        seconds: Time that each joint is pushed [s].
        seed: Of the pushes' times.

    Raises:
        ArmError: Too many cycles are missing in the logs, or the arm was stopped.
    """
    inertia = inertia_with_rotors(arm, q)
    rng = np.random.default_rng(seed)
    hold = _core.Target(joint_mode=True, q_d=q)
    balances, turned = [], 0.0
    for joint in range(7):
        for _ in range(round(PAUSE / _STEP)):
            arm.step(hold, _STEP)
        log = _push(arm, q, joint, seconds, rng)
        moved = log[:, COLUMN["q1"] + joint] - q[joint]
        turned = max(turned, float(np.abs(moved).max()))
        balances.append(balance_of(log, joint, inertia, arm.facts.period))
    for _ in range(round(PAUSE / _STEP)):
        arm.step(hold, _STEP)
    delay = estimate_delay(balances, integration_step)
    fitted = delay.delay - 0.5 * integration_step
    return ArmDiagnosis(delay, tuple(b.solve(fitted) for b in balances), turned)


def check_period_proven(period: float) -> Check:
    """Check that the limits were shown to hold at a period [s]."""
    problems = unproven(period=period)
    if problems:
        return Check("period", "broken", problems[0])
    return Check("period", "ok", f"{1e3 * period:g} ms")


def check_dynamics(
    arm: Arm,
    q: Vec7,
    declared: dict[str, float],
    *,
    integration_step: float,
) -> Iterator[Check]:
    """Diagnose an arm that is held; yield checks of its delay, springs and gravity.

    Args:
        arm: It rests at q, with the settings of `excitation_gains`.
        q: Configuration at rest [rad].
        declared: Largest declared errors of the model and the loop.
        integration_step: Step of the simulation behind it [s], 0 for a real one.

    Raises:
        ArmError: The arm was stopped, or the motion ended.
    """
    found = diagnose_arm(arm, q, integration_step=integration_step)
    yield check_delay(found.delay, found.turned, declared["delay"])
    if isinstance(arm, FriArm):
        fits = measure_spring(arm, q, found.delay.delay - 0.5 * integration_step)
        inertia, delay = inertia_with_rotors(arm, q), found.delay.delay
        yield check_spring(fits, found.fits, delay, inertia, arm.facts.period)
    fixed = check_fixed_spring(found.fits)
    if fixed is not None:
        yield fixed
    yield check_gravity_error(arm.facts.robot, q, found.fits, declared)


def _push(
    arm: Arm, q: Vec7, joint: int, seconds: float, rng: np.random.Generator
) -> Array:
    """Push one joint until enough of a log is free of gaps."""
    longest = np.empty((0, 0))
    for _ in range(TRIES):
        log = np.vstack(list(excite(arm, q, joint, seconds, rng)))
        part = longest_filled(log, arm.facts.period)
        longest = max(longest, part, key=len)
        if len(longest) * arm.facts.period >= ENOUGH * seconds:
            return longest
    had = len(longest) * arm.facts.period
    raise ArmError(
        f"of {seconds:g} s in which {JOINTS[joint]} was pushed, {TRIES} times, no more "
        f"than {had:.2f} s came without a lost cycle; needed: "
        f"{ENOUGH * seconds:g} s: mend the connection first. {overload_hint()}".strip(),
        "gaps",
    )


def overload_hint() -> str:
    """Return a warning and a remedy if the machine is overloaded, else empty text."""
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load <= cores:
        return ""
    return (
        f"This machine is busy (load {load:.1f} on {cores} cores), so that answers "
        "come late: end what else runs here; a simulated cabinet waits for it with "
        "clock=lockstep"
    )
