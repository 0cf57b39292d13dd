"""The report of the experiments: HTML that needs nothing else, JSON, and PNG."""

import dataclasses
import json
import shlex
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dovetail.evaluation.origin import provenance
from dovetail.files import write_atomic
from dovetail.page import facts, figure, finite, page, table, text
from dovetail.reproduce import tables
from dovetail.reproduce.curves import curves
from dovetail.reproduce.figures import (
    WINDOW,
    draw_grounds,
    draw_robustness,
    draw_training,
)
from dovetail.reproduce.folder import REPORT as FIT_REPORT
from dovetail.reproduce.folder import SETTINGS, stage_folder
from dovetail.reproduce.plan import PlanConfig, Stage, fit_name
from dovetail.reproduce.results import Gathered, gather, seeds_of
from dovetail.reproduce.workflow import RunSummary
from dovetail.zoomable import NOTE

RESULTS, REPORT = "results.json", "report.html"
_TRAINING, _ROBUSTNESS, _GROUNDS = (
    "Training",
    "Robustness",
    "With and without identification",
)
_FILES = {
    _TRAINING: "training.png",
    _ROBUSTNESS: "robustness.png",
    _GROUNDS: "identified-or-not.png",
}
_FIT_FIGURES = {
    "before.png": "before identification, the log that was fitted",
    "after.png": "after identification, the log that was fitted",
    "held-out-before.png": "before identification, the held-out log",
    "held-out-after.png": "after identification, the held-out log",
}
"""The paper's two figures, on two logs; the others are in the fit's own report."""


def write_reproduction(
    root: Path, config: PlanConfig, stages: Sequence[Stage], tally: RunSummary
) -> list[Path]:
    """Write figures, JSON and HTML, the HTML last; what is missing is named.

    Args:
        root: Results folder.
        config: What decided the plan.
        stages: The plan.
        tally: What became of the stages.

    Returns:
        The files.

    Raises:
        LogError: The disk is full or the folder is not writable.
    """
    gathered = gather(root, config)
    figures = {
        _TRAINING: draw_training(gathered.curves),
        _ROBUSTNESS: draw_robustness(gathered.robustness),
        _GROUNDS: draw_grounds(gathered.grounds),
    }
    files = [write_atomic(root / _FILES[n], png) for n, png in figures.items()]
    where = _where(config)
    content = {
        "settings": dataclasses.asdict(config),
        "missing": {**tally.failed, **tally.left_out},
        **to_json(gathered),
        "provenance": where,
    }
    lines = json.dumps(finite(content), indent=2, allow_nan=False) + "\n"
    files.append(write_atomic(root / RESULTS, lines))
    title = f"The paper's experiments on twin {config.twins[0]}: {config.budget.name}"
    parts = [
        f"<h1>{text(title)}</h1>",
        *_lead(config, tally, len(stages)),
        *_transfer(gathered, config),
        *_training(gathered, figures, seeds_of(config)),
        *_grounds(gathered, figures),
        *_identification(root, gathered, config),
        *_robustness(gathered, figures),
        _heading("Make it again"),
        f"<pre>{text(command_line(config))}</pre>",
        *facts("Where this was measured", where),
    ]
    return [*files, write_atomic(root / REPORT, page(title, parts))]


def command_line(config: PlanConfig) -> str:
    """Return the command that does it again."""
    words = ["dovetail", "reproduce", "--budget", config.budget.name]
    words += ["--twins", *config.twins, "--plant", config.plant]
    words += ["--parameters", config.parameters, "--seed", str(config.seed)]
    return shlex.join([*words, "--out", "reproduction-again"])


def to_json(gathered: Gathered) -> dict[str, Any]:
    """Return every number of the report."""
    return {
        "transfer": [
            {"paper_on_a_robot": paper._asdict(), "ours_on_a_twin": _plain(ours)}
            for paper, ours in gathered.transfer
        ],
        "other_direction": _plain(gathered.other_direction),
        "with_and_without_identification": [
            {"twin": twin, "identification": word, "stack_0": _plain(ours)}
            for twin, word, ours in gathered.grounds
        ],
        "robustness": [
            {"variant": variant, "what": what, "level": level, "tries": _plain(ours)}
            for (variant, what), levels in gathered.robustness.items()
            for level, ours in levels
        ],
        "trainings": [training._asdict() for training in gathered.trainings],
        "identification": [
            {"twin": twin, "parameters": parameters, **fit}
            for (twin, parameters), fit in gathered.fits.items()
        ],
    }


def _where(config: PlanConfig) -> dict[str, Any]:
    """Return what the numbers depend on besides the settings, and where those are."""
    found = provenance(datetime.now(UTC))
    del found["duration [s]"]
    found["reported (UTC)"] = found.pop("started (UTC)")
    return {
        "budget": config.budget.name,
        "trained in": config.plant,
        "identified in": config.identify_plant,
        "all settings": SETTINGS,
        **found,
    }


