"""The tables of the report: our numbers, and the paper's beside them."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from dovetail.evaluation.transfer import Row
from dovetail.page import table
from dovetail.reproduce.paper import ROBUSTNESS, PaperRow
from dovetail.reproduce.plan import ON_TWIN, OTHER, UNIDENTIFIED, VARIANTS
from dovetail.reproduce.results import Gathered, Level, Table, Training

MISSING = "not run"
_FORCES = ("steps median / max", "force mean [N]", "peak p95 [N]", "peak max [N]")
DETAILS = (*_FORCES, "limits broken")
"""Headings of `details`."""
_DISTURBANCES = {
    "shift": ("hole moved while the camera is covered", "mm", 1e3),
    "search": ("the same, searching,", "mm", 1e3),
    "push": ("random pushes up to", "N", 1.0),
    "speed": ("hole moving at", "mm/s", 1e3),
    "below": ("every start below the block's surface", "", 1.0),
}


def format_time(seconds: float) -> str:
    """Return a duration as 45 s, 12:05 min or 3:07 h."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60}:{whole % 60:02d} min"
    return f"{whole // 3600}:{whole % 3600 // 60:02d} h"


def rate(row: Row) -> str:
    """Return successes of tries with the Wilson interval."""
    low, high = row.interval
    return f"{row.successes}/{row.tries} ({100 * low:.0f}-{100 * high:.0f} %)"


def details(row: Row) -> list[str]:
    """Return steps, forces and limits of a row, one cell per heading."""
    steps = "none"
    if not math.isnan(row.steps.median):
        steps = f"{row.steps.median:.0f} / {row.steps.max:.0f}"
    forces = (row.force.mean, row.force.peak_p95, row.force.peak)
    cells = ["-" if math.isnan(force) else f"{force:.1f}" for force in forces]
    return [steps, *cells, str(row.violations)]


def transfer_table(
    rows: Sequence[tuple[PaperRow, Table | None]], poses: Sequence[str]
) -> str:
    """Return the transfer table, seven rows; the paper's cells are on a robot."""
    heads = ["policy", "paper, robot", *(f"twin, pose {p}" for p in poses), "twin, all"]
    lines = []
    for paper, ours in rows:
        line: list[object] = [paper.label, " ".join(paper.cells)]
        if ours is None:
            lines.append([*line, *[MISSING] * (len(poses) + 1 + len(DETAILS))])
            continue
        cells: list[object] = [rate(row) for row in ours.rows[:-1]]
        cells += [""] * (len(poses) - len(cells))
        total = ours.rows[-1]
        lines.append([*line, *cells, rate(total), *details(total)])
    return table([*heads, *DETAILS], lines)


def seed_table(rows: Iterable[tuple[str, Table | None]], seeds: Sequence[int]) -> str:
    """Return each training seed's successes, which the other tables pool."""
    lines = [
        [label, *(ours.by_seed.get(seed, "") for seed in seeds)]
        for label, ours in rows
        if ours is not None
    ]
    return table(["policy", *(f"seed {seed}" for seed in seeds)], lines)


def grounds_table(grounds: Sequence[tuple[str, str, Table | None]]) -> str:
    """Return the tries of stack 0 with and without identification."""
    lines = []
    for twin, word, ours in grounds:
        line: list[object] = [f"twin {twin}, {word}"]
        if ours is None:
            lines.append([*line, *[MISSING] * (1 + len(DETAILS))])
        else:
            total = ours.rows[-1]
            lines.append([*line, rate(total), *details(total)])
    return table(["stack 0", "inserted", *DETAILS], lines)


def robustness_table(robustness: Mapping[tuple[str, str], Sequence[Level]]) -> str:
    """Return the tries at every level of every disturbance."""
    lines = []
    for (variant, what), levels in robustness.items():
        words, unit, factor = _DISTURBANCES[what]
        for level, ours in levels:
            size = "" if what == "below" else f" {factor * level:g} {unit}"
            line: list[object] = [f"{VARIANTS[variant]}, {words}{size}"]
            line.append(ROBUSTNESS[what])
            if ours is None:
                lines.append([*line, *[MISSING] * (1 + len(DETAILS))])
            else:
                total = ours.rows[-1]
                lines.append([*line, rate(total), *details(total)])
    return table(["disturbance", "paper, robot", "twin", *DETAILS], lines)


def name_variant(variant: str) -> str:
    """Return how the report calls a trained variant."""
    names = {
        **VARIANTS,
        UNIDENTIFIED: "stack 0, without identification",
        ON_TWIN: "on the twin itself, over FRI, one pose",
        OTHER: "stack 0, in MuJoCo",
    }
    if variant in names:
        return names[variant]
    return f"stack 0, for twin {variant.removeprefix('identified-')}"


def training_table(trainings: Iterable[Training]) -> str:
    """Return steps, time and final success of each training."""
    lines = []
    for training in trainings:
        found = training.evaluation
        inserted = "-" if not found else f"{found['successes']}/{found['episodes']}"
        lines.append(
            [
                name_variant(training.variant),
                training.seed,
                f"{training.steps:,}",
                format_time(training.wall_time),
                inserted,
            ]
        )
    heads = ["training", "seed", "steps", "time", "inserted where it was trained"]
    return table(heads, lines)


def fit_table(fits: Mapping[tuple[str, str], dict[str, Any]]) -> str:
    """Return error before and after, and cost, of each identification."""
    lines = []
    for (twin, parameters), fit in fits.items():
        judged = fit["judged"]
        held = ["-", "-"]
        if judged is not None:
            numbers = judged["errors_m"]["held-out log"]
            held = [f"{1e3 * numbers[k]:.2f}" for k in ("rms_before", "rms_after")]
        lines.append(
            [
                f"twin {twin}, {parameters}",
                *(f"{fit[k]:.2f}" for k in ("rms_before_mm", "rms_after_mm")),
                *held,
                fit["evaluations"],
                format_time(fit["wall_time_s"]),
                "-" if judged is None else judged["verdict"]["answer"],
            ]
        )
    heads = (
        *("log, parameters", "fitted, before [mm]", "fitted, after [mm]"),
        *("held out, before [mm]", "held out, after [mm]"),
        *("simulations", "time", "verdict"),
    )
    return table(heads, lines)


def poses_of(gathered: Gathered) -> list[str]:
    """Return the names of the hole poses: the longest list of any row."""
    lists = [
        [row.label for row in ours.rows[:-1]]
        for _, ours in gathered.transfer
        if ours is not None
    ]
    return max(lists, key=len, default=["A", "B", "C"])
