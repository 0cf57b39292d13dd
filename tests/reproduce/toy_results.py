"""A results folder without an experiment: every stage done, its numbers invented."""

import json

from dovetail.learn.policy import RUN_POLICY
from dovetail.plants.twin import load_twin
from dovetail.reproduce.folder import DONE, EVALUATION, FIT, REPORT, RUN, stage_folder

_TRY = {
    "seed": 1,
    "depth": 0.028,
    "force_mean": 3.0,
    "force_peak": 20.0,
    "force_step": 5.0,
    "contact_cycles": 100,
    "violations": 0,
    "stopped": "",
    "log": "",
}


def tries(successes, poses=3, each=2):
    """Returns what report.json holds of tries, the first ones successful."""
    return [
        _TRY
        | {
            "pose": pose,
            "attempt": i,
            "success": pose * each + i < successes,
            "steps": 40 + pose,
        }
        for pose in range(poses)
        for i in range(each)
    ]


def finish(root, stage, successes=6):
    """Leaves what a finished stage leaves."""
    folder = stage_folder(root, stage.name)
    folder.mkdir(parents=True, exist_ok=True)
    globals()[stage.rule](folder, stage, successes)
    (folder / DONE).touch()


def record(folder, stage, successes):
    pass


def fit(folder, stage, successes):
    (folder / FIT).mkdir()
    result = {
        "rms_before": 0.0125,
        "rms_after": 0.00125,
        "evaluations": 60,
        "wall_time": 30.0,
        "warnings": [],
    }
    (folder / FIT / "fit.json").write_text(json.dumps({"result": result}))
    (folder / FIT / "model.toml").write_text(load_twin("medium").to_toml())


def report(folder, stage, successes):
    (folder / REPORT).mkdir()
    (folder / REPORT / "after.png").write_bytes(b"a figure")
    numbers = {"rms_before": 0.014, "rms_after": 0.002}
    content = {
        "errors": {"fitting log": numbers, "held-out log": numbers},
        "condition_number": 40.0,
        "verdict": {"answer": "go", "sentence": "small enough", "limit": 0.003},
    }
    (folder / REPORT / "report.json").write_text(json.dumps(content))


def train(folder, stage, successes):
    run = folder / RUN
    run.mkdir()
    rows = [f"{100 * i},{-9 + i},40,{i % 2},20,{i}" for i in range(1, 30)]
    head = "step,reward,length,success,contact_force_max,wall_time"
    (run / "progress.csv").write_text("\n".join([head, *rows]) + "\n")
    evaluation = {"successes": 199, "episodes": 200}
    (run / "evaluation.json").write_text(json.dumps(evaluation))
    policy = {"provenance": {"steps": 60_000, "wall_time_s": 725.0}}
    (run / RUN_POLICY).with_suffix(".json").write_text(json.dumps(policy))


train_on_twin = train


def evaluate(folder, stage, successes):
    poses = 1 if "fixture" in stage.options else 3
    labels = "ABC" if poses == 3 else ["given"]
    content = {
        "rows": [{"label": label} for label in [*labels, "all"]],
        "tries": tries(successes, poses),
    }
    (folder / EVALUATION).mkdir()
    (folder / EVALUATION / "report.json").write_text(json.dumps(content))
