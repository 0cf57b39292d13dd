"""`--robot` of the doctor and of the demo: the arm that stands there is that one."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dovetail.cli import run
from dovetail.envs.registered import make_task
from dovetail.errors import UnprovenWarning
from dovetail.identify.parameters import nominal_model
from dovetail.identify.recording import Recording
from dovetail.identify.replay import LogReplay
from dovetail.learn.config import TrainConfig
from dovetail.plants.twin import load_twin, make_twin
from dovetail.plugins import trust
from dovetail.robots.find import list_robots
from dovetail.robots.iiwa14 import iiwa14
from dovetail.tasks.shipped import DEFAULT_ENV
from extras import need

OWN = """
from dataclasses import replace
from dovetail.robots.find import list_robots
from dovetail.robots.iiwa14 import iiwa14

def weak():
    arm = iiwa14()
    tau_max = [*arm.limits.tau_max[:5], 1.0, 1.0]  # Nm: the tool is too heavy for it
    return replace(arm, name="weak", limits=replace(arm.limits, tau_max=tau_max))

def own():
    return replace(iiwa14(), name="own")

def single():
    arm = own()
    links = replace(arm.links, inertia_set="nominal", inertia_sets={})
    return replace(arm, links=links)
"""
KNOWN = ", ".join(list_robots())
LACK = "the twin's inertia set 'lbr' is of another robot: in its place 'nominal' of own"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    (tmp_path / "cli_own_arm.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.parametrize("arm", ["mujoco", "fri://127.0.0.1:1?clock=lockstep"])
@pytest.mark.parametrize(
    ("robot", "message"),
    [
        ("kr16", f"'kr16' is unknown; known: {KNOWN}"),
        ("cli_own_arm:weak", "A6"),
    ],
)
def test_the_doctor_feels_the_robot_that_is_named(arm, robot, message, capsys):
    assert run(["doctor", "--arm", arm, "--robot", robot, "--yes"]) == 2
    assert message in capsys.readouterr().err


def test_the_demo_tries_on_the_robot_that_is_named(tmp_path, capsys):
    words = ["demo", "--robot", "cli_own_arm:own", "--tries", "1", "--out", "demo"]
    assert run(words) == 0
    capsys.readouterr()
    report = json.loads((tmp_path / "demo" / "report.json").read_text())
    assert "cli_own_arm:own" in json.dumps(report["config"])
    assert run(["demo", "--robot", "kr16"]) == 2
    assert f"known: {KNOWN}" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["demo"], ["evaluate", "peg_square"]])
def test_a_robot_without_the_twins_inertia_set_is_tried_with_its_own(
    command, tmp_path, capsys
):
    words = [*command, "--robot", "cli_own_arm:single", "--twin", "medium"]
    assert run([*words, "--tries", "1", "--out", "demo"]) == 0
    told = capsys.readouterr()
    assert LACK in told.out
    assert "dovetail twin show NAME > mine.toml" in told.out
    report = json.loads((tmp_path / "demo" / "report.json").read_text())
    assert any(note.startswith(LACK) for note in report["notes"])


def test_it_is_said_where_the_arm_is_recorded_and_the_fit_takes_it_too(
    capsys, tmp_path
):
    words = ["identify", "record", "--robot", "cli_own_arm:single", "--steps", "4"]
    assert run([*words, "--sequences", "1", "--out", "log"]) == 0
    assert LACK in capsys.readouterr().out
    trust("cli_own_arm")
    replay = LogReplay(Recording.load("log"))
    assert np.isfinite(replay.rms(nominal_model()))
    replay.close()


def test_nothing_is_said_of_a_robot_that_has_it(capsys):
    words = ["identify", "record", "--robot", "cli_own_arm:own", "--steps", "4"]
    assert run([*words, "--sequences", "1", "--out", "log"]) == 0
    assert "inertia set" not in capsys.readouterr().out


def test_in_python_it_is_a_warning():
    robot = iiwa14()
    links = replace(robot.links, inertia_set="nominal", inertia_sets={})
    robot = replace(robot, links=links)
    cell = make_task(DEFAULT_ENV, {}).workcell(robot)
    with pytest.warns(UnprovenWarning, match="'nominal' of"):
        plant = make_twin(load_twin("medium"), cell)
    assert plant.dynamics.inertia == "nominal"
    plant.close()


def test_what_a_training_names_next_has_what_the_policys_file_may_not_choose():
    need("sbx")
    from dovetail.commands.train import next_words

    trust("cli_own_arm")
    policy = Path("run/policy.safetensors")
    evaluate = ["dovetail", "evaluate", str(policy)]
    here = TrainConfig(robot="cli_own_arm:own")
    named = ["--robot", "cli_own_arm:own"]
    assert next_words(policy, here) == [*evaluate, *named, "--twin", "medium"]
    usual = next_words(policy, TrainConfig())
    assert usual == [*evaluate, "--twin", "medium"]
    address, place = "grpc://127.0.0.1:5050", (0.6, 0.0, 0.1, 0.2)
    there = TrainConfig(
        robot="cli_own_arm:own", arm=address,
        fixed_goal=True, fixture=place, payload_error=0.5,
    )  # fmt: skip
    assert next_words(policy, there) == [
        *(*evaluate, *named, "--arm", address),
        *("--fixture", *map(str, place), "--payload-error", "0.5"),
    ]
