"""The joint acceleration that the motors can give anywhere, with this payload."""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from dovetail.errors import ConfigError
from dovetail.types import JOINTS, Vec7

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot

REFERENCE = np.array([15.0, 15.0, 15.0, 15.0, 20.0, 20.0, 20.0])
"""Acceleration that worked on an iiwa 14 with at most 1.2 kg [rad/s2]."""

_SAMPLES = 1000
_RESERVE = 0.9  # the sampled worst case is not the worst case
_SHARE_MIN = 0.2  # below this, braking distances grow past use


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
        ConfigError: The payload leaves too little torque; names the joint.
    """
    key = tuple(tuple(map(float, v)) for v in (tau_max, damping, armature))
    return np.array(_available(robot, *key))


@lru_cache(maxsize=64)
def _available(
    robot: "Robot",
    tau_max: tuple[float, ...],
    damping: tuple[float, ...],
    armature: tuple[float, ...],
) -> tuple[float, ...]:
    chain = robot.chain()
    rng = np.random.default_rng(0)
    shares = np.empty((_SAMPLES, 7))
    for row in shares:
        q = rng.uniform(robot.limits.q_min, robot.limits.q_max)
        dq = rng.uniform(-robot.limits.dq_max, robot.limits.dq_max)
        M = np.abs(chain.inertia_matrix(q)) + np.diag(armature)
        bias = np.abs(chain.coriolis(q, dq)) + np.asarray(damping) * np.abs(dq)
        row[:] = (tau_max - bias - np.abs(chain.gravity(q))) / (M @ REFERENCE)
    worst = shares.min(axis=0)
    joint = int(np.argmin(worst))
    share = min(1.0, _RESERVE * float(worst[joint]))
    if share < _SHARE_MIN:
        payload = 0.0 if robot.payload is None else robot.payload.mass
        raise ConfigError(
            f"joint {JOINTS[joint]} of {robot.name} has too little torque for its "
            f"{payload:g} kg payload: {tau_max[joint]:g} Nm leave "
            f"{share * REFERENCE[joint]:.2f} rad/s2, at least "
            f"{_SHARE_MIN * REFERENCE[joint]:g} rad/s2 are needed; use a lighter tool "
            "or one with its mass nearer to the flange"
        )
    return tuple(share * REFERENCE)
