"""The report of the experiments: HTML that needs nothing else, JSON, and PNG."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dovetail.evaluate.evaluation import provenance
from dovetail.files import write_atomic
from dovetail.reproduce import page, tables
from dovetail.reproduce.figures import (
    WINDOW,
    draw_grounds,
    draw_robustness,
    draw_training,
)
from dovetail.reproduce.plan import PlanConfig, fit_name
from dovetail.reproduce.results import Gathered, gather, seeds_of
from dovetail.reproduce.schedule import Tally
from dovetail.reproduce.stage import Stage, stage_folder

RESULTS, REPORT = "results.json", "report.html"


def write_reproduction(
    root: Path, config: PlanConfig, stages: Sequence[Stage], tally: Tally
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
        "training.png": draw_training(gathered.curves),
        "robustness.png": draw_robustness(gathered.robustness),
        "identified-or-not.png": draw_grounds(gathered.grounds),
    }
    files = [write_atomic(root / name, png) for name, png in figures.items()]
    facts = provenance_of(root, config)
    content = {
        "settings": {**dataclasses.asdict(config), "twins": list(config.twins)},
        "missing": {**tally.failed, **tally.left_out},
        **to_json(gathered),
        "provenance": facts,
    }
    text = json.dumps(_finite(content), indent=2, allow_nan=False) + "\n"
    files.append(write_atomic(root / RESULTS, text))
    parts = [
        *_lead(config, tally, len(stages)),
        *_transfer(gathered, config, figures),
        *_identification(root, gathered, config, figures),
        *_robustness(gathered, figures),
        page.heading("Make it again"),
        page.Html(f"<pre>{page.text(command_line(config))}</pre>"),
        tables.facts_table(facts),
    ]
    title = f"The paper's experiments on twin {config.twins[0]}: {config.budget.name}"
    files.append(write_atomic(root / REPORT, page.page(title, parts)))
    return files


def command_line(config: PlanConfig) -> str:
    """Return the command that does it again."""
    words = ["dovetail reproduce", "--budget", config.budget.name]
    words += ["--twins", *config.twins, "--plant", config.plant]
    words += ["--parameters", config.parameters, "--seed", str(config.seed)]
    return " ".join([*words, "--out", "reproduction-again"])


def provenance_of(root: Path, config: PlanConfig) -> dict[str, Any]:
    """Return versions, commit and machine, and the settings in words."""
    from datetime import UTC, datetime

    facts = provenance(datetime.now(UTC))
    facts.pop("duration [s]")
    facts["reported (UTC)"] = facts.pop("started (UTC)")
    return {
        "budget": config.budget.name,
        "trained in": config.plant,
        "identified in": config.identify_plant,
        "settings": str(root / "reproduce.json"),
        **facts,
    }


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


def _lead(config: PlanConfig, tally: Tally, total: int) -> list[str]:
    twin = config.twins[0]
    engine = "PyBullet" if config.plant == "bullet" else "MuJoCo"
    words = (
        f"Budget {config.budget.name}; policies trained in {engine}, tried on twin "
        f"{twin}. "
        "A twin is a simulation that stands in for the robot; nothing here has run on "
        "a robot. The paper's figures are its own, on a real LBR iiwa."
    )
    parts = [page.paragraph(words)]
    if config.budget.name == "smoke":
        parts.append(
            page.paragraph(
                "Budget smoke runs every part once and learns nothing: its success "
                "rates mean nothing.",
                "missing",
            )
        )
    if config.plant == "mujoco":
        parts.append(
            page.paragraph(
                "Trained in MuJoCo: a twin that runs in MuJoCo shares the engine with "
                "the training, so that contact is no test of transfer here. The "
                "paper's direction, PyBullet to another engine, needs the extra 'bullet' "
                "(CPython 3.11).",
                "missing",
            )
        )
    lost = {**tally.failed}
    lost |= {n: f"left out, it needs {c}" for n, c in tally.left_out.items()}
    if lost:
        parts += [
            page.paragraph(f"{len(lost)} of {total} stages are missing:", "missing"),
            page.bullet_list([f"{n}: {why}" for n, why in lost.items()], "missing"),
        ]
    return parts


def _transfer(
    gathered: Gathered, config: PlanConfig, figures: Mapping[str, bytes]
) -> list[str]:
    seeds = seeds_of(config)
    rows = [(paper.label, ours) for paper, ours in gathered.transfer]
    parts = [
        page.heading("Transfer"),
        tables.transfer_table(gathered.transfer, tables.poses_of(gathered)),
        page.paragraph(
            "Successes of tries with the Wilson 95 % interval, pooled over the "
            "training seeds (tries of one policy are not independent of each other: "
            "where seeds differ, the interval is too narrow). All were trained with "
            "the square peg. "
            "Stack 0 and 4 were trained in the identified simulation; randomised "
            "policies in the nominal one. Steps are policy steps of 50 ms; force "
            "mean: over the control cycles in contact; peak: the largest of a try, its 95th "
            "percentile and maximum over the tries. Limits broken: control cycles in "
            "which a measured value lay outside its limit.",
            "note",
        ),
    ]
    if gathered.other_direction is not None:
        other = gathered.other_direction
        inserted = page.Html(tables.rate(other.rows[-1]))
        line = [f"{other.label}: {other.ground}", inserted]
        line += tables.details(other.rows[-1])
        parts.append(page.table([], [line]))
    if len(seeds) > 1:
        parts += [page.heading("Seed by seed"), tables.seed_table(rows, seeds)]
    return [
        *parts,
        page.heading("Training"),
        page.figure(figures["training.png"], "success and reward over training steps"),
        page.paragraph(
            f"Moving average over {WINDOW} episodes with exploration noise; shaded: "
            "standard deviation over the seeds, where there are several.",
            "note",
        ),
        tables.training_table(gathered.trainings),
    ]


def _identification(
    root: Path, gathered: Gathered, config: PlanConfig, figures: Mapping[str, bytes]
) -> list[str]:
    parts = [
        page.heading("With and without identification"),
        page.figure(figures["identified-or-not.png"], "success of stack 0"),
        tables.grounds_table(gathered.grounds),
        page.heading("Identification"),
        tables.fit_table(gathered.fits),
        page.paragraph(
            "Root mean square of the distance between the tool's recorded and "
            f"simulated positions. The trainings use the models of set '{config.parameters}'.",
            "note",
        ),
    ]
    for twin in config.twins:
        folder = stage_folder(root, f"report-{fit_name(twin, config.parameters)}")
        for file in sorted((folder / "report").glob("*.png")):
            label = f"twin {twin}: {file.stem.replace('-', ' ').replace('_', ' ')}"
            parts += [page.paragraph(label), page.figure(file.read_bytes(), label)]
    return parts


def _robustness(gathered: Gathered, figures: Mapping[str, bytes]) -> list[str]:
    return [
        page.heading("Robustness"),
        page.figure(figures["robustness.png"], "success over the size of disturbances"),
        tables.robustness_table(gathered.robustness),
    ]


def _plain(value: Any) -> Any:
    return None if value is None else dataclasses.asdict(value)


def _finite(value: Any) -> Any:
    """Replace numbers that JSON cannot write by null, at any depth."""
    if isinstance(value, Mapping):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)
