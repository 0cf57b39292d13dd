"""The numbers that a policy sees, from what the arm measured, in groups of columns."""

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from dovetail.arms.arm import ArmState
from dovetail.errors import ConfigError
from dovetail.poses import rotation_error, theta_about_vertical
from dovetail.robots.robot import Robot
from dovetail.tasks.task import Goal
from dovetail.types import Array, Vec3
from dovetail.workcell.joints import Joint

USUAL_GROUPS = ("joints", "position", "theta", "velocity")
"""Column groups of a task that names none."""

POSITION_SCALE = 0.002
"""Symmetric log: below this distance [m] the scaling is nearly linear."""
THETA_SCALE = 0.02
"""The same for the rotation about the vertical [rad]."""
VELOCITY_SCALE = 0.02
"""The same for the velocity [m/s]."""
FORCE_SCALE = 1.0
"""The same for forces [N]."""
MOMENT_SCALE = 0.1
"""The same for moments [Nm]."""


class ToolError(NamedTuple):
    """The tool beside a goal: what a policy sees, and what it is judged by."""

    state: ArmState
    """Measured state of the arm."""
    goal: Goal
    """Goal of the tool."""
    position_error: Vec3
    """TCP minus the goal [m], world axes, shape (3,)."""
    theta_error: float
    """Rotation about the vertical minus the goal's [rad]."""

    def angle(self) -> float:
        """Return the angle between the tool and the goal [rad], about any axis."""
        turn = rotation_error(self.state.tool.quat_wxyz, self.goal.quat_wxyz)
        return float(np.linalg.norm(turn))


def sight(state: ArmState, goal: Goal) -> ToolError:
    """Compare the tool with a goal."""
    turn = theta_about_vertical(state.tool.quat_wxyz, goal.quat_wxyz)
    return ToolError(state, goal, state.tool.position - goal.position, turn)


class Column(NamedTuple):
    """One number that a policy sees."""

    name: str
    unit: str
    """Unit of the unscaled number."""
    frame: str
    """Reference and axes, in words."""


class Group(NamedTuple):
    """Columns that belong together."""

    columns: tuple[Column, ...]
    scale: float | tuple[float, ...]
    """Symmetric log: below this the scaling is nearly linear; 0: by joint limits. One
    for all columns, or one for each."""
    high: float
    """Bound of the scaled numbers; further values are clipped."""
    read: Callable[["ToolError"], Any]
    """Gives the unscaled numbers."""


def _columns(names: str, unit: str, frame: str) -> tuple[Column, ...]:
    return tuple(Column(f"obs_{name}", unit, frame) for name in names.split())


_GOAL = "tool minus goal, world axes"
_ON_TOOL = "on the tool at the TCP, world axes; estimated"
GROUPS: Mapping[str, Group] = {
    "joints": Group(
        _columns("q1 q2 q3 q4 q5 q6 q7", "rad", "joints"),
        0.0,
        1.1,  # 10 % past a joint limit
        attrgetter("state.q"),
    ),
    "position": Group(
        _columns("x y z", "m", _GOAL),
        POSITION_SCALE,
        7.0,  # 2.2 m
        attrgetter("position_error"),
    ),
    "theta": Group(
        _columns("theta", "rad", "about the vertical, relative to the goal"),
        THETA_SCALE,
        5.1,  # 3.2 rad
        attrgetter("theta_error"),
    ),
    "tilt": Group(
        _columns("tilt_x tilt_y", "rad", "about the world's x and y, from the goal's"),
        THETA_SCALE,
        5.1,  # 3.2 rad
        lambda s: rotation_error(s.state.tool.quat_wxyz, s.goal.quat_wxyz)[:2],
    ),
    "mouth": Group(
        _columns("mouth_x mouth_y mouth_z", "m", "tool minus the mouth, world axes"),
        POSITION_SCALE,
        7.0,  # 2.2 m
        lambda s: s.position_error - s.goal.depth() * s.goal.normal,
    ),
    "velocity": Group(
        _columns("vx vy vz", "m/s", "tool, world axes"),
        VELOCITY_SCALE,
        5.0,  # 2.9 m/s
        lambda sight: sight.state.tool.velocity[:3],
    ),
    "spin": Group(
        _columns("wx wy wz", "rad/s", "tool, world axes"),
        VELOCITY_SCALE,
        7.0,  # 22 rad/s
        lambda sight: sight.state.tool.velocity[3:],
    ),
    "force": Group(
        _columns("fx fy fz", "N", "on the tool, world axes; simulations only"),
        FORCE_SCALE,
        7.0,  # 1.1 kN
        attrgetter("state.contact_force"),
    ),
    "wrench": Group(
        (
            *_columns("wrench_fx wrench_fy wrench_fz", "N", _ON_TOOL),
            *_columns("wrench_mx wrench_my wrench_mz", "Nm", _ON_TOOL),
        ),
        (FORCE_SCALE,) * 3 + (MOMENT_SCALE,) * 3,
        7.0,  # 1.1 kN, 110 Nm
        attrgetter("state.wrench"),
    ),
}
"""Every group that a task may show."""


