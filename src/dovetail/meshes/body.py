"""Mass, centre and inertia of the even body in a closed mesh."""

from dataclasses import dataclass

import numpy as np

from dovetail.meshes.hold import Body
from dovetail.types import Mat33, Vec3


@dataclass(frozen=True, kw_only=True, eq=False)
class Inertia:
    """Mass and inertia of a body."""

    mass: float
    """Mass [kg]."""
    centre: Vec3
    """Centre of mass [m]."""
    inertia: Mat33
    """Inertia about the centre of mass [kg m2]."""


def inertia_of(mesh: Body, density: float) -> Inertia:
    r"""Return mass and inertia of an even body.

    It is the sum over the tetrahedra between 0 0 0 and each triangle, which count
    negative where the triangle is seen from inside.

    .. math:: \int x x^T dV = \sum \frac{V}{20} (s s^T + a a^T + b b^T + c c^T)

    where s = a + b + c.

    Args:
        mesh: Closed, its triangles counter-clockwise from outside [m].
        density: Density [kg/m3].
    """
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    s = a + b + c
    volume = float(volumes.sum())
    centre = volumes @ s / 4.0 / volume
    second = sum(
        np.einsum("i,ij,ik->jk", volumes / 20.0, one, one) for one in (s, a, b, c)
    )
    spread = density * (second - volume * np.outer(centre, centre))
    inertia = np.trace(spread) * np.eye(3) - spread
    return Inertia(mass=density * volume, centre=centre, inertia=inertia)
