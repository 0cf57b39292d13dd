"""The spring of a cabinet whose impedance is not off, felt by leaning on it.

An FRI client sends a position beside its torque. With stiffness 0 on the cabinet's side
it does nothing. With stiffness K, a position that is off by 0.02 rad pulls with as much
as 0.02 K, which the client's own controller has to hold against.
"""

import numpy as np

from dovetail import _core
from dovetail.arms.fri_arm import FriArm
from dovetail.feel.feeling import balance_of
from dovetail.feel.torque_balance import JointFit
from dovetail.types import Array, Vec7

LEAN = np.array([0.02, -0.02, 0.02, -0.02, 0.01, -0.01, 0.01])
"""How far the sent position of each joint is off, to either side [rad]. Light joints
give way farther; with signs that alternate, the tool stays nearly where it is."""
LEAN_TIME = 0.8
"""How long on each side [s]."""
SIDES = (1.0, -1.0, 1.0, -1.0)
LEAN_RATE = 10.0
"""How quickly the servo loop leans [1/s]; kLeanRate in cpp/src/servo_cycle.cpp."""
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
    log, sides = _lean(arm, q)
    inertia = np.asarray(arm.facts.robot.chain().inertia_matrix(q)) + np.diag(armature)
    share = leaned(sides, arm.facts.period)
    fits = []
    for joint in range(7):
        lean = LEAN[joint] * share
        balance = balance_of(log, joint, inertia, arm.facts.period, lean)
        fits.append(balance.solve(delay))
    return tuple(fits)


def _lean(arm: FriArm, q: Vec7) -> tuple[Array, Array]:
    """Lean to both sides; return the cycle log, and the side asked for in each row."""
    hold = _core.Target(joint_mode=True, q_d=q)
    logs, sides = [], []
    try:
        for side in SIDES:
            arm.lean(side * LEAN)
            for _ in range(round(LEAN_TIME / _STEP)):
                log = arm.step(hold, _STEP).log
                logs.append(log)
                sides.append(np.full(len(log), side))
    finally:
        arm.lean(np.zeros(7))
    for _ in range(10):
        arm.step(hold, _STEP)
    return np.vstack(logs), np.concatenate(sides)


def leaned(sides: Array, period: float) -> Array:
    """Return how far the servo loop has leaned in each cycle, as a share [1]."""
    rate = min(1.0, LEAN_RATE * period)
    share, shares = 0.0, np.empty(len(sides))
    for i, side in enumerate(sides):
        share += rate * (side - share)
        shares[i] = share
    return shares
