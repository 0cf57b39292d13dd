"""`--cell` of every command that builds a cell, and what a wrong file leads to."""

import json
from pathlib import Path

import pytest
from test_help import PAGES

from dovetail.cli import run
from dovetail.settings import names_in

EXAMPLE = Path(__file__).parents[2] / "examples" / "cell.toml"
OTHERWISE = {"replay"}
"""The log holds what the cell file said."""


def test_every_command_that_builds_a_cell_takes_a_cell_file():
    build = {name for name, kind in PAGES.items() if "robot" in names_in(kind)}
    assert {"train", "evaluate", "demo", "cockpit", "record", "cabinet"} < build
    assert {"doctor", "identify record", "serve"} < build
    lack = {name for name in build if "cell" not in names_in(PAGES[name])}
    assert lack == OTHERWISE


@pytest.mark.parametrize(
    "words",
    [
        ["train"],
        ["evaluate", "peg_square", "--twin", "medium"],
        ["demo"],
        ["cockpit"],
        ["record"],
        ["cabinet"],
        ["serve"],
        ["doctor", "--arm", "mujoco", "--yes"],
        ["identify", "record", "--out", "log"],
        ["compare", "peg_square", "peg_near", "--twin", "medium"],
    ],
    ids=lambda words: " ".join(words[:2]),
)
@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("table_hight = 0.1", "did you mean table_height?"),
        ("table_height = 'high'", "allowed: -1 to 1.5 m"),
        ("walls_low = [0.9, 0.0, 0.1]", "walls_low x is 0.9 m"),
        ("table_height = ", "is not TOML"),
    ],
)
def test_a_wrong_file_is_refused_before_anything_moves(
    words, content, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    Path("cell.toml").write_text(content)
    assert run([*words, "--cell", "cell.toml"]) == 2
    assert said in capsys.readouterr().err
    left = {path.name for path in tmp_path.iterdir()}
    assert not {name for name in left if name in ("log", "results", "runs")}


def test_the_demo_is_tried_in_the_cell_that_is_given(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["demo", "--cell", str(EXAMPLE), "--tries", "1", "--out", "demo"]
    assert run(words) == 0
    report = json.loads(Path("demo/report.json").read_text())
    assert report["config"]["environment"]["cell"]["tool_length"] == 0.25
    assert "--cell" in report["command"]


def test_a_recording_for_identification_holds_the_cell(tmp_path, monkeypatch):
    from dovetail.identify.recording import Recording

    monkeypatch.chdir(tmp_path)
    words = ["identify", "record", "--cell", str(EXAMPLE), "--sequences", "1"]
    assert run([*words, "--steps", "4", "--out", "log"]) == 0
    recording = Recording.load("log")
    assert recording.cell.tool.length == 0.25
    assert recording.cell.table.corners[:, 2].max() == pytest.approx(0.12)
    assert recording.fixture.position[2] >= 0.20
