"""Limit on the distance that an arm moves to its start without the user's consent."""

from typing import TYPE_CHECKING

import numpy as np

from dovetail.errors import ArmError
from dovetail.types import JOINTS, Vec7

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot

FARTHEST = 0.15
"""Largest distance of the tool that the arm moves without consent [m]."""
FARTHEST_TURN = 0.5
"""The same for each joint [rad]."""
SAME_PLACE = 0.1
"""An arm whose joints are all within so much of where it was left is still there
[rad]."""


def require_near(robot: "Robot", q: Vec7, q_start: Vec7, left: Vec7 | None) -> None:
    """Refuse a long way to the start without the user's consent.

    Args:
        robot: The arm, tool included.
        q: Where it is [rad].
        q_start: Where it has to be [rad].
        left: Where it was when it last followed this program [rad], None for never.
            From there any way is its own: it goes back as it came.

    Raises:
        ArmError: It is too far, and how far.
    """
    if left is not None and float(np.abs(q - left).max()) < SAME_PLACE:
        return
    here, start = robot.tool_pose(q).position, robot.tool_pose(q_start).position
    distance = float(np.linalg.norm(here - start))
    turns = np.abs(q - q_start)
    joint = int(np.argmax(turns))
    if distance <= FARTHEST and turns[joint] <= FARTHEST_TURN:
        return
    raise ArmError(
        f"the arm is {distance:.2f} m from its start at "
        f"{np.round(start, 2).tolist()} m, and {JOINTS[joint]} {turns[joint]:.2f} rad; "
        f"unasked it moves {FARTHEST:g} m and {FARTHEST_TURN:g} rad at most. Move it "
        "nearer by hand or from the smartPAD, or let it go there: --approach "
        "(approach=yes in the address), slowly, up, across and down; see that nothing "
        "is in the way",
        "far",
    )
