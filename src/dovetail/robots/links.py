"""Masses and inertias of an arm's links, and whose numbers they are."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.robots.arrays import ArrayFacts
from dovetail.robots.inertia import require_inertia
from dovetail.types import JOINTS, Array, Vec7

NOMINAL = "nominal"
"""Name of the inertia set of a robot that has one only."""


class InertiaSet(NamedTuple):
    """Masses of the seven links, as one source publishes them."""

    mass: Array
    """Link masses [kg], shape (7,)."""
    com: Array
    """Centres of mass in the link frames [m], shape (7, 3)."""
    inertia: Array
    """Inertias about the com, link axes [kg m2], shape (7, 3, 3)."""


Row = tuple[float, tuple[float, ...], tuple[float, ...], tuple[float, ...]]
"""Mass, com, (Ixx, Iyy, Izz) and (Ixy, Ixz, Iyz) of a link, as URDF files list them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Links(ArrayFacts):
    """The seven links as rigid bodies; what the flange carries is part of link 7."""

    shapes: ClassVar = {"mass": (7,), "com": (7, 3), "inertia": (7, 3, 3)}

    mass: Vec7
    """Link masses [kg], shape (7,); the payload is part of link 7."""
    com: Array
    """Link centres of mass in the link frame [m], shape (7, 3)."""
    inertia: Array
    """Link inertias about the com, link axes [kg m2], shape (7, 3, 3)."""
    inertia_set: str = NOMINAL
    """Name of the inertia set that mass, com and inertia are."""
    inertia_sets: Mapping[str, InertiaSet] = field(default_factory=dict)
    """Other published sets of the same arm, by name; see `Robot.with_inertia`."""

    def __post_init__(self) -> None:
        """Refuse a link that no body can be, by its joint."""
        super().__post_init__()
        for i, joint in enumerate(JOINTS):
            if self.mass[i] <= 0.0:
                raise ConfigError(
                    f"mass of link {joint} is {self.mass[i]} kg: it must be > 0"
                )
            require_inertia(self.inertia[i], f"link {joint}")


def inertia_set(rows: tuple[Row, ...]) -> InertiaSet:
    """Return the rows of seven links as arrays."""
    masses, coms, moments, products = zip(*rows, strict=True)
    inertias = np.array([np.diag(row) for row in moments])
    for matrix, (xy, xz, yz) in zip(inertias, products, strict=True):
        matrix += np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    return InertiaSet(np.array(masses), np.array(coms, dtype=float), inertias)
