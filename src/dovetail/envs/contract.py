"""Checks of a task against its contract; an error names the method at fault.

A task that breaks its contract fails when it is registered or when its environment is
made, and not at the end of a training.
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.arms.arm import ArmState, ToolState
from dovetail.errors import ConfigError
from dovetail.poses import Pose
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.task import Goal, Progress, Task

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot

_PROGRESS = (
    "Progress(depth, success), the depth [m] and whether it is done, such as "
    "Progress(depth=0.012, success=False)"
)
_GOAL = "a Goal: position [m], quat_wxyz, normal (unit length) and surface [m]"
_POSES = (
    "where the fixture stands when a policy is tried, such as "
    'trial_poses = (FixturePose("near", x=0.55, y=0.0, z=0.1, theta=0.0),)'
)
_PAGE = "docs/your-own-task.md has the whole contract"


class TaskError(ConfigError):
    """A task breaks its contract."""

    def __init__(self, task: type[Task], member: str, found: str, needed: str) -> None:
        """Word the error.

        Args:
            task: The task's class.
            member: Its method or field that is wrong.
            found: What is wrong, after "is" or "returned".
            needed: What it must be.
        """
        self.task, self.member = task.__name__, member
        super().__init__(f"{task.__name__}.{member} {found}; needed: {needed}. {_PAGE}")


def require_class(task: type[Task]) -> type[Task]:
    """Return a task's class, or refuse one that lacks a part of the contract.

    Raises:
        TaskError: Names what is missing.
    """
    if not (isinstance(task, type) and issubclass(task, Task)):
        raise ConfigError(f"{task!r} is no task: it must inherit {Task.__qualname__}")
    for name in sorted(task.__abstractmethods__):
        about = (vars(Task).get(name).__doc__ or "").partition("\n")[0]
        raise TaskError(task, name, "is missing", f"a method. {about}".rstrip("."))
    try:
        poses = task.trial_poses
    except AttributeError:
        raise TaskError(task, "trial_poses", "is missing", _POSES) from None
    if not isinstance(poses, tuple) or not poses:
        raise TaskError(task, "trial_poses", f"is {poses!r}", f"a tuple: {_POSES}")
    for pose in poses:
        if not isinstance(pose, FixturePose):
            raise TaskError(task, "trial_poses", f"has {pose!r}", _POSES)
    return task


def build_task(kind: type[Task], settings: Mapping[str, Any]) -> Task:
    """Return the task with these fields, or refuse a class that takes none.

    Raises:
        ConfigError: A field has no value, or a value that the task refuses.
    """
    needed = (f for f in fields(kind) if f.init and f.name not in settings)
    bare = [f.name for f in needed if f.default is f.default_factory is MISSING]
    if bare:
        raise TaskError(
            kind,
            bare[0],
            "has no value",
            "a default in the class, which is a @dataclass(frozen=True, kw_only=True) "
            "itself, or a value where the environment is made",
        )
    return kind(**settings)


def require_task(task: Task, robot: "Robot") -> None:
    """Call each method of a task once, and refuse what it must not return.

    Args:
        task: The task.
        robot: The controller's model, for a state of the arm.

    Raises:
        TaskError: Names the method and what it returned.
    """
    rng = np.random.default_rng(0)
    fixture = read_pose(task, "draw_fixture", task.draw_fixture(rng))
    start = read_pose(task, "draw_start", task.draw_start(rng, fixture))
    goal = task.goal(fixture)
    sizes = ((3,), (4,), (3,), ())
    if not (isinstance(goal, tuple) and len(goal) == len(sizes)) or not all(
        _is_finite(value, size) for value, size in zip(goal, sizes, strict=True)
    ):
        raise TaskError(type(task), "goal", f"returned {goal!r}", _GOAL)
    goal = Goal(*goal)
    q = robot.posture(task.posture)
    tool = ToolState(start.position, start.quat_wxyz, np.zeros(6))
    log = np.zeros((0, 0))
    moving = (*task.held().moving, *task.fixture(0.0).moving)
    parts = np.array([piece.joint.start for piece in moving])
    still = np.zeros(3), np.zeros(6), 0
    state = ArmState(0.0, q, np.zeros(7), tool, *still, log, parts)
    error = start.position - goal.position
    read_progress(task, task.judge(error, goal, state))
    read_reward(task, task.weigh(task.counted(error, goal), 0.0, False, 0.0))


def read_pose(task: Task, method: str, told: Any) -> Pose:
    """Return the pose that a method drew.

    Raises:
        TaskError: It is not a pose, or a number in it is not finite.
    """
    is_pose = isinstance(told, tuple) and len(told) == 2
    if is_pose and _is_finite(told[0], (3,)) and _is_finite(told[1], (4,)):
        return Pose(*told)
    needed = "a Pose: position [m], shape (3,), and quat_wxyz, shape (4,)"
    raise TaskError(type(task), method, f"returned {told!r}", needed)


def read_progress(task: Task, told: Any) -> Progress:
    """Return what `judge` said.

    Raises:
        TaskError: It is no Progress, or its depth is no finite number.
    """
    if isinstance(told, tuple) and len(told) == 2:
        depth, success = told
        if isinstance(success, (bool, np.bool_)) and _is_number(depth):
            return Progress(depth, bool(success))
    raise TaskError(type(task), "judge", f"returned {told!r}", _PROGRESS)


def read_reward(task: Task, told: Any) -> float:
    """Return what `weigh` said.

    Raises:
        TaskError: It is no finite number.
    """
    if not _is_number(told):
        needed = "the reward of a step, a finite number"
        raise TaskError(type(task), "weigh", f"returned {told!r}", needed)
    return told


def _is_number(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except (TypeError, ValueError):
        return False


def _is_finite(value: Any, shape: tuple[int, ...]) -> bool:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return array.shape == shape and bool(np.isfinite(array).all())
