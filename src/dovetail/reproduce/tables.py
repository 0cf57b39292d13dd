"""The tables of the report: our numbers, and the paper's beside them."""

import math
import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dovetail.evaluation.transfer import Row
from dovetail.reproduce.design import ENGINES, LAWS, MODELS
from dovetail.reproduce.hypotheses import Answer, amount
from dovetail.reproduce.paper import ROBUSTNESS
from dovetail.reproduce.results import Cell, Gathered, Learned, Tries
from dovetail.reproduce.workflow import format_time

MISSING = "not run"
_DISTURBANCES = {
    "shift": ("hole moved while the camera is covered", "mm", 1e3),
    "search": ("the same, the scripted search in its place,", "mm", 1e3),
    "push": ("random pushes up to", "N", 1.0),
    "speed": ("hole moving at", "mm/s", 1e3),
    "below": ("every start below the block's surface", "", 1.0),
}


class Tabular(NamedTuple):
    """A table with a heading, and a note below it."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[object]]
    note: str = ""

    def markdown(self) -> str:
        """Return it as Markdown."""
        lines = [self.heads, ["---"] * len(self.heads), *self.rows]
        table = "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
        note = textwrap.fill(self.note, 100)
        return "\n\n".join(filter(None, (f"### {self.title}", table, note)))


def rate(row: Row) -> str:
    """Return successes of tries with the Wilson interval."""
    low, high = row.interval
    return f"{row.successes}/{row.tries} ({100 * low:.0f} to {100 * high:.0f} %)"


def answer_table(answers: Sequence[Answer]) -> Tabular:
    """Return the difference behind each question and the answer, law by law."""
    asked = dict.fromkeys(found.hypothesis.question for found in answers)
    rows = [
        [
            question,
            found.hypothesis.by,
            found.hypothesis.law,
            amount(found.effect, found.hypothesis.measure),
            found.verdict,
        ]
        for question in asked
        for found in answers
        if found.hypothesis.question == question
    ]
    heads = ("question", "claim of", "law", "difference (95 %)", "answer")
    return Tabular("Answers", heads, rows)


def cell_table(gathered: Gathered, law: str) -> Tabular:
    """Return a law's cells: success, spread over the twins, time, force, training."""
    rows = [
        _cell_row(cell) for cell in gathered.cells if cell.law == law and cell.tries
    ]
    heads = (
        *("trained in", "engines", "inserted", "worst to best twin"),
        *("5 to 95 %", "time [s]", "peak force [N]"),
        *("own simulation", "steps to 90 %", "limits broken", "stopped"),
    )
    if law == "tared" and gathered.script is not None:
        row, script = gathered.script.row, ["scripted search", "MuJoCo"]
        rate_ = f"{100 * row.successes / row.tries:.1f} % of {row.tries}"
        steps = f"{0.05 * row.steps.median:.2f} (median)"
        peak = f"{row.force.peak_p95:.0f} (p95)"
        limits = (row.violations, gathered.script.stopped)
        rows.append([*script, rate_, "", "", steps, peak, "", "", *limits])
    label = LAWS[law].label
    return Tabular(label[0].upper() + label[1:], heads, rows)


def _cell_row(cell: Cell) -> list[object]:
    found = cell.measures
    by_twin = _by_twin(cell)
    share = np.mean((by_twin >= 0.05) & (by_twin <= 0.95)) if by_twin.size else math.nan
    engines = ENGINES[cell.trained_in], ENGINES[cell.tried_in]
    return [
        MODELS[cell.model].label,
        engines[0] if len(set(engines)) == 1 else " to ".join(engines),
        f"{100 * found['success'].mean:.1f} % of {cell.tries}",
        f"{100 * by_twin.min():.0f} to {100 * by_twin.max():.0f} %",
        f"{100 * share:.0f} %",
        f"{0.05 * found['time'].mean:.2f}",
        f"{found['force'].mean:.1f}",
        f"{100 * found['own'].mean:.1f} %",
        f"{found['steps'].mean:,.0f}",
        cell.violations,
        cell.stopped,
    ]


def _by_twin(cell: Cell) -> Any:
    """Return the success on each twin, of all its policies."""
    values = cell.measures["success"].values
    known = values[:, ~np.isnan(values).all(axis=0)]
    return np.nanmean(known, axis=0)


def paper_table(gathered: Gathered) -> Tabular:
    """Return the paper's transfer table, seven rows; its cells are on a robot."""
    poses = max(
        ([row.label for row in t.poses] for _, t in gathered.paper if t is not None),
        key=len,
        default=["A", "B", "C"],
    )
    rows = []
    for paper, ours in gathered.paper:
        line: list[object] = [paper.label, " ".join(paper.cells)]
        if ours is None:
            rows.append([*line, *[MISSING] * (len(poses) + 3)])
            continue
        cells: list[object] = [f"{r.successes}/{r.tries}" for r in ours.poses]
        cells += [""] * (len(poses) - len(cells))
        rows.append([*line, *cells, rate(ours.row), *_speed(ours)])
    heads = ["policy", "paper, robot", *(f"hole {p}" for p in poses), "all"]
    note = (
        "The paper's cells are of a robot, ours of twins, with the paper's law and no "
        "tare: one identified policy for each twin. The last row is tried on "
        "one twin alone, where it was trained."
    )
    return Tabular("The paper's table", [*heads, *_SPEED], rows, note)


