"""What an Episode log says of the cell it was taken in, so that it can be drawn."""

from dataclasses import fields
from typing import Any

import gymnasium

from dovetail.envs.unwrapped import require_contact_env

CELL = "cell"
"""Key of a log's metadata."""


def describe_cell(env: gymnasium.Env) -> dict[str, Any]:
    """Return, under `CELL`, an environment's name, robot and plain task settings."""
    core = require_contact_env(env)
    task = {f.name: vars(core.task)[f.name] for f in fields(core.task)}
    plain = {k: v for k, v in task.items() if isinstance(v, str | int | float)}
    name = core.spec.id if core.spec else ""
    return {CELL: {"env_id": name, "robot": core.config.place.robot, "task": plain}}