def _lead(config: PlanConfig, tally: RunSummary, total: int) -> list[str]:
    engine = "PyBullet" if config.plant == "bullet" else "MuJoCo"
    twin = config.twins[0]
    parts = [
        _lead_line(
            f"Budget {config.budget.name}; policies trained in {engine}, tried on twin "
            f"{twin}. A twin is a simulation that stands in for the robot: nothing "
            "here has run on a robot. The paper's figures are its own, on an LBR iiwa."
        )
    ]
    if config.budget.name == "smoke":
        parts.append(
            _warning(
                "Budget smoke runs every part once and learns nothing: its success "
                "rates mean nothing."
            )
        )
    if config.plant == "mujoco":
        parts.append(
            _warning(
                "Trained in MuJoCo: a twin that runs in MuJoCo shares the engine with "
                "the training, so that its contacts are no test of transfer. The "
                "paper's direction, from PyBullet to another engine, needs the extra "
                "'bullet', on Python 3.11."
            )
        )
    lost = dict(tally.failed)
    lost |= {n: f"left out, it needs {c}" for n, c in tally.left_out.items()}
    if lost:
        parts.append(_warning(f"{len(lost)} of {total} stages are missing:"))
        parts.append(table(("stage", "why"), list(lost.items())))
    return parts


def _transfer(gathered: Gathered, config: PlanConfig) -> list[str]:
    parts = [
        _heading("Transfer"),
        tables.transfer_table(gathered.transfer, tables.poses_of(gathered)),
        _note(
            "Successes of tries with the Wilson 95 % interval, pooled over the "
            "training seeds; tries of one policy are not independent of each other, so "
            "that the interval is too narrow where seeds differ. All were trained with "
            "the square peg: stack 0 and 4 in the identified simulation, randomised "
            "policies about the nominal one. Steps are policy steps of 50 ms. Force "
            "mean: over the control cycles in contact; peak: the largest of a try, its "
            "95th percentile and maximum over the tries. Limits broken: control cycles "
            "in which a measured value lay outside its limit."
        ),
    ]
    if (other := gathered.other_direction) is not None:
        total = other.rows[-1]
        line = [f"{other.label} ({other.ground})", tables.rate(total)]
        heads = ("the other direction", "twin, all", *tables.DETAILS)
        parts.append(table(heads, [[*line, *tables.details(total)]]))
    if len(seeds_of(config)) > 1:
        rows = [(paper.label, ours) for paper, ours in gathered.transfer]
        parts.append(_heading("Seed by seed"))
        parts.append(tables.seed_table(rows, seeds_of(config)))
    return parts


def _training(
    gathered: Gathered, figures: Mapping[str, bytes], seeds: Sequence[int]
) -> list[str]:
    parts = [
        figure(_TRAINING, figures[_TRAINING]),
        _note(
            f"Moving average over {WINDOW} episodes, with exploration noise; shaded: "
            "standard deviation over the seeds, where there are several."
        ),
        tables.training_table(gathered.trainings),
    ]
    if any(run for runs in gathered.curves.values() for run in runs):
        parts.append(_heading("Look closer: training"))
        parts += [curves(gathered.curves, seeds), _note(NOTE)]
    return parts


def _grounds(gathered: Gathered, figures: Mapping[str, bytes]) -> list[str]:
    return [
        figure(_GROUNDS, figures[_GROUNDS]),
        tables.grounds_table(gathered.grounds),
    ]


def _identification(root: Path, gathered: Gathered, config: PlanConfig) -> list[str]:
    parts = [
        _heading("Identification"),
        tables.fit_table(gathered.fits),
        _note(
            "Root mean square of the distance between the tool's recorded and "
            "simulated positions. The trainings use the models of set "
            f"'{config.parameters}'; each fit has a report of its own in its stage."
        ),
    ]
    for twin in config.twins:
        stage = f"report-{fit_name(twin, config.parameters)}"
        for name, words in _FIT_FIGURES.items():
            file = stage_folder(root, stage) / FIT_REPORT / name
            if file.is_file():
                parts.append(figure(f"Twin {twin}, {words}", file.read_bytes()))
    return parts


def _robustness(gathered: Gathered, figures: Mapping[str, bytes]) -> list[str]:
    return [
        figure(_ROBUSTNESS, figures[_ROBUSTNESS]),
        tables.robustness_table(gathered.robustness),
    ]


def _plain(value: Any) -> Any:
    return None if value is None else dataclasses.asdict(value)


def _heading(words: str) -> str:
    return f"<h2>{text(words)}</h2>"


def _lead_line(words: str) -> str:
    return f'<p class="lead">{text(words)}</p>'


def _warning(words: str) -> str:
    return f'<p class="lead"><b>{text(words)}</b></p>'


def _note(words: str) -> str:
    return f'<p class="note">{text(words)}</p>'
