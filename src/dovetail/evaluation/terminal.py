"""Tries on a terminal: the bar while they run, the table when they are done."""

from collections.abc import Iterable, Iterator, Sequence

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


def print_notes(notes: Iterable[str], console: Console) -> None:
    """Print notes, each on a line of its own; an empty one is none."""
    for note in filter(None, notes):
        console.print(f"note: {note}", soft_wrap=True, highlight=False)


def render_table(rows: Sequence[Row]) -> Table:
    """Return the transfer table for a terminal, without its title; the sum is last."""
    table = render_rows(rows[:-1], COLUMNS[0], also=rows[-1:])
    table.add_section()
    table.add_row(*cells(rows[-1]), style="bold")
    return table


def render_rows(rows: Sequence[Row], first: str, also: Sequence[Row] = ()) -> Table:
    """Return rows as a table for a terminal.

    Args:
        rows: The rows.
        first: Heading of their labels.
        also: Rows that will be added, for which the columns are wide enough.
    """
    table = Table(box=SIMPLE_HEAD)
    table.pad_edge = False
    lines = [cells(row) for row in (*rows, *also)]
    for name, *entries in zip((first, *COLUMNS[1:]), *lines, strict=True):
        words = [*name.split(), *entries]  # headings wrap, numbers do not
        side = "left" if name == first else "right"
        table.add_column(name, justify=side, width=max(map(len, words)))
    for line in lines[: len(rows)]:
        table.add_row(*line)
    return table
