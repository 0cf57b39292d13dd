"""Excitation of an arm for its diagnosis: one joint at a time, to and fro."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.plants.plant import DynamicsConfig, physics_steps
from dovetail.types import Array, Vec7

STIFFNESS = 200.0
"""Stiffness of joint targets during a diagnosis [1/s2]."""
ESTIMATE_RATE = 20.0
"""Bandwidth of the disturbance estimate during a diagnosis [1/s]; it bears a delay of
40 ms."""
AMPLITUDE = 0.025
"""Distance of the targets from rest [rad]; the arm turns before it is there."""
TICK = 0.02
"""Targets change sides after one to four of these [s]."""


def excitation_gains(
    osc: OscConfig, limits: LimitConfig
) -> tuple[OscConfig, LimitConfig]:
    """Return settings that bear any delay of the loop, at any place of the tool."""
    return (
        replace(osc, joint_stiffness=STIFFNESS),
        replace(limits, walls=False, estimate_rate=ESTIMATE_RATE),
    )


def simulated_step(period: float) -> float:
    """Return the physics step [s] of a simulated arm at a control period [s]."""
    return period / physics_steps(period, DynamicsConfig().physics_dt)


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
