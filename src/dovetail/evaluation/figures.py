"""The figures of an evaluation as PNG: the tool's paths and the contact force."""

import math
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dovetail.evaluation.fixture_figure import (
    INK,
    draw_from_above,
    draw_from_side,
    figure_title,
)
from dovetail.evaluation.outcome import Outcome
from dovetail.tasks.task import Task
from dovetail.workcell.parts import Part

DONE = "#0b7a75"
MISSED = "#d1495b"
_VIEW = 60.0  # half width of a view [mm]


def draw_paths(
    outcomes: Sequence[Outcome],
    labels: Sequence[str],
    *,
    fixture: Part,
    title: str,
    done_word: str = Task.done_word,
) -> bytes:
    """Draw the tool's path of every try, one column per pose of the fixture.

    Above the view from the top, below the view along the fixture's y; both in its
    frame, with its sections.

    Args:
        outcomes: The tries.
        labels: Names of the fixture's poses.
        fixture: In its own frame.
        title: Line above the figure: what was tried on what.
        done_word: What a success is called.

    Returns:
        A PNG file.
    """
    figure = Figure(figsize=(3.4 * len(labels), 6.6), dpi=130, layout="constrained")
    figure.suptitle(figure_title(title, len(labels)), fontsize=11, color=INK)
    grid = figure.subplots(2, len(labels), squeeze=False)
    draw_from_above(grid[0], fixture)
    draw_from_side(grid[1], fixture)
    for column, label in enumerate(labels):
        tries = [outcome for outcome in outcomes if outcome.job.pose == column]
        top, side = grid[0, column], grid[1, column]
        done = sum(outcome.success for outcome in tries)
        top.set_title(f"pose {label}: {done}/{len(tries)}", fontsize=10)
        for outcome in tries:
            if not len(outcome.course.path):
                continue  # the arm ended it before the first step
            path = 1e3 * outcome.course.path
            style = {
                "color": DONE if outcome.success else MISSED,
                "linewidth": 0.8,
                "alpha": 0.65,
            }
            top.plot(path[:, 0], path[:, 1], **style)
            side.plot(path[:, 0], path[:, 2], **style)
            for axes, row in ((top, 1), (side, 2)):
                axes.plot(*path[0, [0, row]], "o", color=style["color"], markersize=2)
        for axes, across in ((top, "y"), (side, "z")):
            axes.set_ylabel(f"{across} [mm]" if column == 0 else "", fontsize=8)
    for axes in grid[1]:
        axes.set_xlabel("x in the fixture's frame [mm]", fontsize=8)
    _fit(grid, outcomes, fixture)
    _add_legend(figure, done_word)
    return _png(figure)


def _fit(grid: Any, outcomes: Sequence[Outcome], fixture: Part) -> None:
    """Give all top views, and all side views, the same range."""
    some = [o.course.path for o in outcomes if len(o.course.path)]
    paths = [1e3 * path for path in (*some, fixture.corners)]
    low = np.min([path.min(axis=0) for path in paths], axis=0) - 5.0
    high = np.max([path.max(axis=0) for path in paths], axis=0) + 5.0
    low, high = np.minimum(low, -_VIEW), np.maximum(high, _VIEW)
    for row, across in ((0, 1), (1, 2)):
        for axes in grid[row]:
            axes.set_xlim(low[0], high[0])
            axes.set_ylim(low[across], high[across])
            axes.set_aspect("equal", adjustable="box")
            axes.tick_params(labelsize=7)
            axes.spines[["top", "right"]].set_visible(False)


def _add_legend(figure: Any, done_word: str) -> None:
    handles = [
        Line2D([], [], color=DONE, label=done_word),
        Line2D([], [], color=MISSED, label=f"not {done_word}"),
        Line2D([], [], color=INK, marker="o", ls="", markersize=3, label="start"),
    ]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=8,
    )


def draw_forces(outcomes: Sequence[Outcome]) -> bytes:
    """Draw how the peak and the mean contact force spread over the tries.

    Returns:
        A PNG file.
    """
    figure = Figure(figsize=(7.6, 2.7), dpi=130, layout="constrained")
    peak_axes, mean_axes = figure.subplots(1, 2)
    for axes, name, key in (
        (peak_axes, "peak contact force of a try [N]", "peak"),
        (mean_axes, "mean contact force of a try, in contact [N]", "mean"),
    ):
        measured = [o for o in outcomes if not math.isnan(vars(o.force)[key])]
        split = [
            [vars(o.force)[key] for o in measured if o.success],
            [vars(o.force)[key] for o in measured if not o.success],
        ]
        everything = np.array(split[0] + split[1] or [0.0])
        bins = np.linspace(0.0, max(1.0, 1.05 * everything.max()), 25)
        axes.hist(split, bins, stacked=True, color=[DONE, MISSED])
        p95 = np.percentile(everything, 95)
        axes.axvline(p95, color=INK, linewidth=1, linestyle="--")
        title = f"95 % of the tries below {p95:.1f} N" if measured else "not measured"
        axes.set_title(title, fontsize=9, color=INK)
        axes.set_xlabel(name, fontsize=8)
        axes.set_ylabel("tries", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    return _png(figure)


def draw_differences(lines: Mapping[str, Sequence[Sequence[float]]]) -> bytes:
    """Draw how the difference of success rates and its interval changed with the tries.

    Args:
        lines: For each two policies the difference and both ends of its interval after
            each try, -1 to 1.

    Returns:
        A PNG file.
    """
    size = (7.0, 2.4 * len(lines) + 0.4)
    figure = Figure(figsize=size, dpi=130, layout="constrained")
    grid = figure.subplots(len(lines), 1, squeeze=False, sharex=True)[:, 0]
    for axes, (name, rows) in zip(grid, lines.items(), strict=True):
        tries = np.arange(1, len(rows) + 1)
        value, low, high = 100.0 * np.array(rows).T
        axes.axhline(0.0, color=INK, linewidth=0.8)
        axes.fill_between(tries, low, high, color=DONE, alpha=0.2, linewidth=0)
        axes.plot(tries, value, color=DONE, linewidth=1.5)
        axes.set_title(name, fontsize=10, color=INK)
        axes.set_ylabel("difference [%]", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    grid[-1].set_xlabel("tries of each", fontsize=8)
    return _png(figure)


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
