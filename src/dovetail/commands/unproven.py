"""Says of a twin what lies outside that for which the limits were shown to hold."""

from pathlib import Path

from rich.console import Console

from dovetail.arms.address import parse_address
from dovetail.plants.twin import load_twin


def warn_of_twin(
    console: Console, twin: str | Path | None, arm: str | None = None
) -> None:
    """Name each value that is outside, with its range and what to do.

    Args:
        console: Where it is said.
        twin: A twin's name or file; None is no twin, or the arm's.
        arm: An arm's address.
    """
    if arm is not None:
        twin = parse_address(arm).twin or twin
    if twin is None:
        return
    for text in load_twin(twin).unproven().values():
        console.print(f"warning: twin {twin}: {text}", soft_wrap=True, highlight=False)
