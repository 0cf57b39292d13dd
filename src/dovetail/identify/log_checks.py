"""Checks of one sequence's log before anything is fitted to it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail.control.target_columns import TARGET_UNITS, target_of
from dovetail.errors import ConfigError, LogError
from dovetail.plants.plant import COLUMN
from dovetail.robots.robot import Robot
from dovetail.types import Array

GAP = 0.25
"""Deviation of the time between two cycles that is a gap, as a share of the period."""
POSITION_TOLERANCE = 1e-3
"""Largest distance between the logged TCP and the model's at the logged q [m]."""
_LATENCY = 0.5
"""Share of a step by which its command may come late over a network."""


def require_same_facts(
    path: Path, found: Mapping[str, Any], expected: Mapping[str, Any]
) -> None:
    """Refuse a file that says it is of another robot, task, period or place.

    Raises:
        LogError: Names the first that differs.
    """
    for name, value in expected.items():
        if found.get(name) != value:
            raise LogError(
                f"{path}: the {name} is {found.get(name)!r}, the recording's is "
                f"{value!r}: the file is of another recording"
            )


def require_numbers(path: Path, name: str, told: Any, count: int) -> Array:
    """Return numbers from a file, shape (count,).

    Raises:
        LogError: They are not so many finite numbers.
    """
    try:
        values = np.asarray(told, dtype=float)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise LogError(
            f"{path} is damaged: {name} is {told!r}; expected are {count} numbers"
        )
    return values


def find_gaps(time: Array, period: float) -> NDArray[np.bool_]:
    """Return where cycles are missing after a row, shape (rows - 1,).

    Args:
        time: Of each cycle [s], shape (rows,).
        period: Control period [s].
    """
    return np.abs(np.diff(time) - period) > GAP * period


def require_gapless(path: Path, log: Array, period: float) -> None:
    """Refuse a log in which cycles are missing.

    Raises:
        LogError: Where, and how long.
    """
    time = log[:, COLUMN["time"]]
    intervals = np.diff(time)
    bad = find_gaps(time, period)
    if bad.any():
        row = int(np.argmax(bad))
        raise LogError(
            f"{path}: {1e3 * intervals[row]:g} ms pass between the cycles {row} and "
            f"{row + 1}, at {time[row]:.3f} s; the period is {1e3 * period:g} ms "
            f"({int(bad.sum())} gaps): delete the file and record it again"
        )


def require_robot(
    path: Path, name: str, robot: Robot, log: Array | None = None
) -> None:
    """Refuse a log of another robot or tool, by its name and by its geometry.

    Args:
        path: File, for the message.
        name: The robot's name in the file.
        robot: The robot on which it would be replayed.
        log: Its TCP must be where the robot has it at the logged configuration.

    Raises:
        LogError: Which robot it is, or how far the TCP is away.
    """
    if name != robot.name:
        raise LogError(
            f"{path}: the log is of the robot {name!r}; it can be replayed on "
            f"{robot.name!r} only"
        )
    if log is None:
        return
    for row in (0, len(log) // 2, len(log) - 1):
        q = log[row, COLUMN["q1"] : COLUMN["q7"] + 1]
        logged = log[row, COLUMN["x"] : COLUMN["z"] + 1]
        distance = float(np.linalg.norm(robot.tool_pose(q).position - logged))
        if not distance < POSITION_TOLERANCE:
            raise LogError(
                f"{path}: in row {row} the TCP is {1e3 * distance:.1f} mm from where "
                f"{robot.name} has it at the logged configuration; allowed is "
                f"{1e3 * POSITION_TOLERANCE:g} mm: the log is of another robot or tool"
            )


def read_targets(path: Path, told: Any, steps: int) -> Array:
    """Return the Target of each step, columns `TARGET_UNITS`.

    Args:
        path: File, for messages.
        told: What its metadata says: a table of columns and rows.
        steps: How many steps the log has.

    Raises:
        LogError: It is no such table, or a row is no Target; says which.
    """
    again = "delete the file and record it again"
    table = told if isinstance(told, Mapping) else {}
    try:
        rows = np.array(table.get("rows"), dtype=float)
    except (TypeError, ValueError, OverflowError):
        rows = np.empty(0)
    if table.get("columns") != [*TARGET_UNITS] or rows.shape != (
        steps,
        len(TARGET_UNITS),
    ):
        raise LogError(
            f"{path}: its Targets are of shape {rows.shape}; expected are {steps} rows "
            f"of {len(TARGET_UNITS)} numbers, {', '.join(TARGET_UNITS)}: {again}"
        )
    for step in range(steps):
        try:
            target_of(rows[step])
        except ConfigError as error:
            raise LogError(f"{path}: in step {step} {error}: {again}") from error
    return rows


def assign_steps(
    path: Path, log: Array, steps: NDArray[np.int_], f_star: Array
) -> tuple[int, tuple[int, ...]]:
    """Find the cycles in which each step's command was in force.

    Over a network a command arrives some cycles after the step has begun; the f* in
    the log says which command each cycle had.

    Args:
        path: File, for messages.
        log: Shape (cycles, columns).
        steps: Step that each cycle was logged in, shape (cycles,).
        f_star: f* that each step commands [m/s2], shape (steps, 3).

    Returns:
        First cycle of the first command, and the number of cycles of each step.

    Raises:
        LogError: A cycle's f* is of neither its step nor the one before.
    """
    logged = log[:, COLUMN["fsx"] : COLUMN["fsz"] + 1]
    own = np.abs(logged - f_star[steps]).max(axis=1)
    is_own = own < 1e-5 * (1.0 + np.abs(f_star).max())
    before = np.vstack([np.zeros(3), f_star])[steps]
    is_late = ~is_own & (np.abs(logged - before).max(axis=1) < own)
    if not (is_own | is_late).all() or is_late.mean() > _LATENCY:
        row = int(np.argmin(is_own))
        raise LogError(
            f"{path}: in row {row} the commanded f* is {logged[row].round(3).tolist()} "
            f"m/s2, step {steps[row]}'s Target asks for "
            f"{f_star[steps[row]].round(3).tolist()}: the log is of another task or "
            "scale"
        )
    true_steps = np.maximum.accumulate(steps - is_late)
    first = int(np.argmax(true_steps >= 0))
    counts = np.bincount(true_steps[first:], minlength=len(f_star))
    if (counts == 0).any():
        raise LogError(
            f"{path}: the command of step {int(np.argmin(counts))} never reached the "
            "arm; delete the file and record it again"
        )
    return first, tuple(int(n) for n in counts)
