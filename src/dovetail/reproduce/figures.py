"""The figures of the experiments as PNG: training, robustness, identified or not."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from dovetail.evaluation.transfer import Row
from dovetail.learn.progress import EpisodeRow
from dovetail.reproduce.plan import GROUNDS, VARIANTS
from dovetail.reproduce.results import Level, Table
from dovetail.types import Array

WINDOW = 10
"""Episodes of the moving average, as in the paper."""
_GRID = 300
_INK = "#4a4640"
COLOURS = {"stack-0": "#0b7a75", "stack-4": "#d1495b", "randomised": "#5c6bc0"}
_GROUND_COLOURS: dict[str, str] = dict(
    zip(GROUNDS, ("#b9b1a3", "#7fb8b4", COLOURS["stack-0"]), strict=True)
)
_AXES = {
    ("shift", "search"): ("hole moved, camera covered [mm]", 1e3),
    ("push",): ("random pushes up to [N]", 1.0),
    ("speed",): ("speed of the hole [mm/s]", 1e3),
}


def moving_average(values: Sequence[float], window: int = WINDOW) -> Array:
    """Return the mean of each value and up to `window` - 1 before it.

    Args:
        values: One number per episode.
        window: Number of episodes; fewer where there are not yet as many.
    """
    total = np.cumsum(np.concatenate([[0.0], np.asarray(values, dtype=float)]))
    last = np.arange(1, len(total))
    first = np.maximum(0, last - window)
    return (total[last] - total[first]) / (last - first)


def curve(runs: Sequence[Sequence[EpisodeRow]], field: str) -> tuple[Array, Array]:
    """Return a training curve of several seeds on a common grid of steps.

    Args:
        runs: Finished episodes of each seed, at least one with an episode.
        field: What is averaged, such as "success".

    Returns:
        Steps, shape (points,), from the latest first episode to the earliest last one;
        and the moving average of each seed there, shape (seeds, points).
    """
    some = [run for run in runs if run]
    low = max(run[0].step for run in some)
    high = max(low, min(run[-1].step for run in some))
    grid = np.linspace(low, high, _GRID)
    lines, column = [], EpisodeRow._fields.index(field)
    for run in some:
        steps = np.array([row.step for row in run], dtype=float)
        average = moving_average([float(row[column]) for row in run])
        lines.append(np.interp(grid, steps, average))
    return grid, np.array(lines)


def draw_training(curves: Mapping[str, Sequence[Sequence[EpisodeRow]]]) -> bytes:
    """Draw success and reward over the training steps, a curve per variant.

    The standard deviation over the seeds is shaded where there are several.

    Args:
        curves: Finished episodes of each seed, by variant.
    """
    figure = Figure(figsize=(9.0, 3.6), dpi=130, layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, field, name, factor in (
        (panels[0], "success", "success [%]", 100.0),
        (panels[1], "reward", "reward of an episode", 1.0),
    ):
        for variant, runs in curves.items():
            if not any(runs):
                continue
            grid, lines = curve(runs, field)
            mean, spread = factor * lines.mean(axis=0), factor * lines.std(axis=0)
            colour = COLOURS[variant]
            label = f"{VARIANTS[variant]} ({len(lines)} seed{'s'[: len(lines) > 1]})"
            axes.plot(grid, mean, color=colour, linewidth=1.2, label=label)
            if len(lines) > 1:
                low, high = mean - spread, mean + spread
                axes.fill_between(grid, low, high, color=colour, alpha=0.18, lw=0)
        axes.set_xlabel("environment steps", fontsize=8)
        axes.set_ylabel(name, fontsize=8)
        _plain(axes)
    panels[0].set_ylim(-3, 103)
    if panels[0].lines:
        panels[0].legend(frameon=False, fontsize=8)
    return _png(figure)


def draw_robustness(robustness: Mapping[tuple[str, str], Sequence[Level]]) -> bytes:
    """Draw success over the size of each disturbance, with Wilson 95 % bands.

    Args:
        robustness: Levels by variant and kind; kinds of one level are left out.
    """
    figure = Figure(figsize=(10.0, 3.2), dpi=130, layout="constrained")
    panels = figure.subplots(1, len(_AXES), sharey=True)
    for axes, (kinds, (name, factor)) in zip(panels, _AXES.items(), strict=True):
        for (variant, kind), levels in robustness.items():
            known = [(level.level, level.table) for level in levels]
            tries = [(factor * x, table.rows[-1]) for x, table in known if table]
            if kind in kinds and tries:
                word = ", searching" if kind == "search" else ""
                label = f"{VARIANTS[variant]}{word}"
                _draw_rates(
                    axes, tries, COLOURS[variant], label, "o--" if word else "o-"
                )
        axes.set_xlabel(name, fontsize=8)
        _plain(axes)
    panels[0].set_ylabel("success [%]", fontsize=8)
    panels[0].set_ylim(-3, 103)
    if panels[0].lines:
        panels[0].legend(frameon=False, fontsize=8)
    return _png(figure)


def _draw_rates(
    axes: Any, tries: Sequence[tuple[float, Row]], colour: str, label: str, line: str
) -> None:
    x = [level for level, _ in tries]
    rate = [100.0 * row.successes / row.tries for _, row in tries]
    low = [100.0 * row.interval.low for _, row in tries]
    high = [100.0 * row.interval.high for _, row in tries]
    axes.plot(x, rate, line, color=colour, linewidth=1.2, markersize=4, label=label)
    if len(x) > 1:
        axes.fill_between(x, low, high, color=colour, alpha=0.15, lw=0)
    else:
        axes.vlines(x, low, high, color=colour, linewidth=1.0)


def draw_grounds(grounds: Sequence[tuple[str, str, Table | None]]) -> bytes:
    """Draw the success of stack 0 with and without identification, Wilson 95 %.

    Args:
        grounds: Twin, whether tared and identified in words, tries.
    """
    known = [(twin, word, table) for twin, word, table in grounds if table]
    figure = Figure(
        figsize=(6.4, 0.8 + 0.42 * len(known)), dpi=130, layout="constrained"
    )
    axes = figure.subplots()
    for y, (_, word, table) in enumerate(known):
        row = table.rows[-1]
        rate = 100.0 * row.successes / row.tries
        colour = _GROUND_COLOURS[word]
        axes.barh(y, rate, color=colour, height=0.6)
        ends = [100.0 * end for end in row.interval]
        axes.plot(ends, [y, y], color=_INK, linewidth=1.2)
        axes.text(103, y, f"{row.successes}/{row.tries}", va="center", fontsize=8)
    names = [f"twin {twin}, {word}" for twin, word, _ in known]
    axes.set_yticks(range(len(known)), names)
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("success [%]", fontsize=8)
    _plain(axes)
    return _png(figure)


def _plain(axes: Any) -> None:
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
