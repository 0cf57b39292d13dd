"""The report of the experiments: HTML that needs nothing else, Markdown, JSON, PNG."""

import dataclasses
import hashlib
import json
import shlex
import textwrap
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

from dovetail.evaluation.origin import provenance
from dovetail.files import write_atomic
from dovetail.page import facts, figure, finite, page, table, text
from dovetail.reproduce import tables
from dovetail.reproduce.curves import curves
from dovetail.reproduce.design import LAWS, Design
from dovetail.reproduce.effects import Measured
from dovetail.reproduce.figures import (
    WINDOW,
    draw_learners,
    draw_robustness,
    draw_training,
    draw_transfer,
)
from dovetail.reproduce.folder import SETTINGS
from dovetail.reproduce.hypotheses import SCALES, Answer
from dovetail.reproduce.plan import Stage
from dovetail.reproduce.results import Cell, Gathered, gather
from dovetail.reproduce.tables import Tabular
from dovetail.reproduce.workflow import RunSummary
from dovetail.zoomable import NOTE

RESULTS, REPORT, WORDS = "results.json", "report.html", "results.md"
STAMP = "results"
"""Text in a figure: the digest of results.json."""
FIGURES = {
    "transfer.png": "Success on the twins",
    "training.png": "Training",
    "learners.png": "Learning algorithms on random goals",
    "robustness.png": "Robustness on the first twin",
}
"""Files of the figures, and what they show."""
_HOW = (
    "A policy of a twin is tried on that twin; nominal and randomised policies are "
    "tried on all of them. Inserted is the mean over policies and twins. The time of "
    "a failed try is that of the longest. Peak force is the mean over the tries of "
    "each one's largest. Learned is when 45 of the last 50 training episodes succeed; "
    "a training that never does counts with all its steps. Intervals are of 95 %, of "
    "the pigeonhole bootstrap over twins and seeds (Owen 2007). Open: the interval "
    "does not decide."
)


def write_reproduction(
    root: Path, design: Design, stages: Sequence[Stage], tally: RunSummary
) -> list[Path]:
    """Write figures, JSON, Markdown and HTML, the HTML last; what is missing is named.

    Args:
        root: Results folder.
        design: What decided the plan.
        stages: The plan.
        tally: What became of the stages.

    Returns:
        The files.

    Raises:
        LogError: The disk is full or the folder is not writable.
    """
    gathered = gather(root, design)
    said, shown = sentences(gathered.answers), all_tables(gathered)
    where = _where(design)
    content = {
        "settings": dataclasses.asdict(design),
        "missing": {**tally.failed, **tally.left_out},
        "sentences": said,
        **to_json(gathered, shown),
        "provenance": where,
    }
    lines = json.dumps(finite(content), indent=1, allow_nan=False) + "\n"
    drawn = {
        "transfer.png": draw_transfer(gathered.cells),
        "training.png": draw_training(gathered.curves),
        "learners.png": draw_learners(gathered.learners),
        "robustness.png": draw_robustness(gathered.robustness),
    }
    files = [
        write_atomic(root / name, stamped(png, lines)) for name, png in drawn.items()
    ]
    files.append(write_atomic(root / RESULTS, lines))
    files.append(write_atomic(root / WORDS, in_words(said, shown)))
    title = (
        f"The paper's experiments on {len(design.twins)} twins: {design.budget.name}"
    )
    parts = [
        f"<h1>{text(title)}</h1>",
        *_lead(design, tally, len(stages)),
        _heading("What follows"),
        *(
            f"<p>{text(' '.join((question, *each)))}</p>"
            for question, each in said.items()
        ),
        *(part for one in shown for part in _html(one)),
        *(figure(FIGURES[name], png) for name, png in drawn.items()),
        _note(
            f"Training curves are moving averages over {WINDOW} episodes, with "
            "exploration noise; shaded: standard deviation over the policies."
        ),
        *_curves(gathered),
        _heading("Make it again"),
        f"<pre>{text(command_line(design))}</pre>",
        *facts("Where this was measured", where),
    ]
    return [*files, write_atomic(root / REPORT, page(title, parts))]


def all_tables(gathered: Gathered) -> list[Tabular]:
    """Return every table of the report, in order."""
    return [
        tables.answer_table(gathered.answers)._replace(note=_HOW),
        *(tables.cell_table(gathered, law) for law in LAWS),
        tables.paper_table(gathered),
        tables.clip_table(gathered),
        tables.learner_table(gathered.learners),
        tables.arm_table(gathered),
        tables.fit_table(gathered),
        tables.robustness_table(gathered),
    ]


def sentences(answers: Sequence[Answer]) -> dict[str, list[str]]:
    """Return what follows for each question: yes, no or open with each law."""
    found: dict[str, list[str]] = {}
    for one in answers:
        h = one.hypothesis
        what = f"{h.question} {_capital(SCALES[h.measure].words)}: {h.difference}."
        found.setdefault(what, []).append(f"{_capital(f'with {h.law}')}: {one.words}.")
    return found


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]


