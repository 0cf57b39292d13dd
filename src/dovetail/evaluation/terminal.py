"""Tries on a terminal: the bar while they run, the table when they are done."""

from collections.abc import Iterator, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from dovetail.errors import DovetailError
from dovetail.evaluation.outcome import Outcome
from dovetail.evaluation.transfer import COLUMNS, Row, cells, summarise


def run_shown(
    trials: Iterator[Outcome],
    count: int,
    title: str,
    names: list[str],
    done_word: str,
    console: Console,
) -> list[Outcome]:
    """Run the tries under a progress bar; if they are cut short, show what there is."""
    outcomes: list[Outcome] = []
    try:
        _collect(trials, count, outcomes, done_word, console)
    except (DovetailError, KeyboardInterrupt):
        if outcomes:
            rows = summarise(outcomes, names[: outcomes[-1].job.pose + 1])
            part = f"partial: {len(outcomes)} of {count} tries, no report"
            console.print(f"{title} ({part})", soft_wrap=True)
            console.print(render_table(rows))
        raise
    return outcomes


def _collect(
    trials: Iterator[Outcome],
    count: int,
    outcomes: list[Outcome],
    done_word: str,
    console: Console,
) -> None:
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[done]} " + done_word),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    ) as progress:
        bar = progress.add_task("tries", total=count, done=0)
        for outcome in trials:
            outcomes.append(outcome)
            progress.update(bar, advance=1, done=sum(o.success for o in outcomes))


def render_table(rows: Sequence[Row]) -> Table:
    """Return the transfer table for a terminal, without its title."""
    table = Table(box=SIMPLE_HEAD)
    table.pad_edge = False
    lines = [cells(row) for row in rows]
    for name, *entries in zip(COLUMNS, *lines, strict=True):
        words = [*name.split(), *entries]  # headings wrap, numbers do not
        side = "left" if name == COLUMNS[0] else "right"
        table.add_column(name, justify=side, width=max(map(len, words)))
    for line in lines[:-1]:
        table.add_row(*line)
    table.add_section()
    table.add_row(*lines[-1], style="bold")
    return table
