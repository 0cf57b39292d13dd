"""Count control cycles outside a limit, and those whose input was refused."""

from collections.abc import Sequence

import numpy as np

from dovetail import _core
from dovetail.arms.arm import ArmState
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS, FLAG_MASK
from dovetail.robots.robot import Robot
from dovetail.types import Array

BAD_INPUT = FLAG_MASK["bad_input"]
"""Bit of the flags where the controller refused its input."""


def count_bad_input(state: ArmState) -> int:
    """Return in how many cycles of a step the controller refused its input."""
    flags = state.log[:, COLUMN["flags"]].astype(np.int64)
    return int(np.count_nonzero(flags & BAD_INPUT))


class ViolationCounter:
    """The robot's joint limits and the walls, without the controller's margins."""

    def __init__(
        self, robot: Robot, x_min: Sequence[float], x_max: Sequence[float]
    ) -> None:
        """Take the limits.

        Args:
            robot: Joint position [rad] and speed [rad/s] limits.
            x_min: Lower walls of the TCP [m].
            x_max: Upper walls of the TCP [m].
        """
        self._low = np.full(len(CYCLE_COLUMNS), -np.inf)
        self._high = np.full(len(CYCLE_COLUMNS), np.inf)
        joints = robot.limits
        for names, low, high in (
            ([f"q{i}" for i in range(1, 8)], joints.q_min, joints.q_max),
            ([f"dq{i}" for i in range(1, 8)], -joints.dq_max, joints.dq_max),
            (["x", "y", "z"], x_min, x_max),
        ):
            columns = [COLUMN[name] for name in names]
            self._low[columns], self._high[columns] = low, high

    def count(self, log: Array) -> int:
        """Return how many rows of a cycle log lie outside a limit."""
        return _core.count_outside(log, self._low, self._high)