def in_words(said: Mapping[str, Sequence[str]], shown: Sequence[Tabular]) -> str:
    """Return sentences and tables as Markdown.

    Args:
        said: What `sentences` returned.
        shown: What `all_tables` returned.
    """
    lines = []
    for question, each in said.items():
        lines.append(textwrap.fill(f"* {question}", 100, subsequent_indent="  "))
        lines += [f"    * {sentence}" for sentence in each]
    parts = ["### What follows", "\n".join(lines), *(one.markdown() for one in shown)]
    return "\n\n".join(parts) + "\n"


def stamped(png: bytes, results: str) -> bytes:
    """Return a figure that carries the digest of the numbers that it shows.

    Args:
        png: The figure.
        results: Content of results.json.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    info, buffer = PngInfo(), BytesIO()
    info.add_text(STAMP, hashlib.sha256(results.encode()).hexdigest())
    with Image.open(BytesIO(png)) as image:
        image.save(buffer, "PNG", pnginfo=info)
    return buffer.getvalue()


def command_line(design: Design) -> str:
    """Return the command that does it again."""
    words = ["dovetail", "reproduce", "--budget", design.budget.name]
    if any(not twin.startswith("sampled-") for twin in design.twins):
        words += ["--twins", *design.twins]
    words += ["--seed", str(design.seed), "--out", "reproduction-again"]
    return shlex.join(words)


def to_json(gathered: Gathered, shown: Sequence[Tabular]) -> dict[str, Any]:
    """Return every number of the report, its tables included."""
    return {
        "answers": [
            {
                "question": found.hypothesis.question,
                "measure": found.hypothesis.measure,
                "terms": found.hypothesis.terms,
                "claim": found.hypothesis.claim,
                "by": found.hypothesis.by,
                "effect": found.effect._asdict(),
                "verdict": found.verdict,
            }
            for found in gathered.answers
        ],
        "cells": [_cell(cell) for cell in gathered.cells],
        "tables": [one._asdict() for one in shown],
        "learners": [found._replace(runs=[])._asdict() for found in gathered.learners],
        "identification": gathered.fits,
    }


def _cell(cell: Cell) -> dict[str, Any]:
    return dataclasses.asdict(cell) | {
        "measures": {name: _values(found) for name, found in cell.measures.items()}
    }


def _values(found: Measured) -> list[list[float]]:
    return [[round(float(x), 4) for x in row] for row in found.values]


def _where(design: Design) -> dict[str, Any]:
    """Return what the numbers depend on besides the settings, and where those are."""
    found = provenance(datetime.now(UTC))
    del found["duration [s]"]
    found["reported (UTC)"] = found.pop("started (UTC)")
    engines = ", ".join(design.engines)
    return {
        "budget": design.budget.name,
        "engines": engines,
        "all settings": SETTINGS,
        **found,
    }


def _lead(design: Design, tally: RunSummary, total: int) -> list[str]:
    parts = [
        _lead_line(
            f"Budget {design.budget.name}: {design.budget.seeds} training seeds, "
            f"{len(design.twins)} twins. A twin is a simulation that stands in for the "
            "robot: nothing here has run on a robot. The paper's figures are its own, "
            "on an LBR iiwa."
        )
    ]
    if design.budget.name == "smoke":
        parts.append(
            _warning(
                "Budget smoke runs every part once and learns nothing: its success "
                "rates mean nothing."
            )
        )
    lacking = {"bullet": "PyBullet", "drake": "Drake"}
    parts += [
        _warning(
            f"{name} is not installed: the cells that would judge by another engine "
            f"are left out (extra '{engine}')."
        )
        for engine, name in lacking.items()
        if engine not in design.engines
    ]
    lost = dict(tally.failed)
    lost |= {n: f"left out, it needs {c}" for n, c in tally.left_out.items()}
    if lost:
        parts.append(_warning(f"{len(lost)} of {total} stages are missing:"))
        parts.append(table(("stage", "why"), list(lost.items())))
    return parts


def _html(one: Tabular) -> list[str]:
    parts = [_heading(one.title), table(one.heads, one.rows)]
    return [*parts, _note(one.note)] if one.note else parts


def _curves(gathered: Gathered) -> list[str]:
    if not any(run for runs in gathered.curves.values() for run in runs):
        return []
    return [_heading("Look closer: training"), curves(gathered.curves), _note(NOTE)]


def _heading(title: str) -> str:
    return f"<h2>{text(title)}</h2>"


def _lead_line(words: str) -> str:
    return f'<p class="lead">{text(words)}</p>'


def _warning(words: str) -> str:
    return f'<p class="warning">{text(words)}</p>'


def _note(words: str) -> str:
    return f'<p class="note">{text(words)}</p>'
