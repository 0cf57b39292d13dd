"""The command line: help, exit codes, and one clear message per error."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import dovetail
from dovetail import _core
from dovetail.cli import COMMANDS, main, run
from dovetail.errors import DovetailError
from dovetail.plants.twin import load_twin
from extras import need

ROOT = Path(__file__).parent.parent.parent


def test_help_lists_every_command(capsys):
    assert run(["--help"]) == 0
    text = capsys.readouterr().out
    for name, (_, meaning) in COMMANDS.items():
        assert name in text
        assert meaning in text


def test_no_command_at_all_shows_the_help_and_fails(capsys):
    assert run([]) == 2
    assert "dovetail COMMAND" in capsys.readouterr().out


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name, capsys):
    with pytest.raises(SystemExit) as stop:
        run([name, "--help"])
    assert stop.value.code == 0
    assert f"dovetail {name}" in capsys.readouterr().out


def test_help_comes_from_the_settings_docstrings(capsys):
    with pytest.raises(SystemExit):
        run(["evaluate", "--help"])
    text = capsys.readouterr().out
    words = " ".join(text.replace("│", " ").split())
    assert "Gap between peg and hole on each side [m] (default: 0.0005)" in words


def test_an_unknown_command_lists_the_known_ones(capsys):
    assert run(["fly"]) == 2
    error = capsys.readouterr().err
    assert "unknown command 'fly'" in error
    assert ", ".join(COMMANDS) in error


@pytest.mark.parametrize(
    ("typed", "meant"), [("evalute", "evaluate"), ("cabnet", "cabinet")]
)
def test_a_mistyped_command_is_guessed(typed, meant, capsys):
    assert run([typed]) == 2
    assert f"(did you mean {meant}?)" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["evaluate", "export"])
def test_a_command_without_its_file_says_what_it_needs(name, capsys):
    with pytest.raises(SystemExit) as stop:
        run([name])
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert {"evaluate": "POLICY", "export": "MODEL.zip"}[name] in error
    assert f"dovetail {name} --help" in error


def test_the_version_is_that_of_the_package(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"dovetail {dovetail.__version__}\n"
    table = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert dovetail.__version__ == table["project"]["version"]


def test_python_m_dovetail_is_the_command():
    words = [sys.executable, "-m", "dovetail", "--version"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout == f"dovetail {dovetail.__version__}\n"


def test_the_package_brings_its_types():
    """Of a wheel, too: the stub lies where CMake installs the extension."""
    assert (Path(dovetail.__file__).parent / "py.typed").exists()
    stub = Path(_core.__file__).with_name("_core.pyi").read_text()
    for name in ("Controller", "Target", "ServoLoop", "solve_qp"):
        assert f"class {name}:" in stub or f"def {name}(" in stub


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["evaluate", "nobody", "--plant", "mujoco"], "no policy 'nobody'"),
        (["evaluate", "POLICY"], "either a plant or a twin"),
        (["evaluate", "POLICY", "--plant", "gazebo"], "known plants: mujoco, bullet"),
        (["evaluate", "POLICY", "--twin", "unreal"], "shipped twins: easy, hard"),
        (["evaluate", "POLICY", "--twin", "easy", "--peg", "star"], "square, triangle"),
        (["evaluate", "POLICY", "--twin", "easy", "--clearance", "-1"], "clearance"),
        (["twin", "show", "unreal"], "shipped twins: easy, hard, medium"),
        (["train", "--plant", "gazebo"], "known plants: mujoco, bullet"),
        (["demo", "--policy", "nobody"], "no policy 'nobody'"),
    ],
)
def test_wrong_input_is_one_message_without_traceback(
    words, message, still_policy, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    words = [str(still_policy) if word == "POLICY" else word for word in words]
    assert run(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("dovetail: ")
    assert message in error
    assert "Traceback" not in error


def test_an_unknown_environment_is_a_message_with_the_known_ones(capsys):
    assert run(["train", "--env", "dovetail/Nut-v0"]) == 2
    error = capsys.readouterr().err
    assert "dovetail/PegInHole-v0, dovetail/RailClip-v0" in error
    assert "Traceback" not in error


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["demo", "--twin", "mediun"], "medium"),
        (["evaluate", "peg_sqare", "--twin", "medium"], "peg_square"),
        (["evaluate", "peg_square", "--plant", "mujco"], "mujoco"),
        (["evaluate", "peg_square", "--twin", "easy", "--tracker", "nosy"], "noisy"),
        (["evaluate", "peg_square", "--twin", "easy", "--robot", "iiwa4"], "iiwa14"),
        (["evaluate", "peg_square", "--arm", "bulet"], "bullet"),
        (["identify", "fit", ".", "--parameters", "damping_pr_joint"],
         "damping_per_joint"),
    ],
)  # fmt: skip
def test_a_mistyped_name_is_guessed(words, meant, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(words) == 2
    assert f"(did you mean {meant}?)" in " ".join(capsys.readouterr().err.split())


def test_debug_shows_the_traceback():
    with pytest.raises(DovetailError):
        run(["twin", "show", "unreal", "--debug"])


def test_an_interrupt_ends_with_130(monkeypatch, capsys):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("dovetail.cli._run_command", interrupt)
    assert run(["demo"]) == 130
    assert "interrupted" in capsys.readouterr().err


def test_main_leaves_with_the_exit_code():
    with pytest.raises(SystemExit) as stop:
        main(["fly"])
    assert stop.value.code == 2


def test_twin_list_names_every_shipped_twin(capsys):
    assert run(["twin", "list"]) == 0
    text = capsys.readouterr().out
    for name in ("easy", "medium", "hard"):
        assert name in text


def test_what_twin_show_prints_is_a_twin_file(tmp_path, capsys):
    assert run(["twin", "show", "medium"]) == 0
    file = tmp_path / "copy.toml"
    file.write_text(capsys.readouterr().out)
    assert load_twin(file) == load_twin("medium")


def test_evaluate_writes_a_report_and_says_where(still_policy, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["evaluate", str(still_policy), "--plant", "mujoco", "--tries", "1"]
    assert run([*words, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "0/3" in printed
    assert "report.html" in printed
    assert json.loads((out / "report.json").read_text())["ground"] == (
        "simulation (mujoco)"
    )
    assert run([*words, "--out", str(out)]) == 2
    assert "not empty" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "parent"),
    [
        (["demo", "--policy"], "demo-results"),
        (["evaluate", "--twin", "medium"], "results"),
    ],
)
def test_results_go_into_a_new_folder_each_time(
    words, parent, still_policy, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert run([*words, str(still_policy), "--tries", "1"]) == 0
    assert "twin medium (mujoco)" in capsys.readouterr().out
    (folder,) = (tmp_path / parent).iterdir()
    assert (folder / "report.html").is_file()


def test_a_policy_for_the_rail_clip_is_trained_and_then_evaluated(tmp_path, capsys):
    need("sbx")
    run_folder = tmp_path / "run"
    words = ["train", "--env", "dovetail/RailClip-v0", "--out", str(run_folder)]
    words += ["--steps", "60", "--max-steps", "10", "--learning-starts", "30"]
    assert run([*words, "--net", "16", "--eval-episodes", "1"]) == 0
    printed = capsys.readouterr().out
    (command,) = [line for line in printed.splitlines() if "next: " in line]
    policy = json.loads((run_folder / "policy.json").read_text())
    assert policy["env"]["task"] == "XY:force A:pose ZBC:hold"
    assert policy["env"]["theta_range"] == 0.3
    assert policy["action"]["size"] == 3
    out = tmp_path / "out"
    _, *words = command.partition("next: ")[2].split()
    assert run([*words, "--tries", "1", "--out", str(out)]) == 0
    report = json.loads((out / "report.json").read_text())
    assert [row["label"] for row in report["rows"]] == ["A", "B", "C", "all"]
    assert "component on a DIN rail" in report["title"]
    words += ["--tries", "1", "--fixture", "0.84", "0", "0.41", "0"]
    assert run([*words, "--out", str(tmp_path / "given")]) == 0
    assert run([*words, "--start", "below", "--out", str(tmp_path / "below")]) == 2
    assert "for a fixture that opens upwards" in capsys.readouterr().err


@pytest.mark.parametrize("words", [("--tracker", "c.toml"), ("--tracker=c.toml",)])
@pytest.mark.parametrize("command", ["serve", "cabinet"])
def test_who_offers_an_arm_says_where_a_tracker_belongs(capsys, command, words):
    assert run([command, *words]) == 2
    said = capsys.readouterr().err
    assert f"{command} offers an arm; the camera is on the side of the policy" in said
    assert "dovetail evaluate" in said


def test_the_command_runs_as_a_program_without_the_learning_stack():
    code = (
        "import sys; from dovetail.cli import run; code = run(['twin', 'list']);"
        "heavy = {'jax', 'torch', 'pybullet', 'matplotlib', 'sbx'} & set(sys.modules);"
        "sys.exit(code or sorted(heavy) or 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ,
    )
    assert done.returncode in (0, None), done.stderr


def test_figures_are_drawn_whatever_window_matplotlib_is_told_to_open():
    code = (
        "from dovetail import cli;"
        "cli.run = lambda words: __import__('dovetail.evaluation.figures') and 0;"
        "cli.main([])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "MPLBACKEND": "no-such-backend"},
    )
    assert done.returncode == 0, done.stderr
