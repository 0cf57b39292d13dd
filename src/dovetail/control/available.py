"""Joint acceleration that the motors can give at any pose and speed, with payload."""

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dovetail.errors import TorqueError
from dovetail.types import JOINTS, Array, Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.robots.robot import Robot

REFERENCE = np.array([15.0, 15.0, 15.0, 15.0, 20.0, 20.0, 20.0])
"""Acceleration that worked on an iiwa 14 with at most 1.2 kg [rad/s2]."""

_SAMPLES = 1000
_RESERVE = 0.9  # the sampled worst case is not the worst case
_WORK = 0.4  # rad about the posture in which the tool works
_SHARE_MIN = 0.2  # below this, braking distances grow past use
_SWEEPS = 3  # over the joints, in search of the configuration where gravity is largest

Numbers = tuple[float, ...]


class _Samples(NamedTuple):
    """Configurations and speeds inside of limits, and the torques there."""

    q: Array
    dq: Array
    inertia: Array
    """Inertia matrix by its elements' size, without rotors, shape (n, 7, 7)."""
    coriolis: Array
    gravity: Array


def available_acceleration(
    robot: "Robot", tau_max: Vec7, damping: Vec7, armature: Vec7
) -> Vec7:
    r"""Scale the reference acceleration until the motors can always give it.

    .. math:: |M(q)| A + |h(q, \dot q)| + |g(q)| \le \tau_{max}

    over configurations and speeds inside the limits (sampled, seeded), payload,
    damping and rotor inertia included.

    Args:
        robot: The arm with its payload.
        tau_max: Motor torque limits [Nm], shape (7,).
        damping: Joint damping [Nms/rad], shape (7,).
        armature: Rotor inertia [kg m2], shape (7,).

    Returns:
        Acceleration A [rad/s2], shape (7,), at most `REFERENCE`.

    Raises:
        TorqueError: Too little torque is left; names the joint, what takes most of it,
            and what to change.
    """
    limits = robot.limits
    at = samples(robot, *map(as_key, (limits.q_min, limits.q_max, limits.dq_max)))
    bias = np.abs(at.coriolis) + np.asarray(damping) * np.abs(at.dq)
    moved = (at.inertia + np.diag(armature)) @ REFERENCE
    shares = (np.asarray(tau_max) - bias - np.abs(at.gravity)) / moved
    row, joint = (int(i) for i in np.unravel_index(np.argmin(shares), shares.shape))
    share = min(1.0, _RESERVE * float(shares[row, joint]))
    if share < _SHARE_MIN:
        torque, viscous = float(tau_max[joint]), float(damping[joint])
        needed = _SHARE_MIN / _RESERVE * float(moved[row, joint])
        raise _too_little(robot, at, row, joint, torque, viscous, needed)
    return share * REFERENCE


def available_jerk(
    robot: "Robot", armature: Vec7, ddq_max: Vec7, dtau_max: Vec7
) -> Vec7:
    r"""Return the change of acceleration for which torques are always quick enough.

    .. math:: |M(q)| J \le \dot\tau_{max}

    over configurations inside the limits (sampled, seeded). Of all such J it is the one
    that gives each joint the same time from rest to `ddq_max`, a quicker one where a
    joint's own torques leave more.

    Args:
        robot: The arm with its payload.
        armature: Rotor inertia [kg m2], shape (7,).
        ddq_max: Acceleration of each joint [rad/s2], shape (7,).
        dtau_max: Change of each torque [Nm/s], shape (7,), finite.

    Returns:
        Jerk J [rad/s3], shape (7,).
    """
    limits = robot.limits
    span = map(as_key, (limits.q_min, limits.q_max, limits.dq_max))
    inertia = samples(robot, *span).inertia + np.diag(armature)
    jerk = ddq_max * dtau_max / (inertia @ ddq_max).max(axis=0)
    used = ((inertia @ jerk) / dtau_max).max()
    return np.asarray(_RESERVE / float(used) * jerk)


