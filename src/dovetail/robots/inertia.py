"""Mass and inertia of rigid bodies."""

import numpy as np

from dovetail.errors import ConfigError
from dovetail.types import Mat33, Vec3


def require_inertia(inertia: Mat33, name: str) -> None:
    """Refuse a matrix that no body can have (negative, triangle inequality)."""
    if not np.allclose(inertia, inertia.T, atol=1e-9):
        raise ConfigError(f"inertia of {name} is not symmetric: {inertia.tolist()}")
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] < 0.0 or moments[2] > (moments[0] + moments[1]) * (1 + 1e-6) + 1e-12:
        raise ConfigError(
            f"inertia of {name} has principal moments {moments.tolist()} kg m2: each "
            "must be >= 0 and no larger than the sum of the other two"
        )


def merge_bodies(*bodies: tuple[float, Vec3, Mat33]) -> tuple[float, Vec3, Mat33]:
    """Merge rigid bodies (mass, com, inertia about the com) given in one frame."""
    mass = sum(body[0] for body in bodies)
    if mass <= 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    com = np.sum([m * np.asarray(c) for m, c, _ in bodies], axis=0) / mass
    inertia = np.zeros((3, 3))
    for m, c, body_inertia in bodies:
        d = np.asarray(c) - com
        inertia += body_inertia + m * ((d @ d) * np.eye(3) - np.outer(d, d))
    return mass, com, inertia
