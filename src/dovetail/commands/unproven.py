"""Says of a twin what lies outside that for which the limits were shown to hold."""

from pathlib import Path

from rich.console import Console

from dovetail.arms.address import parse_address
from dovetail.plants.twin import load_twin
from dovetail.robots.find import find_robot


def warn_of_twin(
    console: Console,
    twin: str | Path | None,
    arm: str | None = None,
    robot: str | None = None,
) -> None:
    """Name each value that is outside, with its range and what to do.

    And an inertia set of another robot.

    Args:
        console: Where it is said.
        twin: A twin's name or file; None is no twin, or the arm's.
        arm: An arm's address.
        robot: The robot's name; None is not known yet.
    """
    if arm is not None:
        twin = parse_address(arm).twin or twin
    if twin is None:
        return
    config = load_twin(twin)
    said = [f"warning: twin {twin}: {text}" for text in config.unproven().values()]
    if robot is not None and (lack := config.lacks(find_robot(robot))):
        said.append(f"note: {lack}")
    for text in said:
        console.print(text, soft_wrap=True, highlight=False)
