"""An arm made to suit a task: gripper, speeds, ranges and posture that it needs.

A robot's own facts are used as they are. An arm that was read from a file says nothing
of a gripper, and its speeds and ranges may be wider than its torques bear: there the
widest of a few choices is taken with which the arm can brake, and the robot's notes say
which. Nothing is widened.
"""

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar, NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np

from dovetail.control.config import LimitConfig
from dovetail.control.torque_limits import check_torque
from dovetail.errors import ConfigError, DovetailError, TorqueError, UnprovenWarning
from dovetail.poses import Pose, matrix_from_quat, quat_about_z
from dovetail.robots.robot import ANY_GRIPPER, Robot
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.types import Vec3, Vec4, Vec7
from dovetail.workcell.cell_config import CellConfig
from dovetail.workcell.posture import find_posture, mount_turn
from dovetail.workcell.tool import FRANKA_HAND, HOLDER, WSG50, Tool
from dovetail.workcell.workcell import Workcell

_SPEEDS = (1.0, 0.75, 0.5)
"""Shares of the joints' speed limits that are tried."""
_SLOWEST = 0.25
"""Share that is tried last."""
_ROOMS = (1.6, 1.3, 1.0, 0.8, 0.6)
"""Half ranges about the posture that are tried [rad]."""
_PERIOD = 1e-3
"""Control period at which torques are judged [s]; they do not depend on it."""
_ABOVE = 0.10  # [m] over the goal that the tool comes from

_KNOWN: "WeakKeyDictionary[Robot, dict[tuple[object, ...], Robot]]" = (
    WeakKeyDictionary()
)


class Aim(Protocol):
    """Goal of the tool for a fixture: `tasks.task.Goal`."""

    @property
    def position(self) -> Vec3:
        """TCP when done [m]."""
        ...

    @property
    def quat_wxyz(self) -> Vec4:
        """Its rotation when done."""
        ...

    @property
    def normal(self) -> Vec3:
        """Out of the fixture, unit length."""
        ...


class Work(Protocol):
    """Facts of a task that decide what an arm needs: `tasks.task.Task`."""

    posture: ClassVar[str]
    """Name of its posture."""

    def tool(self) -> Tool:
        """Return what holds the part."""
        ...

    def goal(self, fixture: Pose) -> Aim:
        """Return what a fixture asks of the tool."""
        ...

    def trial_poses_in(self, cell: Workcell) -> tuple[FixturePose, ...]:
        """Return where the fixture is tried."""
        ...

    def cell_of(self, robot: Robot, cell: CellConfig | None) -> Workcell:
        """Return the cell of a robot as it is."""
        ...


class _Choice(NamedTuple):
    """Gripper, speed and range that an arm is tried with."""

    gripper: str
    speed: float
    """Share of its speed limits."""
    room: float
    """Half range of its joints about the posture [rad]."""


def suited(robot: Robot, task: Work, cell: CellConfig | None) -> Robot:
    """Return a robot with the posture of a task, and a gripper that it can carry.

    Args:
        robot: The bare arm.
        task: What it does.
        cell: Facts of a cell file; a tool that it gives is kept.

    Raises:
        TorqueError: The arm cannot brake, even slow, near its posture and with the
            lightest tool; says what it lacks with that.
    """
    if robot.postures and robot.gripper != ANY_GRIPPER:
        return robot
    known = _KNOWN.setdefault(robot, {})
    words = "" if cell is None else cell.describe()
    key = (type(task), repr(task), words)  # all of a task's settings
    if key not in known:
        known[key] = _suited(robot, task, cell)
    return known[key]


def _suited(robot: Robot, task: Work, cell: CellConfig | None) -> Robot:
    if robot.gripper != ANY_GRIPPER:
        q = _find(robot, task, cell)
        return robot if q is None else _with_posture(robot, q, task.posture)
    arms: dict[str, Robot] = {}
    lacks: dict[str, DovetailError] = {}
    refusal: DovetailError | None = None
    has_fingers = task.tool().opening is not None
    for choice in dict.fromkeys(_choices(has_fingers)):
        name = choice.gripper
        try:
            if name not in arms:
                arms[name] = _mounted(replace(robot, gripper=name), task, cell)
            arm = _limited(arms[name], choice, task.posture)
            _require_braking(arm, task, cell)
        except (TorqueError, ConfigError) as error:
            lacks.setdefault(name, error)
            refusal = error
            continue
        is_open = has_fingers and (cell is None or cell.tool is None)
        said = _said(robot, choice, lacks, is_open=is_open)
        return replace(arm, notes=(*arm.notes, *said))
    assert refusal is not None  # there is a choice, and each was refused
    raise refusal


