"""What of a run's settings is the environment's: handed to it by their short names."""

from dataclasses import fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dovetail.learn.config import TrainConfig

ENV_FIELDS = (
    *("plant", "peg", "clearance", "task", "stack", "period"),
    *("robot", "tracker"),
    *("f_scale", "f_scale_angular", "force_damping", "tare"),
    *("near_speed", "near_press", "near_distance"),
    *("theta_range", "position_range", "max_steps", "scheme"),
)
"""Fields that are handed to the environment as they are."""

_TASK_FIELDS = {"peg": "peg", "clearance": "clearance", "task": "axes"}
"""Option, and the field of a task that it is; left out, it is the task's own."""


def given_settings(config: "TrainConfig") -> dict[str, Any]:
    """Return the settings of the environment that are given."""
    given = {name: getattr(config, name) for name in ENV_FIELDS}
    return {name: value for name, value in given.items() if value is not None}


def own_settings(config: "TrainConfig") -> dict[str, Any]:
    """Return what is not given and so is the task's own."""
    own = {f.name: f.default for f in fields(config.task_class)}
    return {
        option: own[name]
        for option, name in _TASK_FIELDS.items()
        if name in own and getattr(config, option) is None
    }
