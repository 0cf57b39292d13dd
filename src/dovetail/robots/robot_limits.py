"""Limits of an arm's joints: position, speed, torque, and how quickly it changes."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dovetail.errors import ConfigError
from dovetail.robots.arrays import ArrayFacts
from dovetail.types import JOINTS, Vec7


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLimits(ArrayFacts):
    """Limits of the joints themselves; a controller's limits lie inside."""

    shapes: ClassVar = dict.fromkeys(
        (
            "q_min",
            "q_max",
            "dq_max",
            "tau_max",
            "taper_brake",
            "taper_offset",
            "dtau_max",
        ),
        (7,),
    )
    unbounded: ClassVar = frozenset(("taper_brake", "dtau_max"))

    q_min: Vec7
    """Lower joint limits [rad], shape (7,)."""
    q_max: Vec7
    """Upper joint limits [rad], shape (7,)."""
    dq_max: Vec7
    """Joint speed limits [rad/s], shape (7,)."""
    tau_max: Vec7
    """Motor torque limits [Nm], gravity included, shape (7,)."""
    taper_brake: Vec7 = field(default_factory=lambda: np.full(7, np.inf))
    """Fall of the speed limit towards a position limit [rad/s2], shape (7,): at the
    distance d from it, it is sqrt(2 d taper_brake) - taper_offset. Infinity: none."""
    taper_offset: Vec7 = field(default_factory=lambda: np.zeros(7))
    """See `taper_brake` [rad/s], shape (7,)."""
    dtau_max: Vec7 = field(default_factory=lambda: np.full(7, np.inf))
    """Largest change of the commanded torque [Nm/s], shape (7,). Infinity: none."""

    def __post_init__(self) -> None:
        """Refuse a limit that leaves nothing, by its joint."""
        super().__post_init__()
        for i, joint in enumerate(JOINTS):
            if self.q_min[i] >= self.q_max[i]:
                raise ConfigError(
                    f"joint {joint} has q_min {self.q_min[i]} rad >= "
                    f"q_max {self.q_max[i]} rad"
                )
            units = {
                "dq_max": "rad/s",
                "tau_max": "Nm",
                "taper_brake": "rad/s2",
                "dtau_max": "Nm/s",
            }
            for name, unit in units.items():
                if vars(self)[name][i] <= 0.0:
                    value = vars(self)[name][i]
                    raise ConfigError(f"{name}[{joint}] is {value} {unit}: must be > 0")
            if self.taper_offset[i] < 0.0:
                raise ConfigError(
                    f"taper_offset[{joint}] is {self.taper_offset[i]} rad/s: must be "
                    ">= 0"
                )

    def room_at(self, speed: float) -> Vec7:
        """Return the distance from a position limit at which a speed is allowed [rad].

        Args:
            speed: Speed that the falling limit still allows there [rad/s].
        """
        return (speed + self.taper_offset) ** 2 / (2.0 * self.taper_brake)
