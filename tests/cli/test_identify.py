"""`dovetail identify` from record to fit, and its errors as one line."""

import json

import pytest

from dovetail.cli import run
from dovetail.plants.twin import load_twin
from extras import need

SHORT = ["--sequences", "2", "--steps", "6", "--arm", "twin:easy"]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("identify") / "log"
    assert run(["identify", "record", "--out", str(folder), *SHORT]) == 0
    return folder


def test_record_says_what_to_do_next(tmp_path, capsys):
    folder = tmp_path / "[a] log"
    assert run(["identify", "record", "--out", str(folder), *SHORT]) == 0
    text = capsys.readouterr().out
    assert "2 sequences, 120 control cycles of 5 ms, from twin:easy" in text
    assert f"next: dovetail identify fit '{folder}'" in text


def test_fit_writes_a_model_that_a_twin_can_be(log, tmp_path, capsys):
    need("cmaes")
    out = tmp_path / "fit"
    words = ["--parameters", "gravity,mass_scale", "--evaluations", "16"]
    words += ["--workers", "1", "--out", str(out)]
    assert run(["identify", "fit", str(log), *words]) == 0
    text = capsys.readouterr().out
    assert "TCP's RMS error on the log" in text
    assert "mass_scale" in text
    assert load_twin(out / "model.toml").torque_noise == 0.0
    assert json.loads((out / "fit.json").read_text())["state"] == "done"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fit", "nowhere"], "nowhere is no recording"),
        (["fit", "LOG", "--parameters", "inertia"], "parameter 'inertia' is unknown"),
        (["fit", "LOG", "--plant", "gazebo"], "known plants: mujoco, bullet"),
        (["record", "--out", "LOG", *SHORT, "--seed", "1"], "holds a recording with"),
        (["fit", "LOG", "--out", "/proc/fit"], "cannot create the output folder"),
        (["record", "--out", "/proc/log", *SHORT], "nothing can be written into"),
        (["record", "--out", "new", "--arm", "robot"], "arm 'robot' is unknown"),
        (["record", "--out", "new", "--sequences", "0"], "sequences is 0; allowed: 1"),
    ],
)
def test_a_wrong_setting_is_one_line(
    log, tmp_path, capsys, monkeypatch, words, message
):
    monkeypatch.chdir(tmp_path)
    words = [str(log) if word == "LOG" else word for word in words]
    assert run(["identify", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
