"""A whole training, small: what it leaves behind, and that a kill loses little."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from dovetail.errors import (
    ConfigError,
    DovetailError,
    MissingDependencyError,
    install_command,
)
from dovetail.learn.checkpoint import list_checkpoints
from dovetail.learn.config import TrainConfig
from dovetail.learn.config_file import to_toml
from dovetail.learn.policy import Policy
from dovetail.learn.progress import read_progress
from dovetail.learn.run_folder import RunLock
from dovetail.learn.train import train
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot_text import write_robot_text
from dovetail.settings import values_of

from .conftest import SMALL


def test_a_run_of_an_arm_that_is_too_short_leaves_no_folder(small):
    robot = iiwa14()
    at = 0.2 * robot.geometry.origin_position
    geometry = replace(robot.geometry, origin_position=at)
    short = write_robot_text(replace(robot, name="short", geometry=geometry))
    with pytest.raises(ConfigError) as refused:
        train(replace(small, robot=short))
    assert refused.value.value == "short"
    assert not small.out.exists()


def test_a_training_leaves_policy_evaluation_progress_and_settings(small):
    output = StringIO()
    (result,) = train(small, Console(file=output))
    names = {path.name for path in small.out.iterdir()}
    assert names >= {
        "config.toml",
        "progress.csv",
        "tensorboard",
        "checkpoints",
        "policy.json",
        "policy.safetensors",
        "evaluation.json",
    }
    assert result.steps == 300
    assert json.loads((small.out / "evaluation.json").read_text()) == result.evaluation
    assert result.evaluation["episodes"] == 2
    assert result.evaluation["contact_force_peak_N"]["p95"] >= 0.0
    assert Policy.load(result.policy).metadata["provenance"]["steps"] == 300
    rows = read_progress(small.out / "progress.csv")
    assert [row.length for row in rows] == [25] * 12
    assert all(row.reward < 0.0 for row in rows)
    assert "300/300 steps, success 0 %" in output.getvalue()
    assert any((small.out / "tensorboard").iterdir())


def test_a_run_folder_that_is_not_empty_is_refused(small):
    small.out.mkdir()
    (small.out / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match=r"not empty \(it holds notes.txt\)"):
        train(small)
    with pytest.raises(ConfigError, match="no run to resume"):
        train(replace(small, resume=True))
    (small.out / "config.toml").write_text(to_toml(small))
    with pytest.raises(ConfigError, match=r"already holds a run.*--resume"):
        train(small)


@pytest.mark.parametrize(
    "wrong",
    [
        {"plant": "gazebo"},
        {"plant": "bullet", "task_options": {"peg": "triangle"}},
        {"task_options": {"peg": "star"}},
        {"task_options": {"clearance": -1.0}},
        {"scheme": "hope"},
        {"period": 0.1},
        {"stack": -1},
        {"from_policy": "nobody"},
        {"from_policy": "peg_square"},
        {"fixed_goal": True, "fixture": (0.9, 0.0, 0.1, 0.0)},
        {"plant": "gazebo", "seeds": 2},
    ],
)
def test_a_wrong_setting_leaves_no_folder_behind(small, wrong):
    with pytest.raises(DovetailError):
        train(replace(small, **wrong))
    assert not small.out.exists()


def test_without_the_learning_stack_there_is_no_run_folder(small, monkeypatch):
    monkeypatch.setitem(sys.modules, "sbx", None)
    with pytest.raises(MissingDependencyError, match="sbx-rl=="):
        train(small)
    assert not small.out.exists()


def test_without_pybullet_there_is_no_run_folder(small, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(
        MissingDependencyError, match=re.escape(install_command("bullet"))
    ):
        train(replace(small, plant="bullet"))
    assert not small.out.exists()


def test_resuming_with_other_settings_names_the_field(small):
    small.out.mkdir()
    (small.out / "config.toml").write_text(to_toml(small))
    with pytest.raises(ConfigError, match=r"clearance is 0.001, the run was started"):
        train(replace(small, resume=True, task_options={"clearance": 0.001}))


def test_two_processes_cannot_train_in_one_folder(tmp_path):
    with RunLock(tmp_path), pytest.raises(ConfigError, match="another process"):
        RunLock(tmp_path).__enter__()
    RunLock(tmp_path).__enter__().__exit__()


def test_a_row_that_a_kill_cut_short_is_left_out_but_no_other(tmp_path):
    path = tmp_path / "progress.csv"
    head = "step,reward,length,success,contact_force_max,wall_time\n"
    path.write_text(head + "10,-1.5,25,0,3.2,0.1\n20,-1,25")
    assert [row.step for row in read_progress(path)] == [10]
    path.write_text(head + "10,-1.5,2\n20,-1,25,1,0,0.2\n")
    with pytest.raises(ConfigError, match="line 2 is damaged"):
        read_progress(path)


@pytest.fixture
def start():
    """Starts trainings in processes that end with the test."""
    processes = []

    def start(config: TrainConfig) -> subprocess.Popen[bytes]:
        processes.append(start_process(config))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def start_process(config: TrainConfig) -> subprocess.Popen[bytes]:
    changed = ("algorithm", "steps", "seeds")
    flat = values_of(config)
    settings = SMALL | {name: flat[name] for name in changed}
    code = (
        "from dovetail.learn.train import train, TrainConfig\n"
        "if __name__ == '__main__':\n"
        f"    train(TrainConfig(out={str(config.out)!r}, **{settings!r}))\n"
    )
    script = config.out.with_suffix(".py")
    script.write_text(code)
    return subprocess.Popen([sys.executable, str(script)], stderr=subprocess.PIPE)


def wait_for(process: subprocess.Popen[bytes], is_reached) -> None:
    deadline = time.monotonic() + 600
    while not is_reached():
        assert process.poll() is None, process.stderr.read().decode()
        assert time.monotonic() < deadline
        time.sleep(0.01)


def newest_step(run: Path) -> int:
    found = list_checkpoints(run / "checkpoints")
    return int(found[-1].stem.removeprefix("step-")) if found else 0


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_run_killed_with_kill_9_continues_from_its_last_checkpoint(small, start):
    config = replace(small, steps=1500)
    process = start(config)
    wait_for(process, lambda: newest_step(config.out) >= 300)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    reached = newest_step(config.out)
    lived = read_progress(config.out / "progress.csv")[-1].step
    assert lived - reached <= config.checkpoint_interval + config.num_envs
    assert reached < 1500
    output = StringIO()
    (result,) = train(replace(config, resume=True), Console(file=output))
    assert result.steps == 1500
    with (config.out / "progress.csv").open() as file:
        steps = [int(row["step"]) for row in csv.DictReader(file)]
    assert steps == sorted(steps)
    assert [s for s in steps if s <= reached]
    assert min(s for s in steps if s > reached) <= reached + 2 * 25 + config.num_envs
    first = int(output.getvalue().split("/1500")[0].split()[-1])
    assert first > reached


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_several_seeds_train_in_sub_folders_and_resume_after_a_kill(small, start):
    config = replace(small, algorithm="ppo", learning_rate=1e-3, steps=4000, seeds=2)
    process = start(config)
    folders = [config.out / "seed-0", config.out / "seed-1"]
    wait_for(process, lambda: min(newest_step(f) for f in folders) >= 200)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    deadline = time.monotonic() + 30
    while True:  # the workers notice within a second that their parent is gone
        try:
            for folder in folders:
                RunLock(folder).__enter__().__exit__()
            break
        except ConfigError:
            assert time.monotonic() < deadline
            time.sleep(0.2)
    results = train(replace(config, resume=True), Console(file=StringIO()))
    assert all(4000 <= result.steps < 4000 + 2 * 32 for result in results)
    summary = json.loads((config.out / "evaluation.json").read_text())
    assert list(summary) == ["seed-0", "seed-1"]
    layers = [Policy.load(result.policy).layers[0][0] for result in results]
    assert (layers[0] != layers[1]).any()
