"""Count, from what was measured, the control cycles in which a limit was exceeded."""

from typing import TYPE_CHECKING

import numpy as np

from dovetail.plants.plant import COLUMN
from dovetail.types import Array

if TYPE_CHECKING:
    from dovetail.arms.arm import Arm

_Q = slice(COLUMN["q1"], COLUMN["q7"] + 1)
_DQ = slice(COLUMN["dq1"], COLUMN["dq7"] + 1)
_X = slice(COLUMN["x"], COLUMN["z"] + 1)


class LimitCheck:
    """Judges cycle logs by the robot's limits and the walls, without the margins."""

    def __init__(self, arm: "Arm") -> None:
        """Take joint limits from the robot, walls from the arm if it has any."""
        robot = arm.robot
        limits = getattr(arm, "limits", None)
        walls = limits is not None and limits.walls
        self._low = np.concatenate(
            [robot.q_min, -robot.dq_max, limits.x_min if walls else [-np.inf] * 3]
        )
        self._high = np.concatenate(
            [robot.q_max, robot.dq_max, limits.x_max if walls else [np.inf] * 3]
        )

    def count(self, log: Array) -> int:
        """Return the number of rows with a joint position, speed or wall exceeded."""
        values = np.concatenate([log[:, _Q], log[:, _DQ], log[:, _X]], axis=1)
        outside = (values < self._low) | (values > self._high)
        return int(outside.any(axis=1).sum())
