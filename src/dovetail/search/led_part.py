"""The part that a search leads: where it is in the fixture's frame, and its actions."""

import math

import numpy as np
from numpy.typing import NDArray

from dovetail.envs.commands import per_axis
from dovetail.envs.contact_env import ContactEnv
from dovetail.poses import (
    matrix_from_quat,
    quat_conjugate,
    quat_from_vector,
    quat_multiply,
    rotation_error,
)
from dovetail.types import Mat33, Vec3

RESPONSE = 0.1
"""Time in which a distance is made up through free air [s]."""


class LedPart:
    """The held part in the frame in which the fixture was seen last.

    `look` takes it from the arm's measured state; the rest is as of the last look.
    """

    end: Vec3
    """Middle of its end [m]."""
    corner: Vec3
    """The corner by which it is led [m]."""
    velocity: Vec3
    """Of its end [m/s]."""
    turned: Vec3
    """Rotation from where it stands when done [rad]."""
    yaw: float
    """Its turn about the fixture's normal [rad]."""

    def __init__(self, env: ContactEnv, speed: float) -> None:
        """Take the environment to act in.

        Args:
            env: Its arm is looked at, and its commands are given.
            speed: Most speed through free air [m/s].
        """
        self._env = env
        self._damping = np.array(per_axis("", env.config.force_damping))
        self._scale = np.array(env.commands.scale)
        most = float((self._scale[:3] / np.maximum(self._damping, 1e-9)).min())
        self._speed = min(speed, most)  # that an action can ask for
        self._rotation: Mat33 = np.eye(3)

    def look(self, on_part: Vec3) -> None:
        """Take from the arm's state where the part is.

        Args:
            on_part: Its corner that is led, see `LedCorner`.
        """
        state, seen = self._env.state, self._env.tracker.estimate().pose
        goal = self._env.task.goal(seen)
        self._rotation = matrix_from_quat(seen.quat_wxyz)
        R = self._rotation.T
        turn = quat_multiply(state.tool.quat_wxyz, quat_conjugate(goal.quat_wxyz))
        self.turned = R @ rotation_error(state.tool.quat_wxyz, goal.quat_wxyz)
        turned = R @ matrix_from_quat(turn) @ self._rotation
        self.end = R @ (state.tool.position - seen.position)
        self.corner = self.end + turned @ on_part
        self.velocity = R @ state.tool.velocity[:3]
        self.yaw = math.atan2(turned[1, 0], turned[0, 0])

    def towards(self, velocity: Vec3) -> Vec3:
        """Return the f* [m/s2] that moves it at a velocity [m/s] in free air."""
        R = self._rotation
        return R.T @ (self._damping * (R @ velocity))

    def through_air(self, way: Vec3) -> Vec3:
        """Return the f* [m/s2] that makes up a way [m] through free air."""
        velocity = way / RESPONSE
        most = float(np.abs(velocity).max())
        return self.towards(velocity * min(1.0, self._speed / max(most, 1e-9)))

    def action(
        self, force: Vec3, axis: Vec3, tilt: float, turn: Vec3
    ) -> NDArray[np.float32]:
        """Return the action that commands a force and an orientation.

        Args:
            force: f* [m/s2].
            axis: About which the part is tilted, unit length.
            tilt: From where it stands when done [rad].
            turn: A rotation after the tilt [rad].
        """
        tilted = matrix_from_quat(quat_from_vector(tilt * (self._rotation @ axis)))
        R = matrix_from_quat(quat_from_vector(self._rotation @ turn)) @ tilted
        # The turns about the world's z, y, x, one after the other, that make R.
        about_z = math.atan2(-R[0, 1], R[0, 0])
        about_y = math.asin(R[0, 2])
        about_x = math.atan2(-R[1, 2], R[2, 2])
        asked = np.array([*(self._rotation @ force), about_z, about_y, about_x])
        return np.clip(asked / self._scale, -1.0, 1.0).astype(np.float32)
