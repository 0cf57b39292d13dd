"""Facts of the environment that an Episode log keeps: cell, action, observation."""

from dataclasses import fields
from typing import Any

import gymnasium

from dovetail.envs.commands import per_axis
from dovetail.envs.unwrapped import require_contact_env
from dovetail.types import Array

CELL = "cell"
"""Key of a log's metadata: what is needed to draw it."""
ACTION = "action"
"""Key of what an action meant."""
FIRST = "first observation"
"""Key of the unscaled observation before the first action, by column."""
SUCCESS = "success"
"""Key that says whether the task was done at the log's end."""


def describe_cell(env: gymnasium.Env) -> dict[str, Any]:
    """Return the facts that a log keeps of its environment.

    Under `CELL` its name, robot, plain task settings and what its cell file says; under
    `ACTION` the axes, the value at action 1 [m/s2, rad/s2, m, rad], the damping of
    force axes [1/s], the reward's weight of force [1/N] and the script that an action
    corrects.
    """
    core = require_contact_env(env)
    task = {f.name: vars(core.task)[f.name] for f in fields(core.task) if f.init}
    plain = {k: v for k, v in task.items() if isinstance(v, str | int | float)}
    name = core.spec.id if core.spec else ""
    action = {
        "axes": list(core.commands.axes),
        "scale": [float(value) for value in core.commands.scale],
        "force_damping": list(per_axis("", core.config.force_damping)),
        "force_weight": core.task.reward.force_weight,
        "script": core.config.script or "none",
    }
    robot = core.config.robot
    facts = {"env_id": name, "robot": robot, "task": plain}
    if core.config.cell is not None:
        facts["cell"] = core.config.cell.table()
    return {CELL: facts, ACTION: action}


def observed_columns(env: gymnasium.Env) -> tuple[str, ...]:
    """Return the names of an environment's unscaled observation, in order."""
    return tuple(c.name for c in require_contact_env(env).scaling.columns)


def part_columns(env: gymnasium.Env) -> tuple[str, ...]:
    """Return the names of the joints of an environment's parts, in order."""
    return tuple(joint.column for joint in require_contact_env(env).cell.joints)


def describe_first(env: gymnasium.Env, raw: Array) -> dict[str, dict[str, float]]:
    """Return, under `FIRST`, the unscaled observation that a reset gave."""
    return {FIRST: dict(zip(observed_columns(env), raw.tolist(), strict=True))}
