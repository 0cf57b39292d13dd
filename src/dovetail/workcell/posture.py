"""Search for a robot's working posture, for a robot that comes without one."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dovetail.errors import ReachError
from dovetail.poses import Pose
from dovetail.robots.robot import Robot
from dovetail.types import Array, Vec7

if TYPE_CHECKING:
    from dovetail import _core

_DRAWS = 40
"""Configurations from which the search starts."""
_TRIED = 6
"""Best configurations from which the other poses are tried."""
_STEP = np.pi / 4.0
"""Angle between two ways to mount a tool on a flange [rad]."""
_TURN = np.pi  # rad to either side that a draw covers


class _Found(NamedTuple):
    """A configuration with the tool at the first pose."""

    score: float
    q: Vec7


def find_posture(robot: Robot, poses: Sequence[Pose]) -> Vec7 | None:
    """Return the configuration from which a tool's poses are reached best.

    Of the configurations with the tool at the first pose it is the one from which most
    others are reached; of these the one with the highest score: away from joint limits
    and singularities, the elbow up and in the plane of the arm, little gravity.

    Args:
        robot: The arm with its tool.
        poses: Poses of the TCP in the world, first the one in the middle.

    Returns:
        Configuration [rad], shape (7,); None where the first pose is out of reach.
    """
    rng, chain = np.random.default_rng(0), robot.chain()
    low = np.maximum(robot.limits.q_min, -_TURN)
    high = np.minimum(robot.limits.q_max, _TURN)
    low, high = np.minimum(low, high), np.maximum(low, high)
    middle = np.clip(np.zeros(7), low, high)
    found: list[_Found] = []
    for seed in (middle, *rng.uniform(low, high, (_DRAWS, 7))):
        try:
            q = robot.inverse_kinematics(poses[0], seed, seeds=1)
        except ReachError:
            continue
        found.append(_Found(_score(robot, chain, q, poses[0]), q))
    found.sort(key=lambda one: -one.score)
    reached = [(_count(robot, one.q, poses[1:]), one) for one in found[:_TRIED]]
    if not reached:
        return None
    most = max(count for count, _ in reached)
    return next(one.q for count, one in reached if count == most)


def _count(robot: Robot, q: Vec7, poses: Sequence[Pose]) -> int:
    """Return how many poses are reached from a configuration."""
    count = 0
    for pose in poses:
        try:
            robot.inverse_kinematics(pose, q, seeds=1)
        except ReachError:
            continue
        count += 1
    return count


def _score(robot: Robot, chain: "_core.Chain", q: Vec7, pose: Pose) -> float:
    """Return how good a configuration is; each term is about 1 where it is good.

    The last joint's room is left out: it is the tool's mounting that decides it.
    """
    limits = robot.limits
    room = float(np.minimum(q - limits.q_min, limits.q_max - q)[:6].min())
    J = chain.jacobian(q)
    J[3:] *= 0.3  # m per rad
    agility = float(np.linalg.svd(J, compute_uv=False)[-1])
    gravity = float((np.abs(chain.gravity(q)) / limits.tau_max).max())
    shoulder, elbow, wrist = joint_origins(robot, q)[[1, 3, 5]]
    up = float(elbow[2] - (shoulder[2] + wrist[2]) / 2.0)
    normal = np.cross([0.0, 0.0, 1.0], pose.position - shoulder)
    aside = abs(float((elbow - shoulder) @ normal)) / max(np.linalg.norm(normal), 1e-9)
    return float(
        min(room / 0.6, 1.0)
        + min(agility / 0.06, 1.0)
        + min(up / 0.15, 1.0)
        - aside / 0.1
        - gravity
    )


def mount_turn(robot: Robot, q: Vec7) -> float:
    """Return the turn of a tool on the flange that puts the last joint near its middle.

    A multiple of 45 degrees about the flange's z, which has to be along the joint's
    axis: the joint then turns back by as much, and every pose of the tool stays.

    Args:
        robot: The arm.
        q: Configuration in which it works [rad].

    Returns:
        Turn about the flange's z [rad]; 0 where z is not along the axis.
    """
    along = float(robot.geometry.flange_rotation[2, 2])
    if abs(along) < 1.0 - 1e-6:
        return 0.0
    middle = float(robot.limits.q_min[6] + robot.limits.q_max[6]) / 2.0
    return float(np.round((q[6] - middle) / _STEP) * _STEP * np.sign(along))


def joint_origins(robot: Robot, q: Vec7) -> Array:
    """Return where the joints are in the world [m], shape (7, 3)."""
    position, rotation, origins = np.zeros(3), np.eye(3), []
    at = robot.geometry
    for p, R, angle in zip(at.origin_position, at.origin_rotation, q, strict=True):
        position, rotation = position + rotation @ p, rotation @ R
        origins.append(position)
        c, s = np.cos(angle), np.sin(angle)
        rotation = rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.array(origins)
