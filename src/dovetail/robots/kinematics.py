"""Inverse kinematics of the TCP: damped least squares inside the joint limits."""

from typing import TYPE_CHECKING

import numpy as np

from dovetail.errors import ConfigError, ReachError
from dovetail.poses import Pose, matrix_from_quat, quat_from_matrix, rotation_error
from dovetail.types import Mat33, Vec3, Vec6, Vec7

if TYPE_CHECKING:
    from dovetail import _core

_STEP_MAX = 0.5  # rad per iteration, keeps the linearisation honest
_LENGTH = 0.3  # m per rad: weighs rotation against translation while iterating


def solve_pose(
    limits: tuple[Vec7, Vec7],
    chain: "_core.Chain",
    pose: Pose,
    q_seed: Vec7,
    *,
    tolerance: float = 1e-6,
    margin: float = 0.02,
    iterations: int = 60,
    seeds: int = 12,
) -> Vec7:
    r"""Find joint angles that put the TCP at a pose.

    Levenberg's damping shrinks with the error, joints at a stop are clamped, and the
    self-motion is drawn towards the seed. If the first seed ends in a dead end,
    others (fixed, so the answer is reproducible) are tried.

    .. math:: \Delta q = J_f^T (J_f J_f^T + \mu I)^{-1} e

    Args:
        limits: Lower and upper joint limits [rad].
        chain: The robot's kinematics.
        pose: Desired TCP pose in the world.
        q_seed: Where to start from [rad], shape (7,); the answer is the one near it.
        tolerance: Largest error of the answer [m, rad].
        margin: Distance kept from the joint limits [rad].
        iterations: Iterations for each seed.
        seeds: Number of seeds, the given one included.

    Returns:
        Configuration [rad], shape (7,).

    Raises:
        ReachError: No configuration found; carries how far the closest one stays away.
        ConfigError: The pose or the seed is not finite.

    Reference:
        Levenberg 1944; Sugihara 2011 (damping from the error).
    """
    for name, values in (
        ("position", pose.position),
        ("quat_wxyz", pose.quat_wxyz),
        ("q_seed", q_seed),
    ):
        if not np.isfinite(values).all():
            raise ConfigError(f"{name} is {np.asarray(values).tolist()}: not finite")
    q_min, q_max = limits[0] + margin, limits[1] - margin
    seed = np.clip(np.asarray(q_seed, dtype=float), q_min, q_max)
    target = (np.asarray(pose.position, dtype=float), matrix_from_quat(pose.quat_wxyz))
    best, closest, first = np.inf, seed, seed
    rng = np.random.default_rng(0)
    for attempt in range(seeds):
        start = seed
        if attempt:
            spread = rng.uniform(-1.0, 1.0, 7) * (0.3 + 0.15 * attempt)
            start = np.clip(seed + spread, q_min, q_max)
        q, error = _descend(chain, target, start, (q_min, q_max), iterations, tolerance)
        if error < tolerance:
            return q
        if not attempt:
            first = q
        if error < best:
            best, closest = error, q
    held = np.flatnonzero((first <= q_min) | (first >= q_max))
    raise _unreachable(chain, pose, closest, tuple(int(i) for i in held))


def _descend(
    chain: "_core.Chain",
    target: tuple[Vec3, Mat33],
    q: Vec7,
    limits: tuple[Vec7, Vec7],
    iterations: int,
    tolerance: float,
) -> tuple[Vec7, float]:
    """Iterate from q; return the last configuration and its largest error."""
    position_d, rotation_d = target
    q_min, q_max = limits
    weight = np.array([1.0] * 3 + [_LENGTH] * 3)
    seed, best, stalled = q, np.inf, 0
    size = np.inf
    for _ in range(iterations):
        position, rotation = chain.pose(q)
        e = _pose_error(position_d - position, rotation_d @ rotation.T)
        size = float(np.abs(e).max())
        if size < tolerance:
            break
        stalled = 0 if size < 0.99 * best else stalled + 1
        best = min(best, size)
        if stalled > 12:
            break
        e = weight * e
        J = weight[:, None] * chain.jacobian(q)  # (6, 7)
        mu = 0.1 * float(e @ e) + 1e-9
        free = np.ones(7)
        pull = 0.2 * min(1.0, 10.0 * size) * (seed - q)
        step = np.zeros(7)
        for _ in range(2):  # once more without the joints that a stop holds
            J_f = J * free
            gain = np.linalg.solve(J_f @ J_f.T + mu * np.eye(6), e - J_f @ pull)
            step = free * pull + J_f.T @ gain
            held = ((q + step > q_max) & (q >= q_max)) | (
                (q + step < q_min) & (q <= q_min)
            )
            if not held.any():
                break
            free[held] = 0.0
        step *= min(1.0, _STEP_MAX / max(float(np.abs(step).max()), 1e-12))
        q = np.clip(q + step, q_min, q_max)
    return q, size


def _pose_error(translation: Vec3, R: Mat33) -> Vec6:
    """Stack a translation and the rotation vector of R."""
    axis = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.sqrt(axis @ axis))
    angle = float(np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)))
    if sine > 1e-9:
        axis = axis * (angle / sine)
    elif angle > 1.0:  # half a turn: the sine loses the axis
        axis = rotation_error(quat_from_matrix(R), np.array([1.0, 0.0, 0.0, 0.0]))
    return np.concatenate([translation, axis])


def _unreachable(
    chain: "_core.Chain", pose: Pose, q: Vec7, held: tuple[int, ...]
) -> ReachError:
    """Say how far the closest configuration stays away, and which joints hold it."""
    position, rotation = chain.pose(q)
    short = float(np.linalg.norm(pose.position - np.asarray(position)))
    error = rotation_error(pose.quat_wxyz, quat_from_matrix(rotation))
    turn = float(np.linalg.norm(error))
    x, y, z = (float(v) for v in pose.position)
    names = " and ".join(f"A{i + 1}" for i in held)
    limit = f", and on the way there {names} is at its limit" if held else ""
    return ReachError(
        f"no configuration inside the joint limits puts the tool at "
        f"({x:.3f}, {y:.3f}, {z:.3f}) m: the closest found stays {short * 1e3:.1f} mm "
        f"and {np.rad2deg(turn):.2f} deg away{limit}; choose a pose nearer to the "
        "robot",
        short,
        turn,
        held,
    )
