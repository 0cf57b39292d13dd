"""From a policy's action to the arm's Target, for any task spec."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dovetail.control.task_spec import AXES, FORCE, MODES, POSE, TaskSpec
from dovetail.envs.config import ActionConfig
from dovetail.errors import ConfigError
from dovetail.settings import Range, in_range, ranges_of
from dovetail.types import Vec3, Vec4, Vec6

if TYPE_CHECKING:
    from dovetail import _core

ACTION_AXES = ("X", "Y", "Z", "A", "B", "C")
"""Order of the action's numbers; axes that the policy does not command are skipped."""

_TRANSLATION = ("X", "Y", "Z")
_RANGES = {
    "f_scale": Range(0.0, 100.0, "m/s2", _TRANSLATION),
    **ranges_of(ActionConfig),
}
"""Range of each setting of an action; f_scale is one number, or three."""


def per_axis(name: str, value: float | Sequence[float]) -> tuple[float, float, float]:
    """Return a setting of X Y Z as three numbers; one number holds for all.

    Raises:
        ConfigError: Neither one nor three numbers.
    """
    values = np.atleast_1d(np.asarray(value, dtype=object)).tolist()
    if len(values) not in (1, 3):
        raise ConfigError(f"{name} is {value}; give one number, or three: X Y Z")
    x, y, z = values * (3 // len(values))
    return x, y, z


def require_same(begun: NDArray[np.float32], action: NDArray[np.float32]) -> None:
    """Refuse to end a step with another action than it was begun with.

    Raises:
        ConfigError: They differ.
    """
    if not np.array_equal(begun, action):
        raise ConfigError(
            f"a step was begun with the action {begun.tolist()} and is ended with "
            f"{np.asarray(action).tolist()}: what changes actions on their way to the "
            "environment cannot be in a batch"
        )


class CommandMap:
    """Turns an action in [-1, 1] into f*, a desired position and a desired rotation.

    * force axis: f* = scale x action, world axes, acceleration of the unit-mass
      operational point [m/s2] or [rad/s2];
    * pose axis X Y Z: goal + range x action [m];
    * pose axis A B C: goal's rotation turned by range x action about world z, y, x
      [rad], so that 0 means aligned with the goal;
    * every axis but free ones: the tare on top;
    * a force axis X Y Z at exactly 0: held where it is, as nothing is asked of it.
    """

    def __init__(
        self,
        task: TaskSpec,
        *,
        f_scale: float | Sequence[float],
        f_scale_angular: float,
        theta_range: float,
        position_range: float,
    ) -> None:
        """Lay out the action.

        Args:
            task: Which axis is commanded and how.
            f_scale: f* at action 1 on X Y Z [m/s2]: one number, or one per axis.
            f_scale_angular: f* at action 1 on A B C [rad/s2].
            theta_range: Rotation at action 1 on pose axes A B C [rad].
            position_range: Displacement at action 1 on pose axes X Y Z [m].

        Raises:
            ConfigError: The task commands no axis, f_scale is not 1 or 3 numbers, or
                a number is out of its range.
        """
        self.task = task
        given = {
            "f_scale": per_axis("f_scale", f_scale),
            "f_scale_angular": f_scale_angular,
            "theta_range": theta_range,
            "position_range": position_range,
        }
        given = {name: in_range(name, given[name], _RANGES[name]) for name in given}
        f_scales = dict(zip("XYZ", given["f_scale"].tolist(), strict=True))
        scales = {
            (FORCE, False): given["f_scale_angular"],
            (POSE, True): given["position_range"],
            (POSE, False): given["theta_range"],
        }
        modes = {axis: task.modes[AXES.index(axis)] for axis in ACTION_AXES}
        commanded = [axis for axis in ACTION_AXES if modes[axis] in (FORCE, POSE)]
        if not commanded:
            raise ConfigError(
                f"task '{task}' gives the policy nothing to command: put at least one "
                f"axis of {' '.join(ACTION_AXES)} to {MODES[FORCE]} or {MODES[POSE]}"
            )
        self.axes = tuple(commanded)
        self.scale = [
            f_scales[axis]
            if modes[axis] == FORCE and axis in "XYZ"
            else scales[modes[axis], axis in "XYZ"]
            for axis in commanded
        ]
        self._force = [
            (i, AXES.index(axis))
            for i, axis in enumerate(commanded)
            if modes[axis] == FORCE
        ]
        self._pose = [
            (i, AXES.index(axis))
            for i, axis in enumerate(commanded)
            if modes[axis] == POSE
        ]
        self.tare: Vec6 = np.zeros(6)
        """f* that holds the uncompensated weight; see `take_off`."""
        self._taken_off: list[float] = [0.0] * 6
        self._f_star = np.zeros(6)
        self._position = np.zeros(3)
        self._quat = np.zeros(4)

    def take_off(self, tare: Vec6) -> None:
        """Hold this weight from now on: f* [m/s2, rad/s2], world axes, shape (6,)."""
        self.tare = tare
        self._taken_off = tare.tolist()
        self._f_star[:] = tare

    def __len__(self) -> int:
        """Length of the action."""
        return len(self.axes)

    def usable(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return an action inside [-1, 1].

        Raises:
            ConfigError: Not one finite number for each commanded axis.
        """
        action = np.asarray(action, dtype=np.float32)
        values = action.tolist()
        # In double precision a sum of float32 is finite where each of them is.
        size = len(self.axes)
        if action.shape != (size,) or not math.isfinite(sum(values)):
            raise ConfigError(
                f"the action is {values}; it must be {size} finite numbers, one "
                f"for each of {' '.join(self.axes)}"
            )
        if max(values) > 1.0 or min(values) < -1.0:
            action = action.clip(-1.0, 1.0)
        return action

    def fill(
        self,
        target: "_core.Target",
        action: NDArray[np.float32],
        goal_position: Vec3,
        goal_quat: Vec4,
    ) -> None:
        """Write the action into a Target, relative to the goal pose.

        Args:
            target: Overwritten.
            action: In [-1, 1], shape (len(self),).
            goal_position: Tool position when done [m], world axes.
            goal_quat: Tool rotation when done, wxyz.
        """
        values = action.tolist()
        stay = 0
        for i, index in self._force:
            self._f_star[index] = self.scale[i] * values[i] + self._taken_off[index]
            if values[i] == 0.0 and index < 3:  # no policy says exactly nothing
                stay |= 1 << index
        self._position[:] = goal_position
        quat = tuple(goal_quat.tolist())
        for i, index in self._pose:
            value = self.scale[i] * values[i]
            if index < 3:
                self._position[index] += value
            else:
                quat = _turn(quat, index - 3, value)
        self._quat[:] = quat
        target.f_star = self._f_star
        target.f_tare = self.tare
        target.stay = stay
        target.position_d = self._position
        target.quat_wxyz_d = self._quat


def _turn(
    quat: tuple[float, ...], axis: int, angle: float
) -> tuple[float, float, float, float]:
    """Turn a rotation by `angle` [rad] about world x, y or z (0, 1, 2)."""
    w, x, y, z = quat
    c, s = math.cos(angle / 2.0), math.sin(angle / 2.0)
    if axis == 2:
        return c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w
    if axis == 1:
        return c * w - s * y, c * x + s * z, c * y + s * w, c * z - s * x
    return c * w - s * x, c * x + s * w, c * y - s * z, c * z + s * y
