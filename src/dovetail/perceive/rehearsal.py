"""Pictures for a calibration, taken by the simulated arm inside its limits."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail.errors import ConfigError, ReachError
from dovetail.perceive.camera import Camera
from dovetail.perceive.simulated import Simulated
from dovetail.plants.twin_camera import TwinCamera
from dovetail.poses import (
    Pose,
    compose,
    inverse,
    matrix_from_quat,
    quat_from_matrix,
    quat_from_vector,
    quat_multiply,
)
from dovetail.types import Vec3, Vec7
from dovetail.workcell.workcell import Workcell

_AHEAD, _SPREAD = (0.30, 0.45), 0.03
"""Distance of a camera on the flange from the board, how far it looks aside [m]."""
_TILT, _ROLL = 0.6, 0.7
"""Largest tilt of camera or board, and turn about its axis [rad]."""
_CLEAR = 0.08
"""Least height of the tool over the fixture [m]."""
_IN_FLANGE = Pose(
    np.array([0.0, 0.06, 0.17]),
    quat_from_matrix(np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])),
)
"""A board that the tool holds: its face looks along the flange's y."""
_TRIES = 400


class Shot(NamedTuple):
    """A picture, and where the arm was."""

    picture: NDArray[np.uint8]
    """Grey values."""
    q: Vec7
    """Configuration [rad], as measured."""


def shoot(
    camera: Camera, cell: Workcell, twin: TwinCamera | None, count: int, seed: int
) -> Iterator[Shot]:
    """Move the simulated arm from pose to pose and take a picture in each.

    Args:
        camera: What is believed of it; a first guess of its place is enough.
        cell: What stands there.
        twin: In what the camera differs from that.
        count: Number of pictures.
        seed: Of the poses and of the noise.

    Raises:
        ConfigError: The arm reaches too few poses in which the camera sees the board.
        MissingDependencyError: There is no OpenGL that draws without a screen.
    """
    rng = np.random.default_rng(seed)
    source = Simulated(camera, cell, twin)
    try:
        for number in range(count):
            q = reachable(camera, cell, rng)
            board = board_of(camera, cell, q)
            yield Shot(source.still(q, cell.place, board, seed + number), q)
    finally:
        source.close()


def viewpoint(camera: Camera, cell: Workcell, margin: float) -> Vec7:
    """Return a configuration [rad] in which the camera sees the board.

    Args:
        camera: What is believed of it.
        cell: Its robot, tool and walls.
        margin: How far inside of every wall the tool is [m]: else a wall pushes it.

    Raises:
        ConfigError: The arm reaches none.
    """
    return reachable(camera, cell, np.random.default_rng(0), margin)


def board_of(camera: Camera, cell: Workcell, q: Vec7) -> Pose:
    """Return where the board is: on the fixture, or in the tool, the arm at q [rad]."""
    if camera.mount == "flange":
        return cell.place
    return compose(cell.robot.tool_pose(q), _IN_FLANGE)


def reachable(
    camera: Camera,
    cell: Workcell,
    rng: np.random.Generator,
    margin: float | None = None,
) -> Vec7:
    """Draw a configuration [rad] in which the camera looks at the board.

    Args:
        camera: What is believed of it.
        cell: Its robot, tool and walls.
        rng: Of the draw.
        margin: How far inside of every wall the tool stays [m], for an arm that moves.
            None is one that is put there: it may be above the highest wall.

    Raises:
        ConfigError: The arm reaches none.
    """
    robot = cell.loaded_robot()
    tool = compose(
        inverse(cell.robot.tool_pose(np.zeros(7))), robot.tool_pose(np.zeros(7))
    )
    low, high = (np.array(wall) for wall in cell.walls)
    if margin is None:
        high[2] = np.inf
    low, high = low + (margin or 0.0), high - (margin or 0.0)
    for _ in range(_TRIES):
        draw = _above if camera.mount == "flange" else _before
        tip = compose(draw(camera, cell.place, rng), tool)
        is_inside = (low <= tip.position).all() and (tip.position <= high).all()
        if not is_inside or tip.position[2] < cell.place.position[2] + _CLEAR:
            continue
        try:
            return robot.inverse_kinematics(tip, robot.posture("down"), seeds=2)
        except ReachError:
            continue
    raise ConfigError(
        f"none of {_TRIES} drawn poses of the arm lets the camera see the board inside "
        "the walls and the joints' limits: is the camera's place in its file right?"
    )


def _above(camera: Camera, fixture: Pose, rng: np.random.Generator) -> Pose:
    """Draw a pose of the flange from which the camera on it looks at the fixture."""
    tilt = _tilted(np.array([0.0, 0.0, -1.0]), rng)
    target = fixture.position + np.array([*rng.uniform(-_SPREAD, _SPREAD, 2), 0.0])
    position = target - rng.uniform(*_AHEAD) * tilt
    usual = camera.pose.quat_wxyz
    down = np.array([0.0, 1.0, 0.0, 0.0])  # of the flange, over the table
    R = matrix_from_quat(quat_multiply(down, usual))
    look = Pose(position, _aligned(R, tilt, rng))
    return compose(look, inverse(camera.pose))


def _before(camera: Camera, fixture: Pose, rng: np.random.Generator) -> Pose:
    """Draw a pose of the flange in which the board on it looks at the camera."""
    middle = fixture.position + np.array([0.0, 0.0, 0.12])
    position = middle + rng.uniform(-0.06, 0.06, 3)
    face = _tilted(_unit(camera.pose.position - position), rng)
    # The flange is as far down as the face allows; its y is the face's normal.
    z = _unit(np.array([0.0, 0.0, -1.0]) + face * face[2])
    R = np.stack([np.cross(face, z), face, z], axis=1)
    board = compose(Pose(position, _aligned(R, face, rng)), _turn_of(_IN_FLANGE))
    return compose(board, inverse(_IN_FLANGE))


def _turn_of(pose: Pose) -> Pose:
    return pose._replace(position=np.zeros(3))


def _tilted(axis: Vec3, rng: np.random.Generator) -> Vec3:
    """Return a direction within `_TILT` of an axis, uniform over angles."""
    angle, turn = rng.uniform(0.0, _TILT), rng.uniform(-np.pi, np.pi)
    side = _unit(np.cross(axis, [0.3, 0.9, 0.1]))
    other = np.cross(axis, side)
    aside = np.cos(turn) * side + np.sin(turn) * other
    return np.cos(angle) * axis + np.sin(angle) * aside


def _aligned(R: NDArray[np.float64], axis: Vec3, rng: np.random.Generator) -> Vec3:
    """Return the rotation R (wxyz), turned the short way and rolled about an axis.

    The axis that R already has is its column nearest to it.
    """
    column = int(np.argmax(R.T @ axis))
    from_axis = R[:, column]
    cross, cosine = np.cross(from_axis, axis), float(from_axis @ axis)
    angle = np.arctan2(np.linalg.norm(cross), cosine)
    short = quat_from_vector(angle * _unit(cross)) if angle > 1e-9 else np.eye(4)[0]
    roll = quat_from_vector(rng.uniform(-_ROLL, _ROLL) * axis)
    return quat_multiply(roll, quat_multiply(short, quat_from_matrix(R)))


def _unit(vector: Vec3) -> Vec3:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)
