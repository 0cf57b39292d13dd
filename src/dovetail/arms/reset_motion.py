"""The way back to a start: up out of the fixture, across, and down.

For arms that cannot be placed. The path is joint targets at a fixed rate, followed
below every limit like any other target.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from dovetail.errors import ArmError, ReachError
from dovetail.poses import (
    Pose,
    matrix_from_quat,
    quat_from_vector,
    quat_multiply,
    rotation_error,
)
from dovetail.types import Vec3, Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.robots.robot import Robot


class Observed(Protocol):
    """State of an arm, as far as a way back needs it."""

    @property
    def q(self) -> Vec7:
        """Measured configuration [rad]."""
        ...

    @property
    def dq(self) -> Vec7:
        """Measured joint velocity [rad/s]."""
        ...


TICK = 0.05
"""Time between two targets [s]."""
LIFT = 0.06
"""Height of the tool over the fixture while it goes across [m]."""
NEAR = 0.20
"""Distance beside a fixture that does not open upwards, within which it is left along
its axis [m]: more than its block and a start's range."""
SPEED_NEAR = 0.05
"""Speed of the tool on the way up and down [m/s]."""
TURN_SPEED = 0.3
"""Speed of the tool's rotation on the way [rad/s]."""
JOINT_SPEED = 0.4
"""Speed of the fastest joint on the way across [rad/s]."""
SPEED_ACROSS = 0.1
"""Mean speed of the tool there [m/s]: half as much again in the middle, well below the
0.25 m/s of T1, which are those of the velocity's norm."""
ARRIVED = 0.02
"""Distance of every joint from the start that ends a reset [rad]."""
ARRIVAL_TIME = 5.0
"""Time to come to rest at the start, after the way there, before a reset fails [s]."""
_LEVEL = 1e-6
_SAMPLES = 33


def drive_along(
    way: Sequence[Vec7],
    observe: Callable[[], Observed],
    follow: Callable[["_core.Target"], None],
) -> None:
    """Drive along a way, below the limits, and wait for the rest at its end.

    Args:
        way: Of `plan_reset` [rad].
        observe: Returns where the arm is.
        follow: Follows a target for `TICK`.

    Raises:
        ArmError: The arm does not arrive.
    """
    from dovetail import _core

    for q_d in way:
        follow(_core.Target(joint_mode=True, q_d=q_d))
    at_goal = _core.Target(joint_mode=True, q_d=way[-1])
    error = np.zeros(7)
    for _ in range(round(ARRIVAL_TIME / TICK)):
        state = observe()
        error = np.abs(state.q - way[-1])
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


def plan_reset(
    robot: "Robot", q: Vec7, q_start: Vec7, fixture: Pose, z_max: float = np.inf
) -> list[Vec7]:
    """Return joint targets, one for every `TICK`, from q to q_start.

    The tool goes straight up to above the fixture and the start, keeping its
    rotation; across it moves in joint space; down it goes straight to the start. Out of
    a fixture that does not open upwards it goes along its axis first, and to a start
    beside it along that at last: straight up it would be wedged.

    Args:
        robot: The arm, tool included.
        q: Where it is now [rad].
        q_start: Where it has to be in the end [rad].
        fixture: The fixture; it is passed at a distance of `LIFT`.
        z_max: No higher than this, where the walls are [m].

    Raises:
        ArmError: The way leads out of the arm's reach.
    """
    here, start = robot.tool_pose(q), robot.tool_pose(q_start)
    out_here, out_start = _in_front(here, fixture), _in_front(start, fixture)
    safe = float(fixture.position[2]) + LIFT
    height = max(safe, float(out_here.position[2]), float(out_start.position[2]))
    height = min(height, z_max)
    up = _way_up(robot, q, here, out_here, height)
    down = _way_up(robot, q_start, start, out_start, height)[::-1]
    q_up = up[-1] if up else q
    q_down = down[0] if down else q_start
    across = _across(robot, q_up, q_down)
    return [*up, *across, *down[1:], np.asarray(q_start, dtype=float)]


def _in_front(tool: Pose, fixture: Pose) -> Pose:
    """Return the tool's pose in front of a fixture that does not open upwards.

    Where it is as far from the fixture's plane as `LIFT`, or farther beside it than
    `NEAR`, it stays where it is.
    """
    out = matrix_from_quat(fixture.quat_wxyz)[:, 2]
    if out[2] > 1.0 - _LEVEL:
        return tool
    way = tool.position - fixture.position
    height = float(way @ out)
    if height >= LIFT or float(np.linalg.norm(way - height * out)) > NEAR:
        return tool
    return tool._replace(position=tool.position + (LIFT - height) * out)


def _way_up(
    robot: "Robot", q: Vec7, begin: Pose, front: Pose, height: float
) -> list[Vec7]:
    """Return configurations to in front of the fixture, and up from there."""
    way = list(_line(robot, q, begin, front))
    above = front._replace(position=_with_height(front.position, height))
    return [*way, *_line(robot, way[-1] if way else q, front, above)]


def _with_height(position: Vec3, height: float) -> Vec3:
    return np.array([position[0], position[1], max(height, position[2])])


def _line(robot: "Robot", q: Vec7, begin: Pose, end: Pose) -> Iterator[Vec7]:
    """Yield configurations along a straight line, from begin's q on."""
    length = float(np.linalg.norm(end.position - begin.position))
    turn = rotation_error(end.quat_wxyz, begin.quat_wxyz)
    duration = max(length / SPEED_NEAR, float(np.linalg.norm(turn)) / TURN_SPEED)
    if duration < _LEVEL:
        return
    for share in _shares(duration):
        pose = Pose(
            begin.position + share * (end.position - begin.position),
            quat_multiply(quat_from_vector(share * turn), begin.quat_wxyz),
        )
        try:
            q = robot.inverse_kinematics(pose, q)
        except ReachError as error:
            raise ArmError(
                f"the way back to the start leaves the arm's reach at "
                f"{np.round(pose.position, 3).tolist()} m: {error}; move the arm by "
                "hand, or choose a start or a fixture nearer to the middle",
                "reset",
            ) from error
        yield q


def _across(robot: "Robot", begin: Vec7, end: Vec7) -> Iterator[Vec7]:
    way = [begin + share * (end - begin) for share in np.linspace(0.0, 1.0, _SAMPLES)]
    points = np.array([robot.tool_pose(q).position for q in way])
    # joints at an even pace do not move the tool at one: its quickest part counts
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    length = float(steps.max()) * (_SAMPLES - 1)
    turn = float(np.abs(end - begin).max())
    duration = max(turn / JOINT_SPEED, length / SPEED_ACROSS)
    for share in _shares(duration):
        yield begin + share * (end - begin)


def _shares(duration: float) -> Iterator[float]:
    """Yield 0 to 1 with no speed at either end, the mean speed as asked for."""
    count = max(1, round(1.5 * duration / TICK))
    for i in range(1, count + 1):
        s = i / count
        yield s * s * (3.0 - 2.0 * s)
