"""Success, time and force on a fixture that was moved while the camera was covered."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from dovetail.control.period import POLICY_PERIOD
from dovetail.evaluation.config import EvaluationConfig
from dovetail.evaluation.evaluate import evaluate
from dovetail.evaluation.transfer import Row
from dovetail.files import claim_output_folder, write_atomic
from dovetail.page import finite, page, table

SHIFTS = (0.0, 5.0, 10.0, 20.0, 30.0)
"""Distances by which the fixture is moved [mm]."""
HEADS = ("who", "moved [mm]", "success", "median / max [s]", "peak force p95 [N]")


class CoverResult(NamedTuple):
    """One entry of the table."""

    who: str
    """Name of the actor."""
    shift: float
    """Distance by which the fixture was moved [mm]."""
    row: Row
    """Result over all tries."""

    def texts(self) -> tuple[str, ...]:
        """Return the entry as text, one for each of `HEADS`."""
        steps = self.row.steps
        times = (POLICY_PERIOD * steps.median, POLICY_PERIOD * steps.max)
        took = "none" if math.isnan(times[0]) else f"{times[0]:.1f} / {times[1]:.1f}"
        peak = self.row.force.peak_p95
        return (
            self.who,
            f"{self.shift:g}",
            f"{self.row.successes}/{self.row.tries}",
            took,
            "-" if math.isnan(peak) else f"{peak:.0f}",
        )


def compare(
    actors: Sequence[tuple[str, EvaluationConfig]],
    folder: Path,
    console: Console,
    shifts: Sequence[float] = SHIFTS,
) -> list[CoverResult]:
    """Compare actors on a fixture that was moved unseen; print and write the table.

    Each cell's own report lies in a folder of its name.

    Args:
        actors: Name and evaluation of each; its `fixture_shift` and `out` are set here.
        folder: Where to, new or empty.
        console: Where bar and table go.
        shifts: Distances by which the fixture is moved [mm].

    Raises:
        DovetailError: See `evaluate`.
    """
    folder = claim_output_folder(folder)
    cells: list[CoverResult] = []
    jobs = [(who, config, shift) for who, config in actors for shift in shifts]
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        console=console,
    ) as progress:
        bar = progress.add_task("", total=len(jobs))
        for who, config, shift in jobs:
            progress.update(bar, description=f"{who}, moved by {shift:g} mm")
            out = folder / f"{who.replace(' ', '-')}-{shift:g}-mm"
            asked = replace(config, fixture_shift=1e-3 * shift, out=out)
            found = evaluate(asked, Console(file=StringIO()))
            cells.append(CoverResult(who, shift, found.rows[-1]))
            progress.advance(bar)
    console.print(_render(cells))
    write_atomic(
        folder / "cover.json", json.dumps(list(_plain(cells)), indent=2) + "\n"
    )
    rows = [cell.texts() for cell in cells]
    title = "Camera covered, fixture then moved"
    parts = [f"<h1>{title}</h1>", table(HEADS, rows)]
    write_atomic(folder / "cover.html", page(title, parts))
    return cells


def _plain(cells: Sequence[CoverResult]) -> Iterator[dict[str, Any]]:
    for cell in cells:
        numbers = {name: finite(value) for name, value in cell.row.numbers().items()}
        yield {"who": cell.who, "moved_mm": cell.shift, **numbers}


def _render(cells: Sequence[CoverResult]) -> Table:
    shown = Table(box=SIMPLE_HEAD)
    for name in HEADS:
        shown.add_column(name, justify="left" if name == HEADS[0] else "right")
    before = ""
    for cell in cells:
        if before and cell.who != before:
            shown.add_section()
        shown.add_row(*cell.texts())
        before = cell.who
    return shown
