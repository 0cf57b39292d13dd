"""The figures of an identification as PNG: trajectories, convergence, intervals."""

import math
from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from dovetail.identify.uncertainty import Identifiability
from dovetail.types import Array

REAL = "#33302b"
SIMULATED = "#d1495b"
_FITTED = "#0b7a75"
_PALE = "#cfc8ba"


def draw_trajectories(
    measured: Sequence[Array],
    simulated: Sequence[Array],
    *,
    period: float,
    title: str,
    colour: str = SIMULATED,
) -> bytes:
    """Draw real and simulated TCP over time, the sequences one after the other.

    Args:
        measured: TCP of the arm [m], one array of shape (cycles, 3) per sequence.
        simulated: The same of the simulation.
        period: Time between two rows [s].
        title: Line above the figure.
        colour: Colour of the simulation.

    Returns:
        A PNG file: x, y, z [mm], and below them their distance [mm].
    """
    figure = Figure(figsize=(11.0, 7.4), dpi=130, layout="constrained")
    figure.suptitle(title, fontsize=11, color=REAL)
    rows = figure.subplots(4, 1, sharex=True, height_ratios=(1, 1, 1, 0.8))
    begin = 0.0
    for real, model in zip(measured, simulated, strict=True):
        time = begin + period * np.arange(len(real))
        for axes, a, b in zip(rows[:3], 1e3 * real.T, 1e3 * model.T, strict=True):
            axes.plot(time, a, color=REAL, linewidth=1.8, alpha=0.55)
            axes.plot(time, b, color=colour, linewidth=1.0)
        distance = 1e3 * np.linalg.norm(model - real, axis=1)
        rows[3].fill_between(time, distance, color=colour, alpha=0.35, linewidth=0)
        rows[3].plot(time, distance, color=colour, linewidth=0.8)
        begin += period * len(real)
        for axes in rows:
            axes.axvline(begin, color=_PALE, linewidth=0.8, zorder=0)
    for axes, name in zip(rows, ("x", "y", "z", "distance"), strict=True):
        axes.set_ylabel(f"{name} [mm]", fontsize=9)
        _tidy(axes)
    rows[3].set_ylim(bottom=0.0)
    rows[3].set_xlim(0.0, begin)
    rows[3].set_xlabel("time, sequences one after the other [s]", fontsize=9)
    rows[0].plot([], [], color=REAL, linewidth=1.8, alpha=0.55, label="measured")
    rows[0].plot([], [], color=colour, linewidth=1.0, label="simulated")
    rows[0].legend(loc="upper right", ncols=2, frameon=False, fontsize=8)
    return _png(figure)


def draw_after(
    measured: Sequence[Array], simulated: Sequence[Array], *, period: float, title: str
) -> bytes:
    """Draw the same as `draw_trajectories` in the colour of a fitted model."""
    return draw_trajectories(
        measured, simulated, period=period, title=title, colour=_FITTED
    )


def draw_convergence(history: Sequence[tuple[int, float]], before: float) -> bytes:
    """Draw the best error over the number of simulated logs.

    Args:
        history: Pairs of evaluations done and best error so far [m].
        before: Error of the model before the fit [m].

    Returns:
        A PNG file.
    """
    figure = Figure(figsize=(7.6, 3.0), dpi=130, layout="constrained")
    axes = figure.subplots()
    count, error = np.array(history, dtype=float).reshape(-1, 2).T
    axes.axhline(1e3 * before, color=SIMULATED, linewidth=1, linestyle="--")
    axes.step(count, 1e3 * error, where="post", color=_FITTED, linewidth=1.5)
    axes.set_yscale("log")
    for which in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        which("{x:.3g}")
    axes.set_xlabel("simulated logs", fontsize=9)
    axes.set_ylabel("best error [mm RMS]", fontsize=9)
    axes.set_title("dashed: before identification", fontsize=9, color=REAL)
    _tidy(axes)
    return _png(figure)


def draw_intervals(
    result: Identifiability, bounds: Sequence[tuple[float, float]]
) -> bytes:
    """Draw each value and its 95 % interval inside the range of the search.

    Args:
        result: Values and intervals.
        bounds: Bounds of the search, in the order of the estimates.

    Returns:
        A PNG file.
    """
    count = len(result.estimates)
    figure = Figure(figsize=(7.6, 0.9 + 0.26 * count), dpi=130, layout="constrained")
    axes = figure.subplots()
    for row, (estimate, (low, high)) in enumerate(
        zip(result.estimates, bounds, strict=True)
    ):
        value, *ends = (
            float(np.clip((v - low) / (high - low), 0.0, 1.0))
            if math.isfinite(v)
            else e
            for v, e in zip(
                (estimate.value, *estimate.uncertainty.interval), (0, 0, 1), strict=True
            )
        )
        colour = _FITTED if estimate.judgement.verdict == "known" else SIMULATED
        axes.plot((0, 1), (row, row), color=_PALE, linewidth=1, zorder=0)
        axes.plot(ends, (row, row), color=colour, linewidth=4, alpha=0.45)
        axes.plot(value, row, "o", color=colour, markersize=4)
        unit = "" if estimate.unit == "1" else f" {estimate.unit}"
        axes.text(-0.02, row, f"{low:g}", ha="right", va="center", fontsize=7)
        axes.text(1.02, row, f"{high:g}{unit}", ha="left", va="center", fontsize=7)
    axes.set_yticks(range(count), [e.name for e in result.estimates], fontsize=8)
    axes.set_ylim(count - 0.5, -0.5)
    axes.set_xlim(-0.1, 1.22)
    axes.set_xticks([])
    axes.spines[:].set_visible(False)
    axes.tick_params(left=False)
    return _png(figure)


def _tidy(axes: Any) -> None:
    axes.tick_params(which="both", labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
