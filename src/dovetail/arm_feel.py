"""Feel an arm for the doctor: hold it, push it, lean on it, let go of it in time."""

from collections.abc import Callable, Iterator

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm
from dovetail.arms.fri_arm import FriArm
from dovetail.control.config import LimitConfig
from dovetail.control.proven import unproven
from dovetail.doctor import Check
from dovetail.errors import ArmError, PlantError
from dovetail.feel.feeling import feel_arm
from dovetail.feel.resting import TORQUE_RMS, measure_rest
from dovetail.feel.torque_balance import JointFit
from dovetail.feel_checks import (
    check_delay,
    check_fixed_spring,
    check_gravity_error,
    check_rest,
    check_spring,
    describe_rest,
)
from dovetail.plants.plant import COLUMN
from dovetail.types import JOINTS, Array, Vec7

WILD = 0.3
"""Joint speed at which an arm that is held is let go of [rad/s]."""
REST_TIME = 2.0
"""Time for which a held arm is watched [s], after half a second to settle."""
NUDGE, NUDGE_TURN = (0.5, 0.5, 0.5), 0.005
"""Nudge before the arm is watched with a task's controller: f* [m/s2], and the turn of
each joint [rad]; about a millimetre."""
AS_CONFIGURED = "rest, as tasks run"
_SETTLE, _STEP = 0.5, 0.05


def feel_checks(
    arm: Arm,
    q: Vec7,
    limits: LimitConfig,
    declared: dict[str, float],
    *,
    spring: Callable[[float], tuple[JointFit, ...]] | None,
    integration_step: float,
) -> Iterator[Check]:
    """Push and lean on an arm that is held; yield what it is found to be.

    Args:
        arm: It rests at q, with the settings of `feel.gains`.
        q: Where it rests [rad].
        limits: Of its controller, for the rotors that the model assumes.
        declared: What its owner says of it.
        spring: Leans on the cabinet, given the delay of the loop [s], and fits what it
            did; None where only torques can be sent.
        integration_step: Step of the simulation behind it [s], 0 for a real one.

    Raises:
        ArmError: The arm was stopped, or the motion ended.
    """
    rotors = limits.armature
    feeling = feel_arm(arm, q, rotors, integration_step=integration_step)
    yield check_delay(feeling, declared)
    if spring is not None:
        delay = feeling.delay.delay - 0.5 * integration_step
        fits = spring(delay)
        inertia = np.asarray(arm.facts.robot.chain().inertia_matrix(q))
        inertia += np.diag(rotors)
        yield check_spring(fits, feeling, inertia, arm.facts.period)
    fixed = check_fixed_spring(feeling)
    if fixed is not None:
        yield fixed
    yield check_gravity_error(arm.facts.robot, q, feeling, declared)


def check_period_proven(period: float) -> Check:
    """Say whether the limits were shown to hold at a period [s]."""
    problems = unproven(period=period)
    if problems:
        return Check("period", "broken", problems[0])
    return Check("period", "ok", f"{1e3 * period:g} ms")


def watch(arm: Arm, hold: _core.Target, seconds: float = REST_TIME) -> Array:
    """Hold the arm by a target and return the cycle log, its begin left out.

    An arm that gets faster than `WILD` is held no longer.
    """
    logs: list[Array] = []
    settling = round(_SETTLE / _STEP)
    for _ in range(settling + round(seconds / _STEP)):
        logs.append(arm.step(hold, _STEP).log)
        if _is_wild(logs[-1]):
            return np.vstack(logs)
    return np.vstack(logs[settling:])


def _is_wild(log: Array) -> bool:
    return bool(np.abs(log[:, COLUMN["dq1"] : COLUMN["dq7"] + 1]).max() > WILD)


def check_as_configured(arm: Arm, recall: Callable[[], str] = str) -> Check:
    """Hold the arm with the controller that tasks run with, and look at its torque.

    It is held as a task holds it, then as a stop does, each after a nudge: dry friction
    can hide that a loop is unstable.

    Args:
        arm: It was reset, or has just begun its motion, with a task's settings; all its
            axes hold.
        recall: Says what it did last, where it was stopped; by default nothing.
    """
    check = Check(AS_CONFIGURED, "broken", "not held")
    for name, hold in (("task", _hold_task), ("stop", _hold_joints)):
        try:
            check = _say_rest(hold(arm), arm.facts.period)
        except (ArmError, PlantError) as error:
            text = f"{error} {recall()}".strip()
            check = Check(AS_CONFIGURED, "broken", text)
        if check.status != "ok":
            return check._replace(detail=f"held as by a {name}: {check.detail}")
    return check


def _hold_task(arm: Arm) -> Array:
    arm.step(_core.Target(f_star=np.array([*NUDGE, 0.0, 0.0, 0.0])), 2.0 * _STEP)
    return watch(arm, _core.Target())


def _hold_joints(arm: Arm) -> Array:
    q = arm.step(_core.Target(), _STEP).q
    arm.step(_core.Target(joint_mode=True, q_d=q + NUDGE_TURN), 2.0 * _STEP)
    return watch(arm, _core.Target(joint_mode=True, q_d=q))


def _say_rest(log: Array, period: float) -> Check:
    if _is_wild(log):
        speed = np.abs(log[:, COLUMN["dq1"] : COLUMN["dq7"] + 1]).max(axis=0)
        worst = int(np.argmax(speed))
        check = check_rest(measure_rest(log, period))
        return Check(
            AS_CONFIGURED,
            "broken",
            f"{JOINTS[worst]} reached {speed[worst]:.2f} rad/s while it was held, and "
            f"was let go of: this loop is not stable. {check.detail}",
        )
    return check_rest(measure_rest(log, period), AS_CONFIGURED, TORQUE_RMS)


def last_words(arm: FriArm, *, is_resting: bool) -> str:
    """Say what an arm behind FRI did in the last second before it was stopped.

    Args:
        arm: The arm.
        is_resting: It was held; otherwise it was moved, and a rhythm is no oscillation.
    """
    log, period = arm.recent(1.0), arm.facts.period
    if len(log) * period < 0.1:
        return ""
    resting = measure_rest(log, period)
    said = check_rest(resting).detail if is_resting else describe_rest(resting)
    return f"In the last second: {said}"
