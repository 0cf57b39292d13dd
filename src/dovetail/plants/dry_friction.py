"""Dry friction of joints in engines that know none."""

import numpy as np

from dovetail.types import Array


def dry_friction(Minv: Array, dq: Array, coulomb: Array, h: float) -> Array:
    """Return the torque of dry friction in a step [Nm, of a slide N].

    Each joint's friction stops the joint at the step's end, or is at its limit: a
    projected Gauss-Seidel iteration on the joints' speeds.

    Args:
        Minv: Inverse of the joint inertia, shape (n, n).
        dq: Speeds at the step's end without friction [rad/s].
        coulomb: Largest friction [Nm].
        h: Length of the step [s].
    """
    friction = np.zeros(len(dq))
    for _ in range(50):
        before = friction.copy()
        for i in range(len(dq)):
            speed = dq[i] + h * (Minv[i] @ friction)
            wanted = friction[i] - speed / (h * Minv[i, i])
            friction[i] = min(max(wanted, -coulomb[i]), coulomb[i])
        if np.abs(friction - before).max() < 1e-6:
            break
    return friction
