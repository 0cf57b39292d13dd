"""From the stages' folders to the numbers of the report; what is missing stays nan."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dovetail.evaluation.outcome import Outcome
from dovetail.evaluation.transfer import Row, summarise
from dovetail.identify.fit_folder import MODEL, SUMMARY
from dovetail.learn.policy import RUN_POLICY
from dovetail.learn.progress import WINDOW, EpisodeRow, read_progress
from dovetail.learn.run_folder import EVALUATION as TRAINED
from dovetail.learn.run_folder import PROGRESS
from dovetail.plants.plant import Engine
from dovetail.plants.twin import load_twin
from dovetail.reproduce.design import MODELS, Design, Training, Trial
from dovetail.reproduce.effects import Measured
from dovetail.reproduce.folder import (
    EVALUATION,
    FIT,
    REPORT,
    RUN,
    is_done,
    read_json,
    stage_folder,
)
from dovetail.reproduce.hypotheses import (
    HYPOTHESES,
    Answer,
    CellName,
    MeasureName,
    answers,
)
from dovetail.reproduce.paper import TRANSFER, PaperRow
from dovetail.reproduce.plan import (
    LEARNERS,
    SCRATCH,
    SETS,
    arm_name,
    clip_name,
    fit_name,
    learner_name,
    robustness_cases,
    robustness_name,
    script_name,
)
from dovetail.tasks.shipped import EPISODE_STEPS

LEARNED = 0.9
"""Share of the last `WINDOW` episodes of a training that counts as learned."""


class Tries(NamedTuple):
    """Tries of one policy on one twin, or of several pooled."""

    row: Row
    """All of them."""
    poses: Sequence[Row]
    """By hole pose."""
    stopped: int
    """Tries that the arm ended itself."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Policies of one law and model on the twins; nan where a stage is missing."""

    law: str
    model: str
    trained_in: Engine
    tried_in: Engine
    measures: dict[MeasureName, Measured]
    violations: int
    """Control cycles in which a measured value lay outside its limit."""
    stopped: int
    """Tries that the arm ended itself."""
    tries: int


class Learned(NamedTuple):
    """Trainings by one learning algorithm, seed by seed."""

    label: str
    runs: list[list[EpisodeRow]]
    """Episodes of each seed that is done."""
    steps: list[float]
    """Steps until it had learned; nan for a seed that never did."""
    seconds: list[float]
    """Training time until then [s]."""
    own: list[float]
    """Success at the end."""


class OnArm(NamedTuple):
    """A policy on the arm, at one hole pose: before and after a training there."""

    label: str
    before: Tries | None
    after: Tries | None
    steps: int
    """Steps that it was trained there."""
    minutes: float
    """Robot time of these, 50 ms each [min]."""


class Level(NamedTuple):
    """Tries under one level of a disturbance."""

    what: str
    level: float
    """[m], [N] or [m/s]."""
    tries: Tries | None


class Gathered(NamedTuple):
    """Everything that the report shows."""

    cells: list[Cell]
    script: Tries | None
    """The scripted search on all twins."""
    clip: list[Tries]
    """The rail clip, on each twin that is done."""
    answers: list[Answer]
    paper: list[tuple[PaperRow, Tries | None]]
    learners: list[Learned]
    curves: dict[tuple[str, str], list[list[EpisodeRow]]]
    """Episodes of the trainings in MuJoCo, by law and model."""
    arm: list[OnArm]
    robustness: list[Level]
    fits: dict[str, list[dict[str, Any]]]
    """Fits of each set of parameters, one for each twin that has it."""


def gather(root: Path, design: Design) -> Gathered:
    """Read what the finished stages left."""
    cells = [_cell(root, design, *key) for key in design.cells()]
    by_name = {
        (cell.law, cell.model): cell
        for cell in cells
        if (cell.trained_in, cell.tried_in) == ("mujoco", "mujoco")
    }

    def measure(name: CellName, what: MeasureName) -> Measured:
        return by_name[name.law, name.model].measures[what]

    return Gathered(
        cells=cells,
        script=pool(root, [script_name(twin) for twin in design.twins]),
        clip=[t for twin in design.twins if (t := pool(root, [clip_name(twin)]))],
        answers=answers(measure, HYPOTHESES),
        paper=[(row, _paper_row(root, design, row)) for row in TRANSFER],
        learners=[_learned(root, design, name) for name in LEARNERS],
        curves={
            (law, model): _curves(root, design.trainings(law, model))
            for law, model in by_name
        },
        arm=list(_on_arm(root, design)),
        robustness=[
            Level(what, level, pool(root, [robustness_name(what, level)]))
            for what, level, _ in robustness_cases(design.budget)
        ],
        fits={name: list(_fits(root, design, name)) for name in SETS},
    )


def pool(root: Path, names: Sequence[str]) -> Tries | None:
    """Return the tries of some evaluations together; None where none is done."""
    outcomes: list[Outcome] = []
    labels: list[str] = []
    for name in names:
        if is_done(root, name):
            mine, labels = _outcomes(root, name)
            outcomes += mine
    if not outcomes:
        return None
    *poses, row = summarise(outcomes, labels)
    return Tries(row, poses, sum(bool(o.stop.reason) for o in outcomes))


def _outcomes(root: Path, name: str) -> tuple[list[Outcome], list[str]]:
    report = read_json(stage_folder(root, name) / EVALUATION / "report.json")
    labels = [row["label"] for row in report["rows"][:-1]]
    return [Outcome.from_numbers(numbers) for numbers in report["tries"]], labels


