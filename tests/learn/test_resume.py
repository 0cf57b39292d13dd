"""`dovetail train --resume --out FOLDER`: everything else is the run's own."""

import json
import os
import shlex
import shutil
import signal
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
import tomlkit
from rich.console import Console

from dovetail.cli import run
from dovetail.commands.command_line import find_task, parse
from dovetail.commands.train import Train, given_before
from dovetail.errors import ConfigError, PlantError
from dovetail.learn.checkpoint import list_checkpoints
from dovetail.learn.config import TrainConfig
from dovetail.learn.config_file import to_toml
from dovetail.learn.one_run import resume_command
from dovetail.learn.run_folder import (
    CHECKPOINTS,
    RunLock,
    open_run,
    require_run,
    run_config,
)
from dovetail.learn.train import train
from dovetail.plants.twin import load_twin
from dovetail.plugins import TRUSTED, trust_typed
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot_text import write_robot_text

from .conftest import SMALL


def begin(config):
    """Note a run as a training does when it begins."""
    open_run(config)
    return ["--resume", "--out", str(config.out)]


def test_a_run_goes_on_without_its_options(small, monkeypatch, capsys):
    from dovetail.envs.contact_env import ContactEnv

    step, taken = ContactEnv.step, []

    def diverge_once(self, action):
        taken.append(1)
        if len(taken) == 150:
            raise PlantError("the simulation diverged")
        return step(self, action)

    monkeypatch.setattr(ContactEnv, "step", diverge_once)
    words = ["--out", str(small.out), "--tare"]
    for name, value in SMALL.items():
        values = value if isinstance(value, tuple) else [value]
        words += [f"--{name.replace('_', '-')}", *map(str, values)]
    assert run(["train", *words, "--clearance", "0.001"]) == 2
    assert f"train --resume --out {small.out}" in capsys.readouterr().out
    assert run(["train", "--resume", "--out", str(small.out)]) == 0
    policy = json.loads((small.out / "policy.json").read_text())
    assert policy["provenance"]["steps"] == SMALL["steps"]
    assert policy["env"]["clearance"] == 0.001


def test_ctrl_c_saves_a_checkpoint_and_names_the_way_on(small, monkeypatch, capsys):
    from dovetail.envs.contact_env import ContactEnv

    step, taken = ContactEnv.step, []

    def interrupted_once(self, action):
        taken.append(1)
        if len(taken) == 150:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.5)
        return step(self, action)

    monkeypatch.setattr(ContactEnv, "step", interrupted_once)
    before = signal.getsignal(signal.SIGINT)
    console = Console(width=400)
    with pytest.raises(KeyboardInterrupt):
        train(small, console)
    assert signal.getsignal(signal.SIGINT) is before
    said = capsys.readouterr().out
    newest = list_checkpoints(small.out / CHECKPOINTS)[-1]
    assert newest.stem == "step-0000000150"
    assert len(taken) < 150 + 2 * small.num_envs
    _, _, command = said.partition("go on with: dovetail ")
    assert run(shlex.split(command.splitlines()[0])) == 0
    policy = json.loads((small.out / "policy.json").read_text())
    assert policy["provenance"]["steps"] == SMALL["steps"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--clearance", "0.002"],
            "clearance is 0.002, the run was started with 0.001",
        ),
        (["--clearance", "0.0005"], "clearance is 0.0005, the run was started with"),
        (["--steps", "400"], "steps is 400, the run was started with 300"),
        (["--tare"], "tare is True, the run was started with False"),
    ],
)
def test_an_option_that_differs_from_the_run_is_named(small, words, message, capsys):
    again = begin(replace(small, task_options={"clearance": 0.001}, tare=False))
    assert run(["train", *again, *words]) == 2
    assert message in capsys.readouterr().err


def test_a_files_robot_is_called_by_its_name(small, capsys):
    text = write_robot_text(replace(iiwa14(), name="told"))
    again = begin(replace(small, robot=text))
    assert run(["train", *again, "--robot", "fr3"]) == 2
    said = capsys.readouterr().err
    assert "robot is 'fr3', the run was started with told, read from a file" in said


def test_the_runs_settings_are_read_back_whole(small):
    config = replace(
        small,
        env="dovetail/RailClip-v0",
        stack=2,
        fixed_goal=True,
        fixture=(0.85, 0.0, 0.4, 0.0),
        f_scale=(4.0, 3.0, 2.0),
        from_policy="peg_square",
        randomise_dynamics=True,
        random_mass=(0.9, 1.3),
    )
    read = resumed(begin(config))
    assert read.to_json() == config.to_json()
    assert read.resume


def test_a_run_on_a_model_has_the_model_in_its_folder(small, tmp_path):
    model = tmp_path / "identified.toml"
    model.write_text(load_twin("medium").to_toml())
    config = replace(small, model=model)
    again = begin(config)
    model.unlink()
    read = resumed(again)
    assert read.model == small.out / "model.toml"
    read.require_same(config)


def test_no_run_to_resume_is_one_message(tmp_path, capsys):
    assert run(["train", "--resume", "--out", str(tmp_path)]) == 2
    assert "no run to resume" in capsys.readouterr().err


def test_resuming_needs_a_folder(capsys):
    assert run(["train", "--resume"]) == 2
    assert "say with --out FOLDER where the run is" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="--out FOLDER"):
        train(TrainConfig(resume=True))


