"""Small pushes that measure an arm: one joint at a time, to and fro."""

from collections.abc import Iterator

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm
from dovetail.types import Array, Vec7

STIFFNESS = 200.0
"""Stiffness of joint targets that it is made for [1/s2]."""
AMPLITUDE = 0.025
"""Distance of the targets from rest [rad]; the arm turns before it is there."""
TICK = 0.02
"""Targets change sides after one to four of these [s]."""


def excite(
    arm: Arm, q: Vec7, joint: int, seconds: float, rng: np.random.Generator
) -> Iterator[Array]:
    """Push one joint to and fro around q; yield the cycle log of each push.

    The targets jump, so the torque does, and a jump tells its time. They change sides
    at random, so that nothing repeats itself that a delay could be mistaken for.

    Args:
        arm: It rests at q.
        q: Where it rests [rad].
        joint: Index of the joint.
        seconds: Duration, about [s].
        rng: Source of the random times.
    """
    side = 1.0
    for duration in random_times(seconds, rng):
        q_d = np.array(q, dtype=float)
        q_d[joint] += side * AMPLITUDE
        yield arm.step(_core.Target(joint_mode=True, q_d=q_d), duration).log
        side = -side


def random_times(seconds: float, rng: np.random.Generator) -> Iterator[float]:
    """Yield times of one to four `TICK` each until they make up enough [s]."""
    spent = 0.0
    while spent < seconds:
        duration = TICK * int(rng.integers(1, 5))
        yield duration
        spent += duration