@lru_cache(maxsize=16)
def available_at_tool(
    robot: "Robot", armature: Numbers, ddq_max: Numbers, dtau_max: Numbers
) -> tuple[float, float]:
    """Return what joints and torques leave the TCP along an axis [m/s2, m/s3].

    The acceleration for which no joint passes `ddq_max`, and the change of it for which
    no torque changes faster than `dtau_max`, while every other axis of the tool keeps
    what it does. It is what nine of ten configurations near the posture "down" leave:
    near a singularity there is none.

    Args:
        robot: The arm with its payload.
        armature: Rotor inertia of each joint [kg m2].
        ddq_max: Acceleration of each joint [rad/s2].
        dtau_max: Change of each torque [Nm/s]; infinity is any.
    """
    chain, rng, at = robot.chain(), np.random.default_rng(0), robot.posture("down")
    low = np.maximum(at - _WORK, robot.limits.q_min)
    high = np.minimum(at + _WORK, robot.limits.q_max)
    accelerations, jerks = [], []
    for q in rng.uniform(low, high, (_SAMPLES, 7)):
        J = chain.jacobian(q)
        moved = np.linalg.solve(chain.inertia_matrix(q) + np.diag(armature), J.T)
        forces = np.linalg.pinv(J @ moved)[:, :3]
        joints = (np.abs(moved @ forces).T / ddq_max).T
        torques = (np.abs(J.T @ forces).T / dtau_max).T
        accelerations.append(1.0 / joints.max(axis=0))
        jerks.append(1.0 / torques.max(axis=0) if torques.any() else np.full(3, np.inf))
    most = float(np.quantile(accelerations, 1.0 - _RESERVE))
    if not np.isfinite(jerks).all():
        return most, np.inf
    return most, float(np.quantile(jerks, 1.0 - _RESERVE))


@lru_cache(maxsize=64)
def largest_gravity(
    robot: "Robot", q_min: Numbers, q_max: Numbers, dq_max: Numbers
) -> Vec7:
    """Return the largest torque of gravity on each joint inside limits [Nm].

    On one joint after the other, as along each the torque is a sine: from the worst of
    the samples, which misses it by a few percent.

    Args:
        robot: The arm with its payload.
        q_min: Lower joint limits [rad].
        q_max: Upper joint limits [rad].
        dq_max: Joint speed limits [rad/s], of the samples.
    """
    chain, at = robot.chain(), samples(robot, q_min, q_max, dq_max)
    worst = np.empty(7)
    for i in range(7):
        q = at.q[int(np.argmax(np.abs(at.gravity[:, i])))].copy()
        for _ in range(_SWEEPS):
            for j in range(7):
                q[j] = _worst_angle(chain, q, i, j, (q_min[j], q_max[j]))
        worst[i] = abs(chain.gravity(q)[i])
    return worst


def _worst_angle(
    chain: "_core.Chain", q: Vec7, i: int, j: int, span: tuple[float, float]
) -> float:
    """Return the angle of joint j at which gravity on joint i is largest [rad]."""

    def torque(angle: float) -> float:
        return float(chain.gravity(np.array([*q[:j], angle, *q[j + 1 :]]))[i])

    thirds = 2.0 * np.pi / 3.0 * np.arange(3)
    values = np.array([torque(angle) for angle in thirds])
    peak = float(np.arctan2(values @ np.sin(thirds), values @ np.cos(thirds)))
    turns = peak + np.pi * np.arange(-8, 9)
    inside = [*turns[(span[0] <= turns) & (turns <= span[1])], *span, float(q[j])]
    return max(inside, key=lambda angle: abs(torque(angle)))


