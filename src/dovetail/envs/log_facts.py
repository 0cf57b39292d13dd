"""What an Episode log says of the cell it was taken in, so that it can be drawn."""

from dataclasses import fields
from typing import Any

import gymnasium

from dovetail.envs.unwrapped import require_contact_env


def describe_cell(env: gymnasium.Env) -> dict[str, Any]:
    """Return the name of an environment, its robot and its task's plain settings."""
    core = require_contact_env(env)
    task = {f.name: vars(core.task)[f.name] for f in fields(core.task)}
    plain = {k: v for k, v in task.items() if isinstance(v, str | int | float)}
    return {
        "env_id": env.spec.id if env.spec else "",
        "robot": core.config.place.robot,
        "task": plain,
    }
