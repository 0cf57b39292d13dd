"""Tare: weight that nobody compensates, measured in free air and taken off f*.

A cabinet compensates gravity by its own model. What it misses by draws on the tool, at
f* = 0 as much as under a policy that was trained without it: 1.7 m/s2 on twin medium.

The tool is led slowly forth and back along a line. Friction takes as much from f* one
way as it adds the other way, so the mean over both is what holds the weight alone.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState
from dovetail.errors import ArmError
from dovetail.types import Array, Vec3

SPEED = 0.015
"""Speed along each axis [m/s]: below the speed limit near contact."""
LEG_STEPS = 10
"""Policy steps of one way."""
STEP_TIME = 0.05
"""Time between two commands [s]: that of a policy."""
TRAVEL = LEG_STEPS * SPEED * STEP_TIME
"""How far the tool goes along each axis, and comes back [m]."""
DAMPING_MIN = 20.0
"""Smallest damping of the force axes with which the tool can be led [1/s]."""
_ROUNDS = 2
_SETTLE_STEPS = 4
_STIFFNESS = 600.0
"""Of the law that leads the tool [1/s2]: with it one round is within 0.3 m/s2 on twin
medium, 0.5 on hard."""
_F_MAX = 12.0
"""Largest f* on the way [m/s2]."""
_CHANGE_MAX = 2.0
"""Largest change from one round to the next [m/s2]; on twin hard 0.5."""


class Tare(NamedTuple):
    """What was measured."""

    f_star: Vec3
    """f* that holds the weight [m/s2], world axes; 0 on axes that were not measured."""
    state: ArmState
    """The arm afterwards; its log holds every cycle of the way."""


def measure_tare(
    arm: Arm,
    state: ArmState,
    axes: Sequence[int],
    direction: Vec3,
    near_plane: Array,
) -> Tare:
    """Lead the tool forth and back in free air, and return the f* that holds it.

    Args:
        arm: At rest, nothing within `TRAVEL` of the tool along the direction.
        state: What it said last.
        axes: Which of x, y, z are force axes; each has a damping of `DAMPING_MIN`.
        direction: Where to go first: +1 or -1 for each of x, y, z, shape (3,).
        near_plane: The plane near contact, as in a Target, shape (4,).

    Raises:
        ArmError: The rounds disagree: something is in the way.
    """
    target = _core.Target()
    target.position_d = state.position
    target.quat_wxyz_d = state.quat_wxyz
    target.near_plane = near_plane
    is_led = np.isin(np.arange(3), axes)
    way = np.where(is_led, direction, 0.0) * SPEED * STEP_TIME
    reference = state.position.copy()
    f_star = np.zeros(6)
    logs: list[Array] = []

    def lead(offset: Vec3) -> Vec3:
        """Command one step towards the reference; return f* beyond the offset."""
        nonlocal state
        pull = np.where(is_led, _STIFFNESS * (reference - state.position), 0.0)
        f_star[:3] = (pull + offset).clip(-_F_MAX, _F_MAX)
        target.f_star = f_star
        state = arm.step(target, STEP_TIME)
        logs.append(state.log)
        return pull

    held = change = np.zeros(3)
    for _ in range(_ROUNDS):
        pulls = []
        for leg in (way, -way):
            for _ in range(LEG_STEPS):
                reference += leg
                pulls.append(lead(held))
        change = np.mean(pulls, axis=0)
        held = held + change
    for _ in range(_SETTLE_STEPS):
        lead(held)
    if not np.abs(change).max() <= _CHANGE_MAX:
        axis = int(np.abs(change).argmax())
        raise ArmError(
            f"tare: f* that holds the tool along {'xyz'[axis]} changed by "
            f"{change[axis]:.1f} m/s2 between two rounds, allowed {_CHANGE_MAX:g}: "
            f"something is in the way within {1e3 * TRAVEL:g} mm of the start, or the "
            "arm does not follow; start in free air, or give --no-tare",
            "tare",
            state,
        )
    return Tare(held, state._replace(log=np.vstack(logs)))
