"""Settings of a controller, besides its robot."""

from dataclasses import dataclass

from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerSettings:
    """Law, limits, task and period: they are made for each other."""

    osc: OscConfig
    limits: LimitConfig
    task: TaskSpec
    period: float
    """Control period [s]."""
