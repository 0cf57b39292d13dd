"""Dry friction of joints in engines that know none."""

import numpy as np

from dovetail.types import Array, Vec7


def dry_friction(Minv: Array, dq: Vec7, coulomb: Vec7, h: float) -> Vec7:
    """Return the torque of dry friction in a step [Nm].

    Each joint's friction stops the joint at the step's end, or is at its limit: a
    projected Gauss-Seidel iteration on the joints' speeds.

    Args:
        Minv: Inverse of the joint inertia, shape (7, 7).
        dq: Speeds at the step's end without friction [rad/s].
        coulomb: Largest friction [Nm].
        h: Length of the step [s].
    """
    friction = np.zeros(7)
    for _ in range(50):
        before = friction.copy()
        for i in range(7):
            speed = dq[i] + h * (Minv[i] @ friction)
            wanted = friction[i] - speed / (h * Minv[i, i])
            friction[i] = min(max(wanted, -coulomb[i]), coulomb[i])
        if np.abs(friction - before).max() < 1e-6:
            break
    return friction
