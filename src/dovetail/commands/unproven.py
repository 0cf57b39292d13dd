"""Says of a twin what lies outside that for which the limits were shown to hold."""

from pathlib import Path

from rich.console import Console

from dovetail.arms.address import parse_address
from dovetail.control.proven import unproven
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
    model = load_twin(twin)
    error = max(abs(scale - 1.0) for scale in model.mass_scale)
    for text in unproven(delay=model.command_delay, mass_error=error):
        console.print(f"warning: twin {twin}: {text}", soft_wrap=True, highlight=False)
