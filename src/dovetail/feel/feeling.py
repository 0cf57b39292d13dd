"""Feel an arm: push every joint a little, and fit what it did."""

from typing import NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm
from dovetail.errors import ArmError
from dovetail.feel.busy import busy_words
from dovetail.feel.excitation import excite
from dovetail.feel.filled import longest_filled
from dovetail.feel.loop_delay import LoopDelay, estimate_delay
from dovetail.feel.torque_balance import JointFit, TorqueBalance
from dovetail.plants.plant import COLUMN
from dovetail.types import JOINTS, Array, Vec7

PUSH_TIME, PAUSE = 2.0, 0.3
"""Time that a joint is pushed, and the pause before the next [s]."""
TRIES = 5
"""Times that a joint is pushed until a push is free enough of gaps."""
ENOUGH = 0.5
"""Share of a push that must be free of gaps [1]."""
_STEP = 0.05


class Feeling(NamedTuple):
    """Properties of an arm that its own small torques show."""

    delay: LoopDelay
    """From a torque command to motion."""
    fits: tuple[JointFit, ...]
    """The torque balance of A1 to A7 with that delay."""
    turned: float
    """Largest turn of a joint [rad]."""


def feel_arm(
    arm: Arm,
    q: Vec7,
    armature: Vec7,
    *,
    integration_step: float = 0.0,
    seconds: float = PUSH_TIME,
    seed: int = 0,
) -> Feeling:
    """Push one joint after the other around q.

    Args:
        arm: It rests at q; its joint targets are as stiff as `excitation.STIFFNESS`.
        q: Where it rests [rad].
        armature: Rotor inertia that the model assumes [kg m2].
        integration_step: Step of the simulation behind the arm [s], 0 for a real one.
        seconds: How long each joint is pushed [s].
        seed: Of the pushes' times.

    Raises:
        ArmError: Too many cycles are missing in the logs, or the arm was stopped.
    """
    inertia = np.asarray(arm.facts.robot.chain().inertia_matrix(q)) + np.diag(armature)
    rng = np.random.default_rng(seed)
    hold = _core.Target(joint_mode=True, q_d=q)
    balances, turned = [], 0.0
    for joint in range(7):
        for _ in range(round(PAUSE / _STEP)):
            arm.step(hold, _STEP)
        log = _push(arm, q, joint, seconds, rng)
        turned = max(turned, float(np.abs(_of(log, "q")[:, joint] - q[joint]).max()))
        balances.append(balance_of(log, joint, inertia, arm.facts.period))
    for _ in range(round(PAUSE / _STEP)):
        arm.step(hold, _STEP)
    delay = estimate_delay(balances, integration_step)
    fitted = delay.delay - 0.5 * integration_step
    return Feeling(delay, tuple(b.solve(fitted) for b in balances), turned)


def balance_of(
    log: Array,
    joint: int,
    inertia: Array,
    period: float,
    lean: Array | None = None,
) -> TorqueBalance:
    """Return the torque balance of a cycle log without gaps."""
    return TorqueBalance(_of(log, "q"), _of(log, "tau"), joint, inertia, period, lean)


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
        f"{ENOUGH * seconds:g} s: mend the connection first. {busy_words()}".strip(),
        "gaps",
    )


def _of(log: Array, name: str) -> Array:
    return log[:, COLUMN[f"{name}1"] : COLUMN[f"{name}7"] + 1]
