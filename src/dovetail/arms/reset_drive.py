"""Follow the way back to a start until the arm is there."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dovetail.arms.reset_motion import TICK, plan_reset
from dovetail.errors import ArmError
from dovetail.poses import Pose
from dovetail.types import Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.robots.robot import Robot

ARRIVED = 0.02
"""Distance of every joint from the start that ends a reset [rad]."""
ARRIVAL_TIME = 5.0
"""Time to come to rest at the start, after the way there, before a reset fails [s]."""


def drive_to(
    robot: "Robot",
    observe: Callable[[], "_core.ServoState"],
    follow: Callable[["_core.Target"], None],
    q: Vec7,
    fixture: Pose,
    z_max: float,
) -> None:
    """Drive to q [rad], below the limits.

    Args:
        robot: The arm, tool included.
        observe: Returns where it is.
        follow: Follows a target for `TICK`.
        q: The start [rad].
        fixture: The fixture; it is passed at a distance.
        z_max: No higher than this [m].

    Raises:
        ArmError: The arm does not arrive.
    """
    from dovetail import _core

    for q_d in plan_reset(robot, observe().q, q, fixture, z_max):
        follow(_core.Target(joint_mode=True, q_d=q_d))
    at_goal = _core.Target(joint_mode=True, q_d=q)
    error = np.zeros(7)
    for _ in range(round(ARRIVAL_TIME / TICK)):
        state = observe()
        error = np.abs(state.q - q)
        if error.max() < ARRIVED and np.abs(state.dq).max() < 2.0 * ARRIVED:
            return
        follow(at_goal)
    joint = int(np.argmax(error))
    raise ArmError(
        f"the arm does not arrive at the start: A{joint + 1} is {error[joint]:.3f} rad "
        f"away after {ARRIVAL_TIME:g} s; is something in its way, or the start behind "
        "a wall or a joint limit?",
        "reset",
    )
