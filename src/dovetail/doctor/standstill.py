"""Noise or oscillation of an arm's torque while it is held at a standstill."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm
from dovetail.arms.fri_arm import FriArm
from dovetail.doctor.check import Check
from dovetail.errors import ArmError, PlantError
from dovetail.plants.plant import COLUMN
from dovetail.types import JOINTS, Array, Vec7

TORQUE_RMS = 2.0
"""Noise of a joint's torque that is allowed at rest [Nm RMS]."""
LINE_SHARE = 0.4
"""Share of a torque's variance in one line of its spectrum that is an oscillation."""
LINE_RMS = 1.0
"""Least torque noise that can count as an oscillation [Nm RMS]."""
GROWTH = 2.0
"""Growth from first to last third that is an oscillation at any spectrum [1]."""
SLOWEST = 2.0
"""Slower changes of torque are drift [Hz]."""
SPEED_MAX = 0.3
"""Joint speed at which an arm that is held is let go of [rad/s]."""
REST_TIME = 2.0
"""Time for which a held arm is watched [s], after half a second to settle."""
NUDGE, NUDGE_TURN = (0.5, 0.5, 0.5), 0.005
"""Nudge before the arm is watched with a task's controller: f* [m/s2], and the turn of
each joint [rad]; about a millimetre."""
AS_CONFIGURED = "rest, as tasks run"
_SETTLE, _STEP = 0.5, 0.05


class Standstill(NamedTuple):
    """Torque and motion of a held arm, without their drift."""

    torque: Vec7
    """Noise of the commanded torque [Nm RMS]."""
    motion: Vec7
    """Noise of the measured position [rad RMS]."""
    joint: int
    """The joint whose torque is loudest."""
    frequency: float
    """Frequency at which its torque's spectrum is highest [Hz]."""
    share: float
    """Share of its variance in that line and its two neighbours [1]."""
    growth: float
    """Its torque in the last third of the log over the first third [1]."""

    @property
    def is_oscillating(self) -> bool:
        """True if this is more than noise."""
        if self.torque[self.joint] < LINE_RMS:
            return False
        return self.share > LINE_SHARE or self.growth > GROWTH


def measure_standstill(log: Array, period: float) -> Standstill:
    """Measure a log of an arm that was held.

    Args:
        log: Cycle log, at least 30 rows, without the arm's settling.
        period: Control period [s].
    """
    q = _without_drift(log[:, COLUMN["q1"] : COLUMN["q7"] + 1])
    tau = _without_drift(log[:, COLUMN["tau1"] : COLUMN["tau7"] + 1])
    torque, motion = _rms(tau), _rms(q)
    joint = int(np.argmax(torque))
    loudest = tau[:, joint]
    power = np.abs(np.fft.rfft(loudest * np.hanning(len(loudest)))) ** 2
    frequencies = np.fft.rfftfreq(len(loudest), period)
    power[frequencies < SLOWEST] = 0.0
    peak = int(np.argmax(power))
    line = power[max(peak - 1, 0) : peak + 2].sum()
    third = len(loudest) // 3
    growth = _rms(loudest[-third:]) / max(float(_rms(loudest[:third])), 1e-9)
    return Standstill(
        torque,
        motion,
        joint,
        float(frequencies[peak]),
        float(line / max(power.sum(), 1e-12)),
        float(growth),
    )


def check_standstill(
    standstill: Standstill, name: str = "rest", torque_max: float = np.inf
) -> Check:
    """Compare noise and oscillation of a held arm with the allowed ones.

    Args:
        standstill: The measured noise.
        name: The check's.
        torque_max: Noise of a joint's torque that is allowed [Nm RMS]; the controller
            of a diagnosis is not the one that tasks run with.
    """
    joint = JOINTS[standstill.joint]
    loudest = float(standstill.torque[standstill.joint])
    detail = describe_standstill(standstill)
    if standstill.is_oscillating:
        return Check(
            name,
            "broken",
            f"{detail}: {joint} oscillates at {standstill.frequency:.0f} Hz with "
            f"{loudest:.1f} Nm RMS, {standstill.growth:.1f} times as much at the end "
            "as at first. The loop is later than its controller bears, or a gain is "
            "too high: do not run this arm with these settings",
        )
    if loudest > torque_max:
        return Check(
            name,
            "broken",
            f"{detail}: {joint} has {loudest:.1f} Nm, allowed are {torque_max:g}: the "
            "encoder's noise reaches the torque: run it at a longer period, or with a "
            "slower estimate (a longer declared delay)",
        )
    return Check(name, "ok", detail)


