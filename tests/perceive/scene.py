"""A camera beside the robot, and what it sees."""

import numpy as np

from dovetail.perceive.camera import Camera, Lens
from dovetail.poses import Pose, quat_about_z, quat_from_matrix

PLACE = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.2))


def looking(position, target):
    """Pose of a camera at a position that looks at a target, upright."""
    position = np.asarray(position, dtype=float)
    ahead = np.asarray(target) - position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(ahead, right)
    return Pose(position, quat_from_matrix(np.stack([right, down, ahead], axis=1)))


def beside(width=640, height=480, focal=600.0, at=(0.95, -0.25, 0.42), **more):
    """A camera beside the robot that looks at the fixture."""
    pose = looking(at, PLACE.position)
    return Camera(
        lens=more.pop("lens", None) or Lens.ideal(width, height, focal),
        mount=more.pop("mount", "world"),
        position=tuple(pose.position.tolist()),
        rotation=tuple(pose.quat_wxyz.tolist()),
        **more,
    )
