"""The figures of the experiments as PNG: training, transfer, learners, robustness."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from dovetail.learn.progress import EpisodeRow
from dovetail.reproduce.design import LAWS, MODELS
from dovetail.reproduce.results import Cell, Learned, Level
from dovetail.types import Array

WINDOW = 10
"""Episodes of the moving average, as in the paper."""
_GRID = 300
COLOURS = {
    "nominal": "#8a8378",
    "randomised": "#5c6bc0",
    "identified-paper": "#7fb8b4",
    "identified": "#0b7a75",
    "identified-randomised": "#d1495b",
    "truth": "#e0a030",
}
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


def draw_training(
    curves: Mapping[tuple[str, str], Sequence[Sequence[EpisodeRow]]],
) -> bytes:
    """Draw success over the training steps, a panel for each law.

    Lines are means over the policies, shaded is their standard deviation.

    Args:
        curves: Episodes of each policy, by law and model.
    """
    figure = Figure(figsize=(10.0, 3.6), dpi=130, layout="constrained")
    panels = figure.subplots(1, len(LAWS), sharey=True)
    for axes, (law, facts) in zip(panels, LAWS.items(), strict=True):
        for model, colour in COLOURS.items():
            _draw_curve(axes, curves.get((law, model), ()), MODELS[model].label, colour)
        axes.set_title(facts.label, fontsize=9)
        axes.set_xlabel("environment steps", fontsize=8)
        _plain(axes)
    _share_axis(panels)
    return _png(figure)


def draw_learners(learners: Sequence[Learned]) -> bytes:
    """Draw success over the training steps of each learning algorithm."""
    figure = Figure(figsize=(6.4, 3.6), dpi=130, layout="constrained")
    axes = figure.subplots()
    for found, colour in zip(learners, COLOURS.values(), strict=False):
        _draw_curve(axes, found.runs, found.label, colour)
    axes.set_xlabel("environment steps", fontsize=8)
    _plain(axes)
    _share_axis([axes])
    return _png(figure)


def _draw_curve(
    axes: Any, runs: Sequence[Sequence[EpisodeRow]], label: str, colour: str
) -> None:
    if not any(runs):
        return
    grid, lines = curve(runs, "success")
    mean, spread = 100.0 * lines.mean(axis=0), 100.0 * lines.std(axis=0)
    axes.plot(grid, mean, color=colour, linewidth=1.2, label=f"{label} ({len(lines)})")
    if len(lines) > 1:
        low, high = mean - spread, mean + spread
        axes.fill_between(grid, low, high, color=colour, alpha=0.15, lw=0)


def _share_axis(panels: Sequence[Any]) -> None:
    panels[0].set_ylabel("success [%]", fontsize=8)
    panels[0].set_ylim(-3, 103)
    if panels[0].lines:
        panels[0].legend(frameon=False, fontsize=7)


def draw_transfer(cells: Sequence[Cell]) -> bytes:
    """Draw the success on every twin, a dot each, and the mean, by law and model."""
    shown = [c for c in cells if (c.trained_in, c.tried_in) == ("mujoco", "mujoco")]
    figure = Figure(figsize=(10.0, 3.2), dpi=130, layout="constrained")
    panels = figure.subplots(1, len(LAWS), sharey=True)
    random = np.random.default_rng(0)
    for axes, (law, facts) in zip(panels, LAWS.items(), strict=True):
        for y, (model, colour) in enumerate(COLOURS.items()):
            for cell in shown:
                if (cell.law, cell.model) != (law, model) or not cell.tries:
                    continue
                values = cell.measures["success"].values
                known = values[:, ~np.isnan(values).all(axis=0)]
                rates = 100.0 * np.nanmean(known, axis=0)
                aside = y + random.uniform(-0.18, 0.18, len(rates))
                axes.scatter(rates, aside, s=9, color=colour, alpha=0.5, lw=0)
                axes.plot([rates.mean()] * 2, [y - 0.35, y + 0.35], color=colour)
        axes.set_title(facts.label, fontsize=9)
        axes.set_xlabel("success on a twin [%]", fontsize=8)
        axes.set_xlim(-3, 103)
        _plain(axes)
    names = [MODELS[model].label for model in COLOURS]
    panels[0].set_yticks(range(len(names)), names)
    panels[0].invert_yaxis()
    return _png(figure)


def draw_robustness(levels: Sequence[Level]) -> bytes:
    """Draw success over the size of each disturbance, with Wilson 95 % bands."""
    figure = Figure(figsize=(10.0, 3.2), dpi=130, layout="constrained")
    panels = figure.subplots(1, len(_AXES), sharey=True)
    for axes, (kinds, (name, factor)) in zip(panels, _AXES.items(), strict=True):
        for kind in kinds:
            known = [(le.level, le.tries) for le in levels if le.what == kind]
            tries = [(factor * x, t.row) for x, t in known if t is not None]
            if not tries:
                continue
            is_script = kind == "search"
            colour = COLOURS["randomised" if is_script else "identified"]
            x = [level for level, _ in tries]
            rates = [100.0 * row.successes / row.tries for _, row in tries]
            low = [
                rates[i] - 100.0 * row.interval.low for i, (_, row) in enumerate(tries)
            ]
            high = [
                100.0 * row.interval.high - rates[i] for i, (_, row) in enumerate(tries)
            ]
            label = "the scripted search" if is_script else "the policy"
            line = {"color": colour, "linewidth": 1.2, "markersize": 4, "label": label}
            axes.errorbar(
                x, rates, [low, high], fmt="o--" if is_script else "o-", **line
            )
        axes.set_xlabel(name, fontsize=8)
        _plain(axes)
    panels[0].set_ylabel("success [%]", fontsize=8)
    panels[0].set_ylim(-3, 103)
    if panels[0].lines:
        panels[0].legend(frameon=False, fontsize=8)
    return _png(figure)


def _plain(axes: Any) -> None:
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
