"""`dovetail cockpit` and `dovetail replay`: what goes wrong is said in a line."""

import signal
import subprocess
import sys
from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

from dovetail.cli import run
from dovetail.commands.cockpit import Cockpit
from dovetail.learn.policy import Policy, find_policy
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot_text import write_robot_text
from dovetail.tasks.shipped import DEFAULT_POLICY
from extras import need


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["cockpit", "--policy", "nobody"], "no policy 'nobody'"),
        (["cockpit", "--twin", "easy", "--arm", "mujoco"], "exclude each other"),
        (["cockpit", "--twin", "nowhere"], "nowhere"),
        (["cockpit", "--env", "dovetail/RailClip-v0"], "was trained in"),
        (["cockpit", "--arm", "mujoco", "--fixture", *"9010"], "can be reached"),
        (["cockpit", "--arm", "mujoco", "--port", "70000"], "allowed: 0 to 65535"),
        (["replay", "missing.npz"], "missing.npz cannot be read"),
        (["replay", "."], ". is a folder without a log"),
    ],
)
def test_what_cannot_be_shown_is_one_message(
    words, said, tmp_path, monkeypatch, capsys
):
    need("viser")
    monkeypatch.chdir(tmp_path)
    assert run(words) == 2
    told = capsys.readouterr().err
    assert told.startswith("dovetail: ")
    assert said in told
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_logs_is_told_by_its_logs(tmp_path, capsys):
    (tmp_path / "logs").mkdir()
    for i in range(7):
        (tmp_path / "logs" / f"A-{i}.npz").touch()
    assert run(["replay", str(tmp_path)]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "is a folder of 7 logs" in told
    assert str(tmp_path / "logs" / "A-4.npz") in told
    assert "and 2 more" in told


def test_the_shipped_policy_on_a_twin_is_what_is_shown_first():
    choice = Cockpit().choice()
    assert choice.place == "twin:medium"
    assert choice.policy == DEFAULT_POLICY


def test_the_notes_of_a_policys_own_robot_are_printed(tmp_path, monkeypatch):
    need("viser")
    monkeypatch.setattr("dovetail.commands.cockpit.serve_page", lambda *a, **k: None)
    text = write_robot_text(replace(iiwa14(), name="told", notes=("a note",)))
    told = Policy.load(find_policy(DEFAULT_POLICY))
    env = told.metadata["env"] | {"robot": text}
    policy = Policy(told.layers, told.metadata | {"env": env}).save(tmp_path / "told")
    out = StringIO()
    shown = Cockpit(policy=str(policy), twin="easy", port=0, logs=tmp_path / "logs")
    assert shown.run(Console(file=out, width=200)) == 0
    assert out.getvalue().splitlines().count("note: a note") == 1


def test_a_cockpit_that_is_ended_holds_the_arm_and_says_goodbye(tmp_path):
    need("viser")
    words = ["-m", "dovetail", "cockpit", "--port", "0", "--twin", "easy"]
    process = subprocess.Popen(
        [sys.executable, *words], cwd=tmp_path, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    for line in process.stdout:
        if "the page is http://127.0.0.1:" in line:
            break
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert process.returncode == 0
