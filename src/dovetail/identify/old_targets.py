"""Targets of recordings of format 1, which log actions alone."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from dovetail import _core
from dovetail.control.target_columns import target_row
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.commands import CommandMap
from dovetail.tasks.task import Goal
from dovetail.types import Array


def targets_of_actions(
    actions: Array, goal: Goal, metadata: Mapping[str, Any]
) -> Array:
    """Return the Target of each action, as the environment then made it.

    Args:
        actions: In [-1, 1], shape (steps, commanded axes).
        goal: To which pose axes are relative.
        metadata: What `recording.json` holds.

    Returns:
        Columns `TARGET_UNITS`, shape (steps, columns).
    """
    commands = CommandMap(TaskSpec.parse(metadata["task"]), **metadata["commands"])
    target = _core.Target()
    target.near_plane = np.append(goal.normal, metadata["near_height"])
    rows = []
    for action in actions.astype(np.float32):
        commands.fill(target, action, goal.position, goal.quat_wxyz)
        rows.append(target_row(target))
    return np.array(rows)
