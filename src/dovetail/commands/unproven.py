"""Says of an arm what lies outside that for which the limits were shown to hold."""

from pathlib import Path

from rich.console import Console

from dovetail.arms.address import parse_address
from dovetail.control.limits import DeclaredErrors
from dovetail.plants.twin import load_twin
from dovetail.robots.find import find_robot


def warn_of_arm(
    console: Console,
    twin: str | Path | None,
    arm: str | None = None,
    robot: str | None = None,
    declared: DeclaredErrors | None = None,
) -> None:
    """Name each value that is outside, with its range and what to do.

    And an inertia set of another robot.

    Args:
        console: Where it is said.
        twin: A twin's name or file; None is no twin, or the arm's.
        arm: An arm's address.
        robot: The robot's name; None is not known yet.
        declared: Errors declared for the arm; None is the table.
    """
    beyond = [] if declared is None else declared.beyond_proven()
    said = [f"warning: {text}" for text in beyond]
    if arm is not None:
        address = parse_address(arm)
        twin = address.twin or twin
        if doubt := address.unproven_margins:
            said.append(f"warning: {doubt}")
    own = None if robot is None else find_robot(robot)
    if twin is not None:
        config = load_twin(twin)
        said += [f"warning: twin {twin}: {t}" for t in config.unproven().values()]
        if own is not None and (lack := config.lacks(own)):
            said.append(f"note: {lack}")
    if own is not None:
        said += [f"note: {text}" for text in (*own.notes, *own.motors.notes)]
    for text in said:
        console.print(text, soft_wrap=True, highlight=False)
