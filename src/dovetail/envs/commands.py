"""From a policy's action to the arm's Target, for any task spec."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dovetail.control.task_spec import TaskSpec
from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_from_vector, quat_multiply

if TYPE_CHECKING:
    from dovetail import _core

ACTION_AXES = ("X", "Y", "Z", "A", "B", "C")
"""Order of the action's numbers; axes that the policy does not command are skipped."""

_TWIST_INDEX = {"X": 0, "Y": 1, "Z": 2, "C": 3, "B": 4, "A": 5}
_FORCE, _POSE = 1, 2


class CommandMap:
    """Turns an action in [-1, 1] into f*, a desired position and a desired rotation.

    * force axis: f* = scale x action, world axes, acceleration of the unit-mass
      operational point [m/s2] or [rad/s2];
    * pose axis X Y Z: goal + range x action [m];
    * pose axis A B C: goal's rotation turned by range x action about world z, y, x
      [rad], so that 0 means aligned with the goal.
    """

    def __init__(
        self,
        task: TaskSpec,
        *,
        f_scale: float,
        f_scale_angular: float,
        theta_range: float,
        position_range: float,
    ) -> None:
        """Lay out the action.

        Args:
            task: Which axis is commanded and how.
            f_scale: f* at action 1 on X Y Z [m/s2].
            f_scale_angular: f* at action 1 on A B C [rad/s2].
            theta_range: Rotation at action 1 on pose axes A B C [rad].
            position_range: Displacement at action 1 on pose axes X Y Z [m].
        """
        modes = [int(mode) for mode in task.modes]
        self.axes = tuple(
            axis for axis in ACTION_AXES if modes[_TWIST_INDEX[axis]] in (_FORCE, _POSE)
        )
        if not self.axes:
            raise ConfigError(
                f"task '{task}' gives the policy nothing to command: "
                "put at least one axis of X Y Z A B C to force or pose"
            )
        self.scale = np.array(
            [
                (f_scale if axis in "XYZ" else f_scale_angular)
                if modes[_TWIST_INDEX[axis]] == _FORCE
                else (position_range if axis in "XYZ" else theta_range)
                for axis in self.axes
            ]
        )
        self._force = [
            (i, _TWIST_INDEX[axis])
            for i, axis in enumerate(self.axes)
            if modes[_TWIST_INDEX[axis]] == _FORCE
        ]
        self._shift = [
            (i, _TWIST_INDEX[axis])
            for i, axis in enumerate(self.axes)
            if modes[_TWIST_INDEX[axis]] == _POSE and axis in "XYZ"
        ]
        self._turn = {
            axis: i
            for i, axis in enumerate(self.axes)
            if modes[_TWIST_INDEX[axis]] == _POSE and axis in "ABC"
        }

    @property
    def size(self) -> int:
        """Length of the action."""
        return len(self.axes)

    def write_target(
        self, action: NDArray[np.float64], goal: Pose, target: "_core.Target"
    ) -> None:
        """Write the action into the target that the arm follows.

        Args:
            action: One number in [-1, 1] per commanded axis, in the order of `axes`.
            goal: Tool pose that pose axes are relative to.
            target: Overwritten.
        """
        scaled = self.scale * action
        f_star = np.zeros(6)
        for i, axis in self._force:
            f_star[axis] = scaled[i]
        position = goal.position
        if self._shift:
            position = position.copy()
            for i, axis in self._shift:
                position[axis] += scaled[i]
        quat = goal.quat_wxyz
        if self._turn:
            turn = np.zeros(3)
            for axis, i in self._turn.items():
                turn["CBA".index(axis)] = scaled[i]
            quat = quat_multiply(quat_from_vector(turn), quat)
        target.f_star = f_star
        target.position_d = position
        target.quat_wxyz_d = quat
