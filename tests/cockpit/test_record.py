"""`dovetail record`: what was shown becomes a data set, or a word says what lacks."""

import sys

import pytest
from rich.console import Console

from dovetail.cli import run
from dovetail.commands.cockpit import Cockpit
from dovetail.commands.record import Record
from dovetail.errors import ConfigError, LogError, MissingDependencyError
from extras import need
from learn.test_demonstrations import STEPS, make, record


def test_logs_of_before_become_a_data_set_and_the_next_command_is_said(tmp_path):
    need("pyarrow")
    env = make()
    record(env, tmp_path / "001.npz")
    env.close()
    console = Console(record=True, quiet=False, width=400)
    (tmp_path / "[1] a").mkdir()
    log = (tmp_path / "001.npz").rename(tmp_path / "[1] a" / "001.npz")
    command = Record(written=(log,), logs=tmp_path / "out")
    assert command.run(console) == 0
    said = console.export_text()
    assert f"{tmp_path / 'out' / 'lerobot'}: {STEPS} steps" in said
    assert f"dovetail train --demos '{log}'" in said
    assert (tmp_path / "out" / "lerobot" / "meta" / "info.json").exists()


def test_a_page_on_which_nothing_was_shown_says_how_it_is_done(tmp_path, monkeypatch):
    monkeypatch.setattr(Record, "show", lambda self, console, logs: [])
    with pytest.raises(LogError, match="Demonstration: Begin"):
        Record(logs=tmp_path).run(Console(quiet=True))
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_at_the_end_is_refused_before_the_page(
    tmp_path, monkeypatch
):
    shown = []
    monkeypatch.setattr(Record, "show", lambda *_: shown.append("page") or [])
    (tmp_path / "lerobot").mkdir()
    (tmp_path / "lerobot" / "mine").touch()
    with pytest.raises(ConfigError, match="choose another --logs"):
        Record(logs=tmp_path).run(Console(quiet=True))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingDependencyError, match="pyarrow"):
        Record(logs=tmp_path / "new").run(Console(quiet=True))
    assert not shown


def test_a_page_whose_logs_cannot_be_written_is_not_shown(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ConfigError, match="choose another --logs"):
        Cockpit(logs=tmp_path / "file" / "logs").run(Console(quiet=True))


@pytest.mark.parametrize("words", [["record", "--written"], ["train", "--demos"]])
def test_an_option_for_logs_that_is_given_none_is_refused(words, capsys):
    assert run(words) == 2
    assert f"{words[1]} needs at least one file or folder" in capsys.readouterr().err
