"""From the stages' folders to the numbers of the report; what is missing stays None."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from dovetail.evaluation.outcome import Outcome
from dovetail.evaluation.transfer import Row, summarise
from dovetail.identify.fit_folder import MODEL, SUMMARY
from dovetail.learn.policy import RUN_POLICY
from dovetail.learn.progress import EpisodeRow, read_progress
from dovetail.learn.run_folder import EVALUATION as TRAINED
from dovetail.learn.run_folder import PROGRESS
from dovetail.plants.twin import load_twin
from dovetail.reproduce.folder import (
    EVALUATION,
    FIT,
    REPORT,
    RUN,
    is_done,
    read_json,
    stage_folder,
)
from dovetail.reproduce.paper import TRANSFER, PaperRow
from dovetail.reproduce.plan import (
    GROUNDS,
    ON_TWIN,
    OTHER,
    UNIDENTIFIED,
    UNTARED,
    VARIANTS,
    PlanConfig,
    fit_name,
    ground_name,
    robustness_cases,
    robustness_name,
    train_name,
    transfer_name,
)


@dataclass(frozen=True, kw_only=True)
class Table:
    """One row of tries, pooled over the training seeds."""

    label: str
    """Label of the row: the variant that was tried."""
    rows: Sequence[Row]
    """One per hole pose, the last over all of them."""
    by_seed: dict[int, str]
    """Successes of tries for each training seed."""
    ground: str
    """Place of the tries: "twin medium (mujoco)"."""
    stopped: int
    """Tries that the arm ended itself."""


class Training(NamedTuple):
    """One finished training."""

    variant: str
    seed: int
    steps: int
    wall_time: float
    """[s]"""
    evaluation: dict[str, Any] | None
    """Deterministic episodes in the simulation that it was trained in."""


class Level(NamedTuple):
    """Robustness at one level of a disturbance."""

    level: float
    """[m], [N] or [m/s]."""
    table: Table | None


class Gathered(NamedTuple):
    """Everything that the report shows."""

    transfer: list[tuple[PaperRow, Table | None]]
    other_direction: Table | None
    grounds: list[tuple[str, str, Table | None]]
    """Twin, whether tared and identified in words, tries."""
    robustness: dict[tuple[str, str], list[Level]]
    """By variant and kind of disturbance."""
    trainings: list[Training]
    curves: dict[str, list[list[EpisodeRow]]]
    """Episodes of each seed, by variant; none of one that is missing."""
    fits: dict[tuple[str, str], dict[str, Any]]
    """Result of each fit, by twin and parameters."""


def gather(root: Path, config: PlanConfig) -> Gathered:
    """Read what the finished stages left."""
    return Gathered(
        [(row, _transfer(root, config, row)) for row in TRANSFER],
        _pool(root, config, "train MuJoCo, twin PyBullet", _other),
        list(_grounds(root, config)),
        _robustness(root, config),
        list(_trainings(root, config)),
        {variant: list(_episodes(root, config, variant)) for variant in VARIANTS},
        _fits(root, config),
    )


def seeds_of(config: PlanConfig) -> range:
    """Return the training seeds."""
    return range(config.seed, config.seed + config.budget.seeds)


def _other(seed: int) -> str:
    return transfer_name(OTHER, "square", seed)


def _pool(root: Path, config: PlanConfig, label: str, name: Any) -> Table | None:
    """Pool one evaluation over the training seeds; `name` names it for a seed."""
    outcomes: list[Outcome] = []
    by_seed: dict[int, str] = {}
    labels: list[str] = []
    ground = ""
    for seed in seeds_of(config):
        if not is_done(root, name(seed)):
            continue
        folder = stage_folder(root, name(seed)) / EVALUATION
        report = read_json(folder / "report.json")
        ground = report["ground"]
        labels = [row["label"] for row in report["rows"][:-1]]
        mine = [Outcome.from_numbers(numbers) for numbers in report["tries"]]
        by_seed[seed] = f"{sum(o.success for o in mine)}/{len(mine)}"
        outcomes += mine
    if not outcomes:
        return None
    rows = summarise(outcomes, labels)
    stopped = sum(bool(outcome.stop.reason) for outcome in outcomes)
    return Table(
        label=label, rows=rows, by_seed=by_seed, ground=ground, stopped=stopped
    )


def _transfer(root: Path, config: PlanConfig, row: PaperRow) -> Table | None:
    def name(seed: int) -> str:
        return transfer_name(row.variant, row.peg, seed)

    return _pool(root, config, row.label, name)


def _grounds(root: Path, config: PlanConfig) -> Iterable[tuple[str, str, Table | None]]:
    for index, twin in enumerate(config.twins):
        variants = (UNTARED, UNIDENTIFIED, f"identified-{twin}")
        for word, variant in zip(GROUNDS, variants, strict=True):

            def name(seed: int, twin: str = twin, variant: str = variant) -> str:
                return ground_name(twin, variant, seed)

            def in_table(seed: int) -> str:
                return transfer_name("stack-0", "square", seed)

            is_in_table = index == 0 and word == GROUNDS[-1]
            label = f"stack 0, {word}"
            used = in_table if is_in_table else name
            yield twin, word, _pool(root, config, label, used)


def _robustness(root: Path, config: PlanConfig) -> dict[tuple[str, str], list[Level]]:
    found: dict[tuple[str, str], list[Level]] = {}
    for variant in config.budget.robust:
        for what, level, _ in robustness_cases(config.budget):

            def name(
                seed: int, variant: str = variant, what: str = what, at: float = level
            ) -> str:
                if at == 0.0:
                    return transfer_name(variant, "square", seed)
                return robustness_name(variant, what, at, seed)

            table = _pool(root, config, VARIANTS[variant], name)
            found.setdefault((variant, what), []).append(Level(level, table))
    return found


def _trainings(root: Path, config: PlanConfig) -> Iterable[Training]:
    others = [f"identified-{twin}" for twin in config.twins[1:]]
    for variant in (*VARIANTS, UNIDENTIFIED, *others, ON_TWIN, OTHER):
        for seed in seeds_of(config):
            name = train_name(variant, seed)
            if is_done(root, name):
                run = stage_folder(root, name) / RUN
                facts = read_json((run / RUN_POLICY).with_suffix(".json"))["provenance"]
                tested = run / TRAINED
                evaluation = read_json(tested) if tested.exists() else None
                steps, seconds = facts["steps"], facts["wall_time_s"]
                yield Training(variant, seed, steps, seconds, evaluation)


def _episodes(
    root: Path, config: PlanConfig, variant: str
) -> Iterable[list[EpisodeRow]]:
    for seed in seeds_of(config):
        name = train_name(variant, seed)
        progress = stage_folder(root, name) / RUN / PROGRESS
        yield read_progress(progress) if is_done(root, name) else []


def _fits(root: Path, config: PlanConfig) -> dict[tuple[str, str], dict[str, Any]]:
    found = {}
    for twin in config.twins:
        for parameters in dict.fromkeys(("paper", config.parameters)):
            name = fit_name(twin, parameters)
            if is_done(root, name):
                judged = _judged(root, f"report-{name}")
                fit = _fit(stage_folder(root, name) / FIT)
                found[twin, parameters] = fit | {"judged": judged}
    return found


def _fit(folder: Path) -> dict[str, Any]:
    result = read_json(folder / SUMMARY)["result"]
    return {
        "rms_before_mm": 1e3 * result["rms_before"],
        "rms_after_mm": 1e3 * result["rms_after"],
        "evaluations": result["evaluations"],
        "wall_time_s": result["wall_time"],
        "warnings": result["warnings"],
        "model": load_twin(folder / MODEL).table(),
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