_SPEED = ("steps median / max", "peak p95 [N]")


def _speed(tries: Tries) -> list[object]:
    row = tries.row
    steps = "none"
    if not math.isnan(row.steps.median):
        steps = f"{row.steps.median:.0f} / {row.steps.max:.0f}"
    return [steps, f"{row.force.peak_p95:.0f}"]


def clip_table(gathered: Gathered) -> Tabular:
    """Return the paper's second task on the twins."""
    rows: list[list[object]] = []
    if found := [tries.row for tries in gathered.clip]:
        shares = [row.successes / row.tries for row in found]
        done, count = sum(r.successes for r in found), sum(r.tries for r in found)
        medians = [row.steps.median for row in found]
        rows = [
            [
                f"{done}/{count}",
                f"{100 * min(shares):.0f} to {100 * max(shares):.0f} %",
                f"{0.05 * float(np.nanmedian(medians)):.2f}",
                f"{max(row.force.peak_p95 for row in found):.0f}",
                sum(row.violations for row in found),
                sum(tries.stopped for tries in gathered.clip),
            ]
        ]
    heads = ("snapped on", "worst to best twin", "time [s], median")
    more = ("peak p95 [N], worst twin", "limits broken", "stopped")
    note = (
        "The paper's second task: one policy of the default settings, trained in the "
        "nominal simulation with our law and a tare, on every twin."
    )
    return Tabular("The rail clip", (*heads, *more), rows, note)


def learner_table(learners: Sequence[Learned]) -> Tabular:
    """Return steps and seconds until each algorithm had learned."""
    rows = [
        [
            found.label,
            len(found.steps),
            sum(not math.isnan(steps) for steps in found.steps),
            _spread(found.steps, "{:,.0f}"),
            _spread(found.seconds, "{:.0f}"),
            f"{100 * np.mean(found.own):.1f} %",
        ]
        for found in learners
        if found.steps
    ]
    heads = ("algorithm", "seeds", "that learned", "steps to 90 %, median (range)")
    return Tabular(
        "Learning algorithms", (*heads, "seconds", "inserted at the end"), rows
    )


def _spread(values: Sequence[float], form: str) -> str:
    known = [value for value in values if not math.isnan(value)]
    if not known:
        return "never"
    middle, low, high = np.median(known), min(known), max(known)
    return " ".join(
        (form.format(middle), f"({form.format(low)} to {form.format(high)})")
    )


def arm_table(gathered: Gathered) -> Tabular:
    """Return the trainings on the arm: before, after, and its time."""
    rows = []
    for found in gathered.arm:
        line: list[object] = [found.label]
        for tries in (found.before, found.after):
            if tries is None:
                line += ["", ""]
            else:
                row = tries.row
                line += [f"{row.successes}/{row.tries}", f"{row.force.peak_p95:.0f}"]
        limits = sum(t.row.violations for t in (found.before, found.after) if t)
        rows.append([*line, f"{found.steps:,}", f"{found.minutes:.1f}", limits])
    heads = ("policy", "before", "peak p95 [N]", "after", "peak p95 [N]")
    return Tabular(
        "Trained on the arm, over FRI",
        (*heads, "steps", "robot time [min]", "limits broken"),
        rows,
        "On twin medium, at one hole pose.",
    )


def robustness_table(gathered: Gathered) -> Tabular:
    """Return the tries at every level of every disturbance."""
    rows = []
    for what, level, tries in gathered.robustness:
        words, unit, factor = _DISTURBANCES[what]
        size = "" if what == "below" else f" {factor * level:g} {unit}"
        line: list[object] = [f"{words}{size}", ROBUSTNESS[what]]
        if tries is None:
            rows.append([*line, *[MISSING] * 4])
        else:
            limits = tries.row.violations
            rows.append([*line, rate(tries.row), *_speed(tries), limits])
    heads = ("disturbance", "paper, robot", "inserted", *_SPEED, "limits broken")
    return Tabular(
        "Robustness",
        heads,
        rows,
        "The first twin and its identified policy, with our law and a tare.",
    )


def fit_table(gathered: Gathered) -> Tabular:
    """Return error before and after, and cost, of the identifications."""
    rows = []
    for parameters, fits in gathered.fits.items():
        if not fits:
            continue
        judged = [
            fit["judged"]["errors_m"]["held-out log"] for fit in fits if fit["judged"]
        ]
        before = [1e3 * errors["rms_before"] for errors in judged]
        after = [1e3 * errors["rms_after"] for errors in judged]
        seconds = float(np.median([fit["wall_time_s"] for fit in fits]))
        simulations = float(np.median([fit["evaluations"] for fit in fits]))
        rows.append(
            [
                parameters,
                len(fits),
                _spread(before, "{:.1f}"),
                _spread(after, "{:.2f}"),
                f"{simulations:.0f}",
                format_time(seconds),
            ]
        )
    heads = ("parameters", "twins", "held out, before [mm RMS], median (range)")
    more = ("held out, after [mm RMS]", "simulated logs", "time")
    return Tabular("Identification", (*heads, *more), rows)
