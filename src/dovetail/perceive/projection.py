"""From a pose to pixels and back: a lens with its slopes."""

from typing import Any

import numpy as np

from dovetail.perceive.camera import Lens
from dovetail.perceive.opencv import opencv
from dovetail.poses import (
    Pose,
    matrix_from_quat,
    quat_from_matrix,
    quat_from_vector,
    quat_multiply,
)
from dovetail.types import Array


class Projection:
    """Projection through a lens of points whose frame has a pose in the camera's."""

    def __init__(self, lens: Lens) -> None:
        """Take the lens."""
        self._cv: Any = opencv()
        self.matrix, self.coefficients = lens.matrix(), lens.coefficients()

    def place(self, pose: Pose, points: Array) -> Array:
        """Return where points are in the picture [pixels], shape (..., 2).

        Args:
            pose: Of the points' frame in the camera's.
            points: In their frame [m], shape (..., 3).
        """
        return self._project(pose, points)[0].reshape(*points.shape[:-1], 2)

    def place_and_slopes(self, pose: Pose, points: Array) -> tuple[Array, Array]:
        """Return pixels, and how they move with the pose [pixels/m, pixels/rad].

        The slopes, shape (..., 2, 6), are by position first, then by a rotation vector
        that turns the points about their frame's origin, along the camera's axes.
        """
        place, whole = self._project(pose, points)
        by_position = whole[:, 3:6].reshape(*points.shape[:-1], 2, 3)
        arm = points @ matrix_from_quat(pose.quat_wxyz).T
        slopes = np.empty((*by_position.shape[:-1], 6))
        slopes[..., :3] = by_position
        # s . (d(turn) x arm) = (arm x s) . d(turn); np.cross takes twice as long
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            one, other = arm[..., None, j], arm[..., None, k]
            slopes[..., 3 + i] = one * by_position[..., k] - other * by_position[..., j]
        return place.reshape(*points.shape[:-1], 2), slopes

    def _project(self, pose: Pose, points: Array) -> tuple[Array, Array]:
        turn, _ = self._cv.Rodrigues(matrix_from_quat(pose.quat_wxyz))
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        return self._cv.projectPoints(
            flat, turn, pose.position, self.matrix, self.coefficients
        )

    def moved(self, pose: Pose, step: Array) -> Pose:
        """Return a pose after a small shift [m] and turn [rad], camera's axes."""
        quat = quat_multiply(quat_from_vector(step[3:]), pose.quat_wxyz)
        return Pose(pose.position + step[:3], quat)

    def flat_poses(self, points: Array, seen: Array, height: float) -> list[Pose]:
        """Return the two poses of points in a plane, the one that fits better first.

        Args:
            points: In their frame [m], shape (..., 3), all at the same z.
            seen: Where they are in the picture [pixels], shape (..., 2).
            height: That z [m].
        """
        flat = points.reshape(-1, 3) - [0.0, 0.0, height]
        _, turns, shifts, _ = self._cv.solvePnPGeneric(
            flat, seen.reshape(-1, 2), self.matrix, self.coefficients,
            flags=self._cv.SOLVEPNP_IPPE,
        )  # fmt: skip
        poses = []
        for turn, shift in zip(turns, shifts, strict=True):
            R, _ = self._cv.Rodrigues(turn)
            poses.append(Pose(shift.ravel() - R[:, 2] * height, quat_from_matrix(R)))
        return poses
