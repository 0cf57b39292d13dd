"""`--robot` of the doctor and of the demo: the arm that stands there is that one."""

import json

import pytest

from dovetail.cli import run

OWN = """
from dataclasses import replace
from dovetail.robots.iiwa14 import iiwa14

def weak():
    arm = iiwa14()
    tau_max = [*arm.tau_max[:5], 1.0, 1.0]  # Nm: the tool is too heavy for it
    return replace(arm, name="weak", tau_max=tau_max)

def own():
    return replace(iiwa14(), name="own")
"""


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    (tmp_path / "cli_own_arm.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.parametrize("arm", ["mujoco", "fri://127.0.0.1:1?clock=lockstep"])
@pytest.mark.parametrize(
    ("robot", "message"),
    [("kr16", "'kr16' is unknown; known: iiwa14"), ("cli_own_arm:weak", "A6")],
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
    assert "known: iiwa14" in capsys.readouterr().err
