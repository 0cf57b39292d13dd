"""Rotations and poses: the only file that converts between representations.

Quaternions are ``wxyz``, unit length, ``w >= 0`` on output. Rotation matrices map
child coordinates into the parent's.
"""

import math
from typing import NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.types import Mat33, Vec3, Vec4


class Pose(NamedTuple):
    """A frame in its parent, by default in the world."""

    position: Vec3
    """Origin of the frame in the parent [m], shape (3,)."""
    quat_wxyz: Vec4
    """Rotation of the frame in the parent, unit quaternion, shape (4,)."""


def quat_normalized(quat: Vec4) -> Vec4:
    """Scale a quaternion to unit length and turn its sign to ``w >= 0``.

    Raises:
        ConfigError: The quaternion has no length or is not finite.
    """
    quat = np.asarray(quat, dtype=float)
    length = float(np.sqrt(quat @ quat))
    if quat.shape != (4,) or not np.isfinite(length) or length < 1e-9:
        raise ConfigError(
            f"quaternion {quat.tolist()} is not a rotation: give four finite numbers "
            "w x y z whose length is not 0"
        )
    return quat / (length if quat[0] >= 0.0 else -length)


def quat_multiply(left: Vec4, right: Vec4) -> Vec4:
    """Compose two rotations: first ``right``, then ``left``, with ``w >= 0``."""
    w1, x1, y1, z1 = left
    w2, x2, y2, z2 = right
    quat = np.array(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ]
    )
    return quat if quat[0] >= 0.0 else -quat


def quat_conjugate(quat: Vec4) -> Vec4:
    """Invert a unit quaternion."""
    return np.asarray(quat, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0])


def quat_from_matrix(rotation: Mat33) -> Vec4:
    """Convert a rotation matrix to a quaternion, well conditioned everywhere.

    Reference:
        Shepperd 1978: divide by the largest of the four components.
    """
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(rotation, dtype=float).tolist()
    trace = a + e + i
    largest = max(trace, a, e, i)  # plain floats: this runs once per policy step
    if largest == trace:
        quat = [1.0 + trace, h - f, c - g, d - b]
    elif largest == a:
        quat = [h - f, 1.0 + a - e - i, d + b, g + c]
    elif largest == e:
        quat = [c - g, b + d, 1.0 + e - a - i, h + f]
    else:
        quat = [d - b, c + g, f + h, 1.0 + i - a - e]
    norm = math.hypot(*quat)
    return np.array(quat) / (norm if quat[0] >= 0.0 else -norm)


def matrix_from_quat(quat: Vec4) -> Mat33:
    """Convert a unit quaternion to a rotation matrix, shape (3, 3)."""
    w, x, y, z = quat
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_about_z(theta: float) -> Vec4:
    """Return the rotation by ``theta`` [rad] about the world z axis."""
    quat = np.array([np.cos(theta / 2), 0.0, 0.0, np.sin(theta / 2)])
    return quat if quat[0] >= 0.0 else -quat


def compose(outer: Pose, inner: Pose) -> Pose:
    """Return ``T_a_c`` of ``T_a_b`` and ``T_b_c``."""
    R = matrix_from_quat(outer.quat_wxyz)
    quat = quat_multiply(outer.quat_wxyz, inner.quat_wxyz)
    return Pose(outer.position + R @ inner.position, quat)


def inverse(pose: Pose) -> Pose:
    """Return ``T_b_a`` of ``T_a_b``."""
    back = quat_conjugate(pose.quat_wxyz)
    return Pose(-matrix_from_quat(back) @ pose.position, back)


UNMOVED = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
"""The pose of a frame that lies in its parent's own."""
TOOL_DOWN: Vec4 = np.array([0.0, 1.0, 0.0, 0.0])
"""Tool rotation (wxyz) with its z axis down and zero yaw: half a turn about x."""


def tool_down(yaw: float) -> Vec4:
    """Return the tool's rotation (wxyz) with z down, turned by `yaw` [rad]."""
    return quat_multiply(quat_about_z(yaw), TOOL_DOWN)


def theta_about_vertical(quat: Vec4, quat_goal: Vec4) -> float:
    """Return the turn about world z [rad] from the goal to `quat`, in (-pi, pi]."""
    w, x, y, z = quat.tolist()
    gw, gx, gy, gz = quat_goal.tolist()
    real = w * gw + x * gx + y * gy + z * gz
    vertical = -w * gz - x * gy + y * gx + z * gw
    theta = 2.0 * math.atan2(vertical, real)
    if theta > math.pi:
        return theta - 2.0 * math.pi
    return theta + 2.0 * math.pi if theta <= -math.pi else theta


def rotation_error(quat_d: Vec4, quat: Vec4) -> Vec3:
    r"""Return the world rotation vector that turns ``quat`` into ``quat_d``.

    .. math:: q_e = q_d \otimes q^{-1},\quad e = 2\,\mathrm{atan2}(|v|, w)\, v / |v|

    Args:
        quat_d: Desired rotation, wxyz.
        quat: Current rotation, wxyz.

    Returns:
        Rotation vector [rad], shape (3,), world axes, length at most pi.
    """
    quat_e = quat_multiply(quat_d, quat_conjugate(quat))
    length = float(np.sqrt(quat_e[1:] @ quat_e[1:]))
    if length < 1e-12:  # sin(angle / 2) = angle / 2 to the last digit
        return 2.0 * quat_e[1:]
    return (2.0 * np.arctan2(length, quat_e[0]) / length) * quat_e[1:]


def quat_from_vector(vector: Vec3) -> Vec4:
    """Convert a rotation vector [rad], shape (3,), to a quaternion."""
    angle = float(np.sqrt(vector @ vector))
    half_sinc = 0.5 * np.sinc(angle / (2.0 * np.pi))  # sin(angle / 2) / angle
    quat = np.concatenate([[np.cos(0.5 * angle)], half_sinc * vector])
    return quat if quat[0] >= 0.0 else -quat


def swing_twist(quat: Vec4) -> tuple[Vec3, Vec4]:
    """Split a rotation into a twist about world z and, after it, a level swing.

    Returns:
        Swing as a rotation vector with z component 0 [rad], and the twist quaternion;
        where the swing is half a turn the twist is undefined and none is taken.
    """
    identity = np.array([1.0, 0.0, 0.0, 0.0])
    length = float(np.hypot(quat[0], quat[3]))
    twist = np.array([quat[0], 0.0, 0.0, quat[3]]) / length
    if length < 1e-9:
        twist = identity
    swing = rotation_error(quat_multiply(quat, quat_conjugate(twist)), identity)
    return swing * np.array([1.0, 1.0, 0.0]), twist
