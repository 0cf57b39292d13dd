"""Friction and rotor inertia that an arm's drives add to its links."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from dovetail.errors import ConfigError
from dovetail.robots.arrays import ArrayFacts, frozen_array
from dovetail.types import JOINTS, Vec7


@dataclass(frozen=True, kw_only=True, eq=False)
class Motors(ArrayFacts):
    """Friction and rotor inertia of the drives, as the model assumes them."""

    shapes: ClassVar = {"damping": (7,), "armature": (7,)}

    damping: Vec7 = field(default_factory=lambda: np.full(7, 0.5))
    """Viscous friction of the joints that the model assumes [Nms/rad], shape (7,)."""
    armature: Vec7 = field(default_factory=lambda: np.full(7, 0.1))
    """Rotor inertia at the joints that the model assumes [kg m2], shape (7,)."""
    coulomb: Vec7 = field(default_factory=lambda: np.zeros(7))
    """Dry friction of the joints [Nm], shape (7,). Only a simulated arm has it: the
    controller's model has none, so it does not go over a wire."""
    notes: tuple[str, ...] = ()
    """Values that a robot file does not give, and those assumed instead."""

    def values(self) -> dict[str, Any]:
        """Return damping, dry friction and rotor inertia by name, as settings are."""
        names = ("damping", "coulomb", "armature")
        return {name: tuple(vars(self)[name].tolist()) for name in names}

    def __post_init__(self) -> None:
        """Refuse a negative value, by its joint."""
        super().__post_init__()
        coulomb = frozen_array(self.coulomb, (7,), "robot coulomb")
        object.__setattr__(self, "coulomb", coulomb)
        units = {"damping": "Nms/rad", "armature": "kg m2", "coulomb": "Nm"}
        for name, unit in units.items():
            for joint, value in zip(JOINTS, vars(self)[name], strict=True):
                if value < 0.0:
                    raise ConfigError(
                        f"{name}[{joint}] is {value} {unit}: must be >= 0"
                    )