def describe_standstill(standstill: Standstill) -> str:
    """Return the noise of torque and position in words."""
    return (
        f"torque {_sizes(standstill.torque)} Nm RMS, position "
        f"{1e3 * float(standstill.motion.max()):.3f} mrad RMS"
    )


def watch(arm: Arm, hold: _core.Target, seconds: float = REST_TIME) -> Array:
    """Hold the arm by a target and return the cycle log, its begin left out.

    An arm that gets faster than `SPEED_MAX` is held no longer.
    """
    logs: list[Array] = []
    settling = round(_SETTLE / _STEP)
    for _ in range(settling + round(seconds / _STEP)):
        logs.append(arm.step(hold, _STEP).log)
        if _is_fast(logs[-1]):
            return np.vstack(logs)
    return np.vstack(logs[settling:])


def _is_fast(log: Array) -> bool:
    return bool(np.abs(log[:, COLUMN["dq1"] : COLUMN["dq7"] + 1]).max() > SPEED_MAX)


def check_as_configured(arm: Arm, report: Callable[[], str] = str) -> Check:
    """Hold the arm with the controller that tasks run with, and look at its torque.

    It is held as a task holds it, then as a stop does, each after a nudge: dry friction
    can hide that a loop is unstable.

    Args:
        arm: It was reset, or has just begun its motion, with a task's settings; all its
            axes hold.
        report: Returns the last motion in words, for an arm that was stopped; empty by
            default.
    """
    check = Check(AS_CONFIGURED, "broken", "not held")
    for name, hold in (("task", _hold_task), ("stop", _hold_joints)):
        try:
            check = _check_hold(hold(arm), arm.facts.period)
        except (ArmError, PlantError) as error:
            text = f"{error} {report()}".strip()
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


def _check_hold(log: Array, period: float) -> Check:
    if _is_fast(log):
        speed = np.abs(log[:, COLUMN["dq1"] : COLUMN["dq7"] + 1]).max(axis=0)
        worst = int(np.argmax(speed))
        check = check_standstill(measure_standstill(log, period))
        return Check(
            AS_CONFIGURED,
            "broken",
            f"{JOINTS[worst]} reached {speed[worst]:.2f} rad/s while it was held, and "
            f"was let go of: this loop is not stable. {check.detail}",
        )
    return check_standstill(measure_standstill(log, period), AS_CONFIGURED, TORQUE_RMS)


def last_words(arm: FriArm, *, is_resting: bool) -> str:
    """Describe the last second of an arm behind FRI before it was stopped.

    Args:
        arm: The arm.
        is_resting: It was held; otherwise it was moved, and a rhythm is no oscillation.
    """
    log, period = arm.recent(1.0), arm.facts.period
    if len(log) * period < 0.1:
        return ""
    standstill = measure_standstill(log, period)
    said = describe_standstill(standstill)
    if is_resting:
        said = check_standstill(standstill).detail
    return f"In the last second: {said}"


def _without_drift(values: Array) -> Array:
    """Take the straight line off each column."""
    rows = np.arange(len(values))
    line = np.polynomial.polynomial.polyfit(rows, values, 1)
    return values - (line[0] + np.outer(rows, line[1]))


def _rms(values: Array) -> Array:
    return np.sqrt(np.mean(values**2, axis=0))


def _sizes(values: Array) -> str:
    return " ".join(f"{value:.2f}" for value in values)
