"""Meaning of the numbers of observation and action, written and compared on load."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from dovetail.envs.observation import GROUPS
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import PolicyError
from dovetail.robots.find import DEFAULT_ROBOT, robot_label

_PARTS = ("zero", "unit", "is_logarithmic")
"""Parts of the scaling, each with a number for every column."""

_COUNTED = tuple(column.name for column in GROUPS["position"].columns)
"""Columns that are counted from a task's zero."""


def describe_spaces(env: Any) -> dict[str, Any]:
    """Return size and meaning of observation and action, for a policy's JSON file."""
    core = require_contact_env(env)
    zero = {"zero_at": core.task.zero_at} if core.task.zero_at else {}
    return {
        "observation": {
            "size": int(env.observation_space.shape[0]),
            "columns": [list(column) for column in core.columns],
            "scaling": core.scaling.describe(),
            **zero,
        },
        "action": {
            "size": int(env.action_space.shape[0]),
            "axes": list(core.commands.axes),
            "scale": [float(value) for value in core.commands.scale],
        },
    }


def require_spaces(metadata: Mapping[str, Any], env: Any) -> None:
    """Refuse an environment in which a number means something else than in training.

    Args:
        metadata: Content of a policy's JSON file.
        env: Environment of dovetail, wrapped or not.

    Raises:
        PolicyError: Names the column of the observation or the axis of the action, and
            both values; or the file does not say what its numbers mean.
    """
    here = _read(describe_spaces(env))
    try:
        trained = _read(metadata)
    except (LookupError, TypeError, ValueError, OverflowError) as error:
        raise PolicyError(
            "the policy's JSON file does not say what the numbers of its observation "
            "and action mean (sections 'observation' and 'action'): export the policy "
            "again"
        ) from error
    _require_same_columns(trained, here, _way_on(metadata, env))
    _require_same_axes(trained, here)


class _Spaces(NamedTuple):
    size: int
    columns: list[tuple[str, str]]
    scaling: dict[str, list[float]]
    zero_at: str
    axes: list[str]
    scale: list[float]


def _read(described: Mapping[str, Any]) -> _Spaces:
    """Return a description of `describe_spaces`, each entry of its own type."""
    seen, action = described["observation"], described["action"]
    columns = [(str(column[0]), str(column[1])) for column in seen["columns"]]
    parts = {part: seen["scaling"][part] for part in _PARTS}
    scaling = {part: [float(x) for x in parts[part]] for part in parts}
    axes = [str(axis) for axis in action["axes"]]
    scale = [float(value) for value in action["scale"]]
    zero_at = str(seen.get("zero_at", ""))
    return _Spaces(int(seen["size"]), columns, scaling, zero_at, axes, scale)


def _way_on(metadata: Mapping[str, Any], env: Any) -> str:
    """Say what to do where a column is scaled in another way: it may be the robot's."""
    robot = require_contact_env(env).config.robot
    trained = metadata.get("env", {}).get("robot", DEFAULT_ROBOT)
    if robot == trained:
        return "use the arm and the task that it was trained for, or train it anew"
    return (
        f"it was trained with the robot {robot_label(str(trained))}, and here is "
        f"{robot_label(robot)}: take a policy that was trained with this one (dovetail "
        "train --robot) or without joint angles (--without joints), or leave --robot "
        "out"
    )


def _require_same_columns(trained: _Spaces, here: _Spaces, way_on: str) -> None:
    pairs = zip(trained.columns, here.columns, strict=False)
    for i, ((name, unit), (new_name, new_unit)) in enumerate(pairs):
        if (name, unit) != (new_name, new_unit):
            raise PolicyError(
                f"column {i} of the observation is {new_name} [{new_unit}] here and "
                f"was {name[:40]!r} [{unit[:40]!r}] in the policy's training; choose "
                "the task that it was trained for, and the --without, --also and "
                "--recall of its training"
            )
    _require_count("columns of one observation", trained.columns, here.columns)
    # Counted from one place, a height is the same number over any goal.
    is_same_place = here.zero_at != "" and here.zero_at == trained.zero_at
    for part, values in here.scaling.items():
        _require_count(part.replace("_", " "), trained.scaling[part], values)
        for i, (old, new) in enumerate(zip(trained.scaling[part], values, strict=True)):
            column, unit = here.columns[i]
            if is_same_place and part == "zero" and column in _COUNTED:
                continue
            if not _is_close(old, new):
                raise PolicyError(
                    f"the observation's column {column} is scaled in another way than "
                    f"in the policy's training: {part.replace('_', ' ')} is {new:g} "
                    f"{unit} here and was {old:g}; {way_on}"
                )
    if trained.size != here.size:
        raise PolicyError(
            f"there are {here.size} numbers in the observation here and {trained.size} "
            "in the policy's training; give the stack that it was trained with"
        )


def _require_same_axes(trained: _Spaces, here: _Spaces) -> None:
    if trained.axes != here.axes:
        raise PolicyError(
            f"the action has the axes {' '.join(here.axes)} here and "
            f"{' '.join(trained.axes)!r} in the policy's training; it was trained for "
            "another task"
        )
    _require_count("values of the action at 1", trained.scale, here.scale)
    for axis, old, new in zip(here.axes, trained.scale, here.scale, strict=True):
        if not _is_close(old, new):
            raise PolicyError(
                f"the action's axis {axis} means {new:g} at 1 here and {old:g} in the "
                "policy's training; give f_scale, f_scale_angular, theta_range and "
                "position_range as it was trained with"
            )


def _is_close(a: float, b: float) -> bool:
    return math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-9)


def _require_count(what: str, before: list[Any], now: list[Any]) -> None:
    if len(before) != len(now):
        raise PolicyError(
            f"there are {len(now)} {what} here and {len(before)} in the policy's "
            "training; choose the task that it was trained for"
        )
