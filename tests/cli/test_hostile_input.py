"""Input that nobody means well, and an output that takes nothing: one message each."""

import errno
import io
import os
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
import tomlkit

from dovetail.cli import make_console, run
from dovetail.commands.evaluate import print_files
from dovetail.commands.twin import TwinShow
from dovetail.errors import ConfigError
from dovetail.evaluation.evaluate import Evaluation
from dovetail.learn.config import TrainConfig
from dovetail.learn.config_file import to_toml
from dovetail.learn.run_folder import run_config
from dovetail.plants.twin import load_twin

STRANGE = 'Prüfstand \x1b[31m \x9b1m "1" \\ \U0001f600'


def refused(words, capsys):
    assert run(words) == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("evaluate peg_square --twin easy --tries 999999999999", "tries is 99999"),
        ("demo --tries 999999999999", "allowed: 1 to 100000 at each pose"),
        (f"evaluate peg_square --twin easy --seed {2**70}", "seed is 118059"),
        ("evaluate peg_square --twin easy --workers 100000", "workers is 100000"),
        ("identify record --out r --sequences 1000000000", "sequences is 1000000000"),
    ],
)
def test_a_count_that_would_take_for_ever_is_refused_at_once(
    words, message, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert message in refused(words.split(), capsys)
    assert not list(tmp_path.iterdir())


def test_a_twin_nested_deep_is_one_message(tmp_path, capsys):
    file = tmp_path / "deep.toml"
    file.write_text("a = " + "[" * 3000 + "]" * 3000)
    assert "is not TOML: maximum recursion" in refused(
        ["twin", "show", str(file)], capsys
    )


def test_an_error_that_quotes_a_file_steers_no_terminal(tmp_path, capsys):
    file = tmp_path / "painted.toml"
    file.write_text('"\\u001b[31mred" = 1\n')
    error = refused(["twin", "show", str(file)], capsys)
    assert r"\x1b[31mred" in error
    assert "\x1b" not in error


@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "iso-8859-1"])
def test_a_strangers_twin_is_shown_as_a_file_in_every_language(
    encoding, tmp_path, monkeypatch
):
    twin = replace(load_twin("easy"), description=STRANGE)
    file, again = tmp_path / "twin.toml", tmp_path / "again.toml"
    file.write_text(twin.to_toml(), encoding="utf-8")
    raw = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(raw, encoding=encoding))
    TwinShow(name=str(file)).run(make_console())
    sys.stdout.flush()
    shown = raw.getvalue().decode(encoding)
    assert "\x1b" not in shown
    assert "\x9b" not in shown
    again.write_text(shown, encoding="utf-8")
    assert load_twin(again) == twin


def test_a_twin_is_shown_with_its_units(capsys):
    run(["twin", "show", "medium"])
    lines = capsys.readouterr().out.splitlines()
    for name, unit in (("damping", "Nms/rad"), ("command_delay", "s")):
        (line,) = (line for line in lines if line.startswith(f"{name} = "))
        assert line.endswith(f" # {unit}")


@pytest.mark.parametrize("words", ["twin show medium", "--version", "train --help"])
def test_an_output_that_is_full_is_said(words):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "dovetail", *words.split()],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    reason = os.strerror(errno.ENOSPC).lower()
    assert done.stderr == f"dovetail: cannot write the output: {reason}\n"
    assert done.returncode == 2


def test_a_folder_in_brackets_is_printed_whole(tmp_path, capsys):
    folder = tmp_path / "[x] :smile:"
    files = [folder / "[bold]report.html"]
    evaluation = Evaluation([], [], None, folder, files)
    print_files(evaluation, make_console())
    assert capsys.readouterr().out == f"written to {folder}:\n  {files[0].name}\n"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("gamma", "much"), ("gamma", True), ("steps", 1e30)],
        *[("fixture", ["a", 0, 0, 0]), ("fixture", [0, 0]), ("net", ["x"]), ("env", 5)],
        *[("random_mass", 5), ("tare", "perhaps"), ("algorithm", "guess"), ("peg", 1)],
    ],
)
def test_a_runs_settings_of_another_kind_are_named(name, value, tmp_path):
    file = tmp_path / "config.toml"
    table = tomllib.loads(to_toml(TrainConfig())) | {name: value}
    file.write_text(tomlkit.dumps(table))
    with pytest.raises(ConfigError) as caught:
        run_config(tmp_path)
    assert caught.value.name.partition("[")[0] in (name, "")
    assert f"{name} is" in str(caught.value) or f"{name}[" in str(caught.value)


@pytest.mark.parametrize("text", ["a = " + "[" * 100_000, "[1", "steps"])
def test_a_runs_settings_that_are_no_table_are_damaged(text, tmp_path):
    (tmp_path / "config.toml").write_text(text)
    with pytest.raises(ConfigError, match=r"config\.toml"):
        run_config(tmp_path)