@lru_cache(maxsize=16)
def samples(
    robot: "Robot", q_min: Numbers, q_max: Numbers, dq_max: Numbers
) -> _Samples:
    """Return configurations and speeds inside of limits, and the torques there."""
    chain, rng = robot.chain(), np.random.default_rng(0)
    rows = []
    for _ in range(_SAMPLES):
        q = rng.uniform(q_min, q_max)
        dq = rng.uniform([-speed for speed in dq_max], dq_max)
        M = np.abs(chain.inertia_matrix(q))
        rows.append((q, dq, M, chain.coriolis(q, dq), chain.gravity(q)))
    return _Samples(*(np.array(column) for column in zip(*rows, strict=True)))


def as_key(values: Vec7) -> Numbers:
    """Return values as a tuple, which a cache takes as a key."""
    return tuple(map(float, values))


def _too_little(
    robot: "Robot",
    at: _Samples,
    row: int,
    joint: int,
    tau_max: float,
    damping: float,
    braking: float,
) -> TorqueError:
    """Say what takes a joint's torque, the largest share first, and what to change."""
    total = abs(float(at.gravity[row, joint]))
    own = total
    if robot.payload is not None:
        with_it = float(at.gravity[row, joint])
        own = abs(with_it - float(_payload_alone(robot).gravity(at.q[row])[joint]))
    shares = {
        "speed": abs(float(at.coriolis[row, joint])),
        "damping": damping * abs(float(at.dq[row, joint])),
        "payload": max(total - own, 0.0),
        "gravity": min(own, total),
        "inertia": braking,
    }
    cause = max(shares, key=lambda name: shares[name])
    name, dq_max = JOINTS[joint], robot.limits.dq_max
    fastest = int(np.argmax(dq_max))
    speeds = f"up to {dq_max[fastest]:.3g} rad/s ({JOINTS[fastest]})"
    slower = "lower the speed limits: dq_max=[...] of from_urdf and from_mjcf"
    payload = 0.0 if robot.payload is None else robot.payload.mass
    takes = {
        "speed": f"{{:.3g}} Nm for the motion at {speeds}",
        "damping": f"{{:.3g}} Nm for damping, {damping:.3g} Nms/rad",
        "payload": f"{{:.3g}} Nm for the weight of its {payload:g} kg payload",
        "gravity": "{:.3g} Nm for the weight of the links",
        "inertia": "{:.3g} Nm for braking by "
        f"{_SHARE_MIN * REFERENCE[joint]:g} rad/s2, the least that is of use",
    }
    remedies = {
        "speed": f"{slower}; a file's are often placeholders",
        "damping": f"correct the damping (motors=Motors(...)), or {slower}",
        "payload": "use a lighter tool or one with its mass nearer to the flange",
        "gravity": "correct tau_max, or the masses of the file",
        "inertia": "correct tau_max, or inertia and armature of the arm",
    }
    order = sorted(shares, key=lambda share: -shares[share])
    said = ", ".join(takes[n].format(shares[n]) for n in order if shares[n] >= 5e-3)
    return TorqueError(
        f"joint {name} of {robot.name} has {tau_max:g} Nm and would need {said}; "
        f"{remedies[cause]}",
        name,
        cause,
        shares,
    )


def _payload_alone(robot: "Robot") -> "_core.Chain":
    """Return the chain of an arm that weighs nothing, with the payload."""
    assert robot.payload is not None
    at, tiny = robot.geometry, 1e-9
    com = np.zeros((7, 3))
    com[6] = at.flange_position + at.flange_rotation @ robot.payload.com
    mass = np.array([tiny] * 6 + [max(robot.payload.mass, tiny)])
    inertia = np.tile(tiny * np.eye(3), (7, 1, 1))
    links = replace(robot.links, mass=mass, com=com, inertia=inertia)
    return replace(robot, links=links).chain()


def carrying(robot: "Robot") -> str:
    """Name a robot's payload for a message; empty where it has none."""
    return (
        "" if robot.payload is None else f" with its {robot.payload.mass:g} kg payload"
    )
