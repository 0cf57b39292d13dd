"""What an arm's drives add to its links: friction and rotor inertia."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dovetail.robots.arrays import ArrayFacts
from dovetail.types import Vec7


@dataclass(frozen=True, kw_only=True, eq=False)
class Motors(ArrayFacts):
    """What the model assumes of the drives; a file of an arm rarely says it."""

    shapes: ClassVar = {"damping": (7,), "armature": (7,)}

    damping: Vec7 = field(default_factory=lambda: np.full(7, 0.5))
    """Viscous friction of the joints that the model assumes [Nms/rad], shape (7,)."""
    armature: Vec7 = field(default_factory=lambda: np.full(7, 0.1))
    """Rotor inertia at the joints that the model assumes [kg m2], shape (7,)."""
