"""Limits of an arm's joints: position, speed and torque."""

from dataclasses import dataclass
from typing import ClassVar

from dovetail.errors import ConfigError
from dovetail.robots.arrays import ArrayFacts
from dovetail.types import JOINTS, Vec7


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLimits(ArrayFacts):
    """Limits of the joints themselves; a controller's limits lie inside."""

    shapes: ClassVar = dict.fromkeys(("q_min", "q_max", "dq_max", "tau_max"), (7,))

    q_min: Vec7
    """Lower joint limits [rad], shape (7,)."""
    q_max: Vec7
    """Upper joint limits [rad], shape (7,)."""
    dq_max: Vec7
    """Joint speed limits [rad/s], shape (7,)."""
    tau_max: Vec7
    """Motor torque limits [Nm], gravity included, shape (7,)."""

    def __post_init__(self) -> None:
        """Refuse a limit that leaves nothing, by its joint."""
        super().__post_init__()
        for i, joint in enumerate(JOINTS):
            if self.q_min[i] >= self.q_max[i]:
                raise ConfigError(
                    f"joint {joint} has q_min {self.q_min[i]} rad >= "
                    f"q_max {self.q_max[i]} rad"
                )
            for name, unit in (("dq_max", "rad/s"), ("tau_max", "Nm")):
                if vars(self)[name][i] <= 0.0:
                    value = vars(self)[name][i]
                    raise ConfigError(f"{name}[{joint}] is {value} {unit}: must be > 0")