def _cell(
    root: Path,
    design: Design,
    law: str,
    model: str,
    trained_in: Engine,
    tried_in: Engine,
) -> Cell:
    policies = design.trials(law, model, trained_in, tried_in)
    is_of_twin = MODELS[model].is_of_twin
    limit = design.budget.train.get("max_steps", EPISODE_STEPS)
    twins = list(dict.fromkeys(t.twin for trials in policies for t in trials))
    shape = (1 if is_of_twin else len(policies), len(twins))
    names: tuple[MeasureName, ...] = ("success", "time", "force", "steps", "own")
    values = {name: np.full(shape, math.nan) for name in names}
    violations = stopped = tries = 0
    for row, trials in enumerate(policies):
        steps, own = _trained(root, trials[0].training)
        for trial in trials:
            at = (0 if is_of_twin else row, twins.index(trial.twin))
            values["steps"][at], values["own"][at] = steps, own
            if not is_done(root, trial.name):
                continue
            outcomes, _ = _outcomes(root, trial.name)
            values["success"][at] = np.mean([o.success for o in outcomes])
            values["time"][at] = np.mean(
                [o.course.steps if o.success else limit for o in outcomes]
            )
            begun = [o.force.peak for o in outcomes if o.course.steps]
            values["force"][at] = np.mean(begun) if begun else math.nan
            violations += sum(o.course.violations for o in outcomes)
            stopped += sum(bool(o.stop.reason) for o in outcomes)
            tries += len(outcomes)
    return Cell(
        law=law,
        model=model,
        trained_in=trained_in,
        tried_in=tried_in,
        measures={name: Measured(values[name], is_of_twin) for name in names},
        violations=violations,
        stopped=stopped,
        tries=tries,
    )


def _trained(root: Path, training: Training) -> tuple[float, float]:
    """Return the steps until a training had learned, and its success at the end.

    One that never learned counts with all its steps.
    """
    if not is_done(root, training.name):
        return math.nan, math.nan
    run = stage_folder(root, training.name) / RUN
    rows = read_progress(run / PROGRESS)
    ended = learned_at(rows) or (rows[-1] if rows else None)
    return math.nan if ended is None else float(ended.step), _success(run)


def _success(run: Path) -> float:
    tested = run / TRAINED
    if not tested.exists():
        return math.nan
    found = read_json(tested)
    return found["successes"] / found["episodes"]


def learned_at(rows: Sequence[EpisodeRow]) -> EpisodeRow | None:
    """Return the episode by which a training had learned; None if it never had."""
    recent = np.cumsum([0, *(row.success for row in rows)])
    for end in range(WINDOW, len(rows) + 1):
        if recent[end] - recent[end - WINDOW] >= LEARNED * WINDOW:
            return rows[end - 1]
    return None


def _curves(root: Path, trainings: Sequence[Training]) -> list[list[EpisodeRow]]:
    return [
        read_progress(stage_folder(root, training.name) / RUN / PROGRESS)
        for training in trainings
        if is_done(root, training.name)
    ]


def _paper_row(root: Path, design: Design, row: PaperRow) -> Tries | None:
    if row.is_on_arm:
        return pool(root, [f"try-{SCRATCH}"])
    trials: list[Trial] = design.paper_trials(row.stack, row.peg)
    return pool(root, [trial.name for trial in trials])


def _learned(root: Path, design: Design, learner: str) -> Learned:
    found = Learned(LEARNERS[learner][0], [], [], [], [])
    for seed in range(design.seed, design.seed + design.budget.learner_seeds):
        name = learner_name(learner, seed)
        if is_done(root, name):
            run = stage_folder(root, name) / RUN
            rows = read_progress(run / PROGRESS)
            learned = learned_at(rows)
            found.runs.append(rows)
            found.steps.append(math.nan if learned is None else learned.step)
            found.seconds.append(math.nan if learned is None else learned.wall_time)
            found.own.append(_success(run))
    return found


def _on_arm(root: Path, design: Design) -> Iterator[OnArm]:
    policies = design.trainings("paper", "nominal")[: design.budget.failing]
    for training in policies:
        before, tune, after = (
            arm_name(what, training.seed) for what in ("before", "tune", "after")
        )
        yield OnArm(
            f"nominal, the paper's law, seed {training.seed}",
            pool(root, [before]),
            pool(root, [after]),
            *_on_arm_time(root, tune),
        )
    yield OnArm(
        "from nothing",
        None,
        pool(root, [f"try-{SCRATCH}"]),
        *_on_arm_time(root, SCRATCH),
    )


def _on_arm_time(root: Path, name: str) -> tuple[int, float]:
    if not is_done(root, name):
        return 0, math.nan
    path = (stage_folder(root, name) / RUN / RUN_POLICY).with_suffix(".json")
    steps = int(read_json(path)["provenance"]["steps"])
    return steps, steps * 0.05 / 60.0


def _fits(root: Path, design: Design, parameters: str) -> Iterator[dict[str, Any]]:
    for twin in design.twins:
        name = fit_name(twin, parameters)
        if not is_done(root, name):
            continue
        folder = stage_folder(root, name) / FIT
        result = read_json(folder / SUMMARY)["result"]
        yield {
            "twin": twin,
            "rms_before_mm": 1e3 * result["rms_before"],
            "rms_after_mm": 1e3 * result["rms_after"],
            "evaluations": result["evaluations"],
            "wall_time_s": result["wall_time"],
            "warnings": result["warnings"],
            "model": load_twin(folder / MODEL).table(),
            "judged": _judged(root, f"report-{name}"),
        }


def _judged(root: Path, name: str) -> dict[str, Any] | None:
    """Return what the held-out log says of a fit; None where that is missing."""
    if not is_done(root, name):
        return None
    report = read_json(stage_folder(root, name) / REPORT / "report.json")
    return {
        "errors_m": report["errors"],
        "condition_number": report["condition_number"],
        "verdict": report["verdict"],
    }
