"""Functions of the stages: record, fit, report, train, evaluate."""

import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dovetail.learn.config_file import CONFIG
from dovetail.learn.policy import RUN_POLICY
from dovetail.page import finite
from dovetail.reproduce.settings import as_config
from dovetail.reproduce.stage import StageContext

TWINS = "twins"
"""Folder of the twins in the results folder: copies, so that a change of the original
does not mix two twins in one table."""
RECORDING, FIT, RUN, EVALUATION = "recording", "fit", "run", "evaluation"
MODEL = "model.toml"


def twin_file(root: Path, twin: str) -> Path:
    """Return the file of a twin in the results folder."""
    return root / TWINS / f"{twin}.toml"


def record_log(sitting: StageContext) -> dict[str, Any]:
    """Play the scripted sequences on the twin and log them."""
    from dovetail.identify.recorder import RecordConfig, record

    settings = sitting.settings
    recording = record(
        RecordConfig(
            arm=f"twin:{twin_file(sitting.root, settings['twin'])}",
            out=sitting.folder / RECORDING,
            seed=settings["seed"],
            sequences=settings["sequences"],
            steps=settings["steps"],
        ),
        sitting.console,
    )
    return {"cycles": sum(len(sequence.log) for sequence in recording.sequences)}


def fit_model(sitting: StageContext) -> dict[str, Any]:
    """Fit the simulation to a log."""
    from dovetail.identify.fit import FitConfig, fit

    settings = sitting.settings
    out = sitting.folder / FIT
    limit = settings["evaluations"]
    result = fit(
        FitConfig(
            log=sitting.of(settings["log_of"]) / RECORDING,
            plant=settings["plant"],
            parameters=settings["parameters"],
            out=out,
            seed=settings["seed"],
            workers=1,  # the stages share the cores
            resume=_is_begun(out, "fit.json"),
            **({} if limit is None else {"evaluations": limit}),
        ),
        sitting.console,
    )
    return {
        "rms_before_mm": 1e3 * result.rms_before,
        "rms_after_mm": 1e3 * result.rms_after,
        "evaluations": result.evaluations,
        "wall_time_s": result.wall_time,
        "warnings": list(result.warnings),
        "model": result.model.table(),
    }


def report_fit(sitting: StageContext) -> dict[str, Any]:
    """Judge a fit by a log that it has not seen: figures, intervals, go or no-go."""
    from dovetail.identify.recording import Recording
    from dovetail.identify.report import write_identification_report

    held_out = Recording.load(sitting.of(sitting.settings["held_out_of"]) / RECORDING)
    out = sitting.folder / "report"
    shutil.rmtree(out, ignore_errors=True)  # of a sitting that was cut short
    fit = sitting.of(sitting.settings["fit_of"]) / FIT
    report = write_identification_report(fit, held_out, out, sitting.console)
    result = {
        "errors_m": {c.log: c.numbers() for c in report.comparisons},
        "condition_number": report.identifiability.condition_number,
        "verdict": asdict(report.verdict),
    }
    return finite(result)


def train_policy(sitting: StageContext) -> dict[str, Any]:
    """Train one policy of one seed; a sitting that was cut short is gone on with."""
    settings = dict(sitting.settings)
    model_of = settings.pop("model_of", None)
    if model_of is not None:
        settings["model"] = sitting.of(model_of) / FIT / MODEL
    return _train(sitting, settings)


def train_on_twin(sitting: StageContext) -> dict[str, Any]:
    """Train on the twin itself over FRI, as the paper does on the robot, one pose."""
    from dovetail.reproduce.served_twin import serve_twin

    settings = dict(sitting.settings)
    file = twin_file(sitting.root, settings.pop("twin"))
    scene = {name: settings[name] for name in ("peg", "clearance")}
    with serve_twin(
        file, sitting.folder, hole=settings["hole"], period=settings["period"], **scene
    ) as address:
        return _train(sitting, settings | {"arm": address})


def _train(sitting: StageContext, settings: dict[str, Any]) -> dict[str, Any]:
    from dovetail.learn.config import TrainConfig
    from dovetail.learn.train import train

    out = sitting.folder / RUN
    resume = _is_begun(out, CONFIG)
    config = TrainConfig(out=out, resume=resume, **as_config(settings))
    (result,) = train(config, sitting.console)
    return {
        "steps": result.steps,
        "wall_time_s": round(result.wall_time, 1),
        "evaluation": result.evaluation,
        "command": config.command(),
    }


def evaluate_policy(sitting: StageContext) -> dict[str, Any]:
    """Try a policy on a twin and keep its table."""
    from dovetail.evaluation.evaluate import EvaluationConfig, evaluate

    settings = dict(sitting.settings)
    policy = sitting.of(settings.pop("policy_of")) / RUN / RUN_POLICY
    twin = twin_file(sitting.root, settings.pop("twin"))
    settings = as_config(settings)
    out = sitting.folder / EVALUATION
    shutil.rmtree(out, ignore_errors=True)  # of a sitting that was cut short
    evaluation = evaluate(
        EvaluationConfig(policy=str(policy), twin=str(twin), out=out, **settings),
        sitting.console,
    )
    ends = [outcome.stop.reason for outcome in evaluation.outcomes]
    stopped = [reason for reason in ends if reason]
    return {"ground": evaluation.report.ground, "stopped": stopped}


def _is_begun(folder: Path, file: str) -> bool:
    """Say whether a folder holds something to resume; leftovers of less are removed."""
    if (folder / file).exists():
        return True
    shutil.rmtree(folder, ignore_errors=True)
    return False