@pytest.mark.parametrize(
    ("settings", "name"),
    [({}, "peg_square"), ({"env": "dovetail/RailClip-v0"}, "RailClip-v0")],
)
def test_two_trainings_without_a_folder_have_one_each(
    settings, name, tmp_path, monkeypatch
):
    from dovetail.learn.run_folder import place_run

    monkeypatch.chdir(tmp_path)
    config = place_run(TrainConfig(**settings))
    assert config.out is not None
    assert config.out.parent.name == "runs"
    assert config.out.name.startswith(f"{name}-20")
    given = replace(config, out=tmp_path / "mine")
    assert place_run(given) is given


def test_the_printed_command_resumes_a_strangers_task(tmp_path, monkeypatch, small):
    """A run's folder alone lets no module be imported; the command line does."""
    example = Path(__file__).parents[2] / "examples" / "06_ring_over_post.py"
    shutil.copy(example, tmp_path / "resumed_ring.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(TRUSTED, "")
    ring = "resumed_ring:RingOverPost-v0"
    config = replace(small, env=ring, task_options={})
    again = begin(config)
    with pytest.raises(ConfigError, match=f"if you trust it, give --env {ring}, or"):
        resumed(again)
    words = shlex.split(resume_command(config, config.folder))
    assert words[:2] == ["dovetail", "train"]
    assert words[-2:] == ["--env", ring]
    trust_typed(words)
    read = resumed(words[2:])
    assert read.env == ring
    assert read.resume


OUTSIDE = ("fri://127.0.0.1:30299", "grpc://127.0.0.1:50999")


def resumed(words):
    """Return the settings of a command line that resumes a run."""
    before = given_before(words)
    return parse(Train, words, find_task(words, before.get("env")), before=before)


@pytest.fixture
def sent(tmp_path):
    """A run folder from someone else, whose config.toml names an arm."""

    def make(arm, **more):
        place = (0.6, 0.0, 0.1, 0.0)
        config = TrainConfig(arm=arm, fixed_goal=True, fixture=place, steps=100)
        table = tomllib.loads(to_toml(config)) | more
        (tmp_path / "config.toml").write_text(tomlkit.dumps(table))
        return tmp_path

    return make


@pytest.mark.parametrize("arm", [*OUTSIDE, f"{OUTSIDE[0]}?control=127.0.0.1:30298"])
def test_a_run_folder_does_not_choose_an_arm(sent, monkeypatch, capsys, arm):
    folder, asked = sent(arm), []
    monkeypatch.setattr("dovetail.learn.one_run.make_vec_env", asked.append)
    assert run(["train", "--resume", "--out", str(folder)]) == 2
    said = capsys.readouterr().err.replace("\n", " ")
    assert arm in said
    assert "--arm" in said
    with pytest.raises(ConfigError):
        run_config(folder)
    with pytest.raises(ConfigError):
        run_config(folder, "grpc://127.0.0.1:1")
    assert asked == []


@pytest.mark.parametrize("arm", OUTSIDE)
def test_a_run_goes_on_with_its_arm_that_is_given_again(sent, arm):
    folder = sent(arm)
    read = resumed(["--resume", "--out", str(folder), "--arm", arm])
    assert read.arm == arm
    require_run(read)


def test_a_run_goes_on_with_a_simulated_arm_of_its_folder(sent):
    assert run_config(sent("twin:easy")).arm == "twin:easy"


def test_the_printed_command_names_the_arm_again_without_its_token(tmp_path):
    config = TrainConfig(arm=f"{OUTSIDE[1]}?token=secret", fixed_goal=True)
    command = resume_command(config, tmp_path)
    assert command.endswith(f"--arm {OUTSIDE[1]}")
    assert "secret" not in command + json.dumps(config.to_json())
    assert "secret" not in config.command()


def test_a_run_on_a_service_goes_on_with_a_new_token(sent):
    arm = f"{OUTSIDE[1]}?token="
    folder = sent(f"{arm}first")
    again = ["--resume", "--out", str(folder), "--arm", f"{arm}second"]
    read = resumed(again)
    require_run(replace(read, arm=f"{arm}second"))


@pytest.mark.parametrize("name", ["steps", "gamma", "period"])
def test_a_run_of_another_version_is_refused(sent, name):
    file = sent("twin:easy") / "config.toml"
    table = tomllib.loads(file.read_text())
    del table[name]
    file.write_text(tomlkit.dumps(table))
    with pytest.raises(ConfigError, match="start a new one") as caught:
        run_config(file.parent)
    assert caught.value.name == name
    file.write_text(tomlkit.dumps(table | {name: "x", "colour": "red"}))
    with pytest.raises(ConfigError, match="start a new one") as caught:
        run_config(file.parent)
    assert caught.value.name == "colour"


@pytest.mark.parametrize(
    ("name", "value"), [("out", "/elsewhere"), ("resume", False), ("threads", 7)]
)
def test_a_run_folder_does_not_choose_where_it_is(sent, name, value):
    folder = sent("twin:easy")
    assert run_config(folder).out == folder
    with pytest.raises(ConfigError) as caught:
        run_config(sent("twin:easy", **{name: value}))
    assert caught.value.name == name


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_lock_that_is_no_file_is_refused_and_harms_nothing(tmp_path, kind):
    precious = tmp_path / "precious.txt"
    precious.write_text("kept")
    lock = tmp_path / ".lock"
    lock.symlink_to(precious) if kind == "link" else os.mkfifo(lock)
    with pytest.raises(ConfigError), RunLock(tmp_path):
        pass
    assert precious.read_text() == "kept"