PARTS = "parts"
"""Name of the group of the joints of parts: simulations only."""


def parts_group(joints: Sequence[Joint]) -> Group:
    """Return the columns of the joints of a cell's parts.

    Raises:
        ConfigError: No part has one.
    """
    if not joints:
        raise ConfigError(
            "observation columns parts: no part of this cell has a joint; leave it out"
        )
    columns = [
        Column(f"obs_{joint.column}", joint.unit, "joint of a part; simulations only")
        for joint in joints
    ]
    scales = {"m": POSITION_SCALE, "rad": THETA_SCALE}
    scale = tuple(scales[joint.unit] for joint in joints)
    if len(joints) == 1:  # one number, not an array of one: see `Layout`
        return Group(tuple(columns), scale[0], 7.0, lambda s: s.state.parts[0])
    return Group(tuple(columns), scale, 7.0, attrgetter("state.parts"))


class Layout:
    r"""The columns of one environment: how they are read and scaled.

    Joint angles are scaled by their limits, the rest by a symmetric logarithm:

    .. math:: y = sign(x) \ln(1 + |x| / s)

    It is monotone and invertible and gives the network millimetres near the goal. The
    position is counted from `zero_offset` from the goal, the mouth of an opening,
    because that is where millimetres decide: without it a part was inserted half as
    often after 15,000 steps.
    """

    def __init__(
        self,
        groups: Sequence[str],
        robot: Robot,
        zero_offset: Vec3,
        joints: Sequence[Joint] = (),
    ) -> None:
        """Lay out the columns.

        Args:
            groups: Names of `GROUPS`, in order.
            robot: Its joint limits scale joint angles.
            zero_offset: Zero of the scaled position minus the goal [m], world axes.
            joints: Of the cell's parts, for the group `parts`.

        Raises:
            ConfigError: An unknown group, or one twice.
        """
        known = dict(GROUPS)
        if PARTS in groups:
            known[PARTS] = parts_group(joints)
        unknown = [name for name in groups if name not in known]
        if unknown or len(set(groups)) < len(groups) or not groups:
            raise ConfigError(
                f"observation columns are {', '.join(groups) or 'none'}; give each of "
                f"these at most once: {', '.join((*GROUPS, PARTS))}"
            )
        self.columns = tuple(c for name in groups for c in known[name].columns)
        size = len(self.columns)
        self._zero, self._unit = np.zeros(size), np.ones(size)
        self._is_log, high = np.ones(size, dtype=bool), np.zeros(size)
        self._read: list[tuple[slice | int, Callable[[ToolError], Any]]] = []
        self.places: dict[str, slice] = {}
        start = 0
        for name in groups:
            group = known[name]
            place = slice(start, start + len(group.columns))
            start = place.stop
            self.places[name] = place
            self._unit[place], high[place] = group.scale, group.high
            if name == "joints":
                self._zero[place] = (robot.limits.q_max + robot.limits.q_min) / 2.0
                self._unit[place] = (robot.limits.q_max - robot.limits.q_min) / 2.0
                self._is_log[place] = False
            if name == "position":
                self._zero[place] = zero_offset
            is_one = len(group.columns) == 1  # an index is quicker than a slice
            self._read.append((place.start if is_one else place, group.read))
        self.high: NDArray[np.float32] = high.astype(np.float32)
        self._high = self.high.astype(float)
        self._low = -self._high
        firsts = np.flatnonzero(self._is_log)
        is_tail = len(firsts) > 0 and bool(self._is_log[firsts[0] :].all())
        self._log: Any = slice(int(firsts[0]), size) if is_tail else self._is_log

    def __len__(self) -> int:
        """Return the number of columns."""
        return len(self.columns)

    def read(self, sight: ToolError) -> Array:
        """Return the unscaled observation, shape (len(self),)."""
        raw = np.empty(len(self.columns))
        for place, read in self._read:
            raw[place] = read(sight)
        return raw

    def scale(self, raw: Array) -> NDArray[np.float32]:
        """Scale unscaled observations, shape (len(self),) or (N, len(self))."""
        out = raw - self._zero
        out /= self._unit
        part = out[..., self._log]
        size = np.abs(part)
        np.log1p(size, out=size)
        out[..., self._log] = np.copysign(size, part, out=size)
        np.maximum(out, self._low, out=out)
        np.minimum(out, self._high, out=out)
        return out.astype(np.float32)

    def is_like(self, other: Self) -> bool:
        """Say whether another one scales as this one does."""
        return self.columns == other.columns and self.describe() == other.describe()

    def describe(self) -> dict[str, list[Any]]:
        """Return the scaling as plain data, for a policy's JSON."""
        return {
            "zero": self._zero.tolist(),
            "unit": self._unit.tolist(),
            "is_logarithmic": self._is_log.tolist(),
        }
