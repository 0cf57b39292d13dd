"""Paths of a part over a fixture that was moved unseen: from above, time as colour."""

import math
from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from dovetail.evaluation.fixture_figure import INK, draw_from_above, figure_title
from dovetail.evaluation.outcome import Outcome
from dovetail.evaluation.report import Report
from dovetail.poses import matrix_from_quat
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.workcell.parts import Part

SHIFT = "fixture_shift [m]"
"""Key of the fixture's displacement [m] in `Conditions.perturbation`."""
_SHOWN = 6
"""Tries at each pose of the fixture: more would hide one another."""
_POINTS = 400


def draw_search(report: Report, poses: Sequence[FixturePose], fixture: Part) -> bytes:
    """Draw the first tries at each pose in the fixture's frame, seen from above.

    A cross is where the middle of the fixture was believed.

    Args:
        report: Its tries tell how far their fixture was moved.
        poses: Where the fixture was.
        fixture: In its own frame.

    Returns:
        A PNG file.
    """
    period = report.period
    figure = Figure(figsize=(3.4 * len(poses), 3.9), dpi=130, layout="constrained")
    figure.suptitle(figure_title(report.title, len(poses)), fontsize=10, color=INK)
    row = figure.subplots(1, len(poses), squeeze=False)[0]
    first = [o for o in report.outcomes if o.job.attempt < _SHOWN]
    shown = [o for o in first if len(o.course.path)]
    longest = max((period * len(o.course.path) for o in shown), default=1.0)
    shifts = (np.linalg.norm(o.conditions.perturbation[SHIFT]) for o in shown)
    side = 1e3 * max(float(np.abs(fixture.corners[:, :2]).max()), *shifts)
    draw_from_above(row, fixture)
    lines: Any = None
    for column, (axes, pose) in enumerate(zip(row, poses, strict=True)):
        turn = matrix_from_quat(pose.pose().quat_wxyz).T
        for outcome in (o for o in shown if o.job.pose == column):
            believed = -1e3 * (turn @ np.array(outcome.conditions.perturbation[SHIFT]))
            axes.plot(*believed[:2], "x", color=INK, markersize=5)
            lines = _draw_path(axes, outcome, period, longest)
        axes.set_xlim(-1.1 * side, 1.1 * side)
        axes.set_ylim(-1.1 * side, 1.1 * side)
        axes.set_aspect("equal")
        axes.set_title(f"pose {pose.name}", fontsize=9)
        axes.set_xlabel("x in the fixture's frame [mm]", fontsize=8)
        axes.tick_params(labelsize=7)
    row[0].set_ylabel("y [mm]", fontsize=8)
    if lines is not None:
        figure.colorbar(lines, ax=list(row), label="time [s]", shrink=0.8)
    buffer = BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def _draw_path(axes: Any, outcome: Outcome, period: float, longest: float) -> Any:
    path = outcome.course.path
    every = max(1, math.ceil(len(path) / _POINTS))
    points = 1e3 * path[::every, :2]
    pairs = np.stack([points[:-1], points[1:]], axis=1)
    lines = LineCollection(list(pairs), cmap="viridis", linewidths=0.9)
    lines.set_array(period * every * np.arange(len(pairs)))
    lines.set_clim(0.0, longest)
    axes.add_collection(lines)
    return lines