def _choices(has_fingers: bool) -> Iterator[_Choice]:
    """Yield what is tried: the usual gripper, a light one, slower, then near by."""
    heavy, light = (WSG50.name, FRANKA_HAND.name) if has_fingers else (HOLDER, HOLDER)
    yield _Choice(heavy, 1.0, np.inf)
    for name in (light, heavy, HOLDER):
        for speed in _SPEEDS:
            yield _Choice(name, speed, np.inf)
    for room in (np.inf, *_ROOMS):
        for name in (light, HOLDER):
            yield _Choice(name, _SLOWEST, room)


def _mounted(robot: Robot, task: Work, cell: CellConfig | None) -> Robot:
    """Return a robot with the task's posture, and its tool turned to suit it."""
    q = _find(robot, task, cell)
    if q is None:
        return robot
    turn, geometry = mount_turn(robot, q), robot.geometry
    if turn == 0.0:
        return _with_posture(robot, q, task.posture)
    R = geometry.flange_rotation @ matrix_from_quat(quat_about_z(turn))
    note = (
        f"{robot.name}: the tool is mounted turned by {np.rad2deg(turn):.0f} deg about "
        "the flange's z, so that A7 works near its middle"
    )
    turned = replace(
        robot,
        geometry=replace(geometry, flange_rotation=R),
        notes=(*robot.notes, note),
    )
    back = q - turn * np.sign(geometry.flange_rotation[2, 2]) * np.eye(7)[6]
    return _with_posture(turned, back, task.posture)


def _with_posture(robot: Robot, q: Vec7, name: str) -> Robot:
    return replace(robot, postures={"down": q, name: q})


def _find(robot: Robot, task: Work, cell: CellConfig | None) -> Vec7 | None:
    """Search the posture of a task; None where it is out of reach."""
    poses: list[Pose] = []
    built = task.cell_of(robot, cell)
    for place in task.trial_poses_in(built):
        goal = task.goal(place.pose())
        above = goal.position + _ABOVE * goal.normal
        poses += [Pose(at, goal.quat_wxyz) for at in (above, goal.position)]
    return find_posture(built.loaded_robot(), poses)


def _limited(robot: Robot, choice: _Choice, posture: str) -> Robot:
    """Return a robot with slower joints, and with narrower ranges about a posture."""
    limits, q = robot.limits, robot.posture(posture)
    low = np.maximum(limits.q_min, q - choice.room)
    high = np.minimum(limits.q_max, q + choice.room)
    speed = choice.speed * limits.dq_max
    return replace(robot, limits=replace(limits, q_min=low, q_max=high, dq_max=speed))


def _require_braking(robot: Robot, task: Work, cell: CellConfig | None) -> None:
    """Refuse an arm that cannot brake in the cell, as its controller would be."""
    loaded = task.cell_of(robot, cell).loaded_robot()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnprovenWarning)
        check_torque(loaded, LimitConfig.for_period(loaded, _PERIOD))


def _said(
    robot: Robot, choice: _Choice, lacks: dict[str, DovetailError], *, is_open: bool
) -> list[str]:
    """Say what was chosen, and why nothing wider.

    Args:
        robot: As it is.
        choice: Gripper, speed and range that it gets.
        lacks: Why other grippers were not taken.
        is_open: The gripper was to be chosen: no cell file or task gives the tool.
    """
    notes = []
    words = {HOLDER: "light holder"}
    why = "; ".join(f"with a {words.get(n, n)} {_lack(lacks[n])}" for n in lacks)
    tool = f"a {words.get(choice.gripper, choice.gripper)}"
    if is_open:
        usual = "its file says nothing of a gripper"
        why = f"at full speed {why}" if why else usual
        notes.append(f"{robot.name} gets {tool}: {why}")
    if choice.speed < 1.0:
        speeds = _listed(choice.speed * robot.limits.dq_max)
        notes.append(
            f"{robot.name}: {choice.speed:g} of its speed limits are used ({speeds} "
            "rad/s), as it could not brake from more"
        )
    if np.isfinite(choice.room):
        notes.append(
            f"{robot.name}: its joints stay within {choice.room:g} rad of the posture "
            "in which it works, as its torques do not bear the whole ranges"
        )
    return notes


def _lack(error: DovetailError) -> str:
    """Return in words why a tool was not taken."""
    if not isinstance(error, TorqueError):
        return str(error)
    needed = sum(error.shares.values())
    return f"joint {error.joint} needs {needed:.3g} Nm to brake, more than it has"


def _listed(values: Vec7) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
