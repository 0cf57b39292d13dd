"""Says of an arm what lies outside that for which the limits were shown to hold."""

from pathlib import Path
from typing import Any

from rich.console import Console

from dovetail.arms.address import parse_address
from dovetail.control.limits import DeclaredErrors
from dovetail.envs.registered import find_cell
from dovetail.plants.twin import load_twin
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.workcell.workcell import Workcell


def warn_of_arm(
    console: Console,
    twin: str | Path | None,
    arm: str | None = None,
    cell: Workcell | None = None,
    declared: DeclaredErrors | None = None,
) -> None:
    """Name each value that is outside, with its range and what to do.

    And an inertia set of another robot.

    Args:
        console: Where it is said.
        twin: A twin's name or file; None is no twin, or the arm's.
        arm: An arm's address.
        cell: The robot in its cell, see `cell_of`; None is not known yet.
        declared: Errors declared for the arm; None is the table.
    """
    beyond = [] if declared is None else declared.beyond_proven()
    said = [f"warning: {text}" for text in beyond]
    twin = _twin_of(twin, arm)
    if arm is not None and (doubt := parse_address(arm).unproven_margins):
        said.append(f"warning: {doubt}")
    if twin is not None:
        told = load_twin(twin).unproven().values()
        said += [f"warning: twin {twin}: {text}" for text in told]
    for text in said:
        console.print(text, soft_wrap=True, highlight=False)
    if cell is not None:
        note_cell(console, cell, twin)


def note_cell(
    console: Console, cell: Workcell, twin: str | Path | None, arm: str | None = None
) -> None:
    """Print what is noted of a cell and its robot, and a twin's other inertia set.

    Args:
        console: Where it is said.
        cell: The robot in its cell.
        twin: A twin's name or file; None is no twin, or the arm's.
        arm: An arm's address.
    """
    twin = _twin_of(twin, arm)
    lack = "" if twin is None else load_twin(twin).lacks(cell.robot)
    for text in filter(None, (lack, *cell.notes)):
        console.print(f"note: {text}", soft_wrap=True, highlight=False)


def _twin_of(twin: str | Path | None, arm: str | None) -> str | Path | None:
    """Return the twin of an arm's address, or else the given one."""
    return twin if arm is None else parse_address(arm).twin or twin


def cell_of(settings: Any) -> Workcell:
    """Return the cell of a command's settings, with its robot.

    Args:
        settings: Its robot, and its env, task_options and cell, if it has them.

    Raises:
        DovetailError: No such robot, or one that the task does not suit.
    """
    given = vars(settings)
    return find_cell(
        given.get("env") or DEFAULT_ENV,
        given["robot"] or DEFAULT_ROBOT,
        given.get("cell"),
        **given.get("task_options", {}),
    )
