"""A results folder without an experiment: every stage done, its numbers invented."""

import json

from dovetail.reproduce.experiments import EVALUATION, RUN
from dovetail.reproduce.stage import stage_folder, write_done

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
    folder.mkdir(parents=True)
    kind = stage.run.partition(":")[2]
    write_done(root, stage.to_json(), result=globals()[kind](folder, stage, successes))


def record_log(folder, stage, successes):
    return {"cycles": 100}


def fit_model(folder, stage, successes):
    return {
        "rms_before_mm": 12.5,
        "rms_after_mm": 1.25,
        "evaluations": 60,
        "wall_time_s": 30.0,
        "warnings": [],
        "model": {},
    }


def report_fit(folder, stage, successes):
    (folder / "report").mkdir()
    (folder / "report" / "after.png").write_bytes(b"a figure")
    numbers = {"rms_before": 0.014, "rms_after": 0.002}
    return {
        "errors_m": {"fitting log": numbers, "held-out log": numbers},
        "condition_number": 40.0,
        "verdict": {"answer": "go", "sentence": "small enough", "limit": 0.003},
    }


def train_policy(folder, stage, successes):
    (folder / RUN).mkdir()
    rows = [f"{100 * i},{-9 + i},40,{i % 2},20,{i}" for i in range(1, 30)]
    head = "step,reward,length,success,contact_force_max,wall_time"
    (folder / RUN / "progress.csv").write_text("\n".join([head, *rows]) + "\n")
    evaluation = {"successes": 199, "episodes": 200}
    return {
        "steps": 60_000,
        "wall_time_s": 725.0,
        "evaluation": evaluation,
        "command": "dovetail train",
    }


train_on_twin = train_policy


def evaluate_policy(folder, stage, successes):
    poses = 1 if "hole" in stage.settings else 3
    labels = "ABC" if poses == 3 else ["given"]
    report = {
        "rows": [{"label": label} for label in [*labels, "all"]],
        "tries": tries(successes, poses),
    }
    (folder / EVALUATION).mkdir()
    (folder / EVALUATION / "report.json").write_text(json.dumps(report))
    return {"ground": f"twin {stage.settings['twin']} (mujoco)", "stopped": []}
