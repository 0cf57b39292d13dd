"""`dovetail record`: what was shown becomes a data set, or a word says what lacks."""

import pytest
from rich.console import Console
from tests.extras import need
from tests.learn.test_demonstrations import STEPS, make, record

from dovetail.commands.record import Record
from dovetail.errors import LogError


def test_logs_of_before_become_a_data_set_and_the_next_command_is_said(tmp_path):
    need("pyarrow")
    env = make()
    record(env, tmp_path / "001.npz")
    env.close()
    console = Console(record=True, quiet=False, width=400)
    command = Record(written=(tmp_path / "001.npz",), logs=tmp_path / "out")
    assert command.run(console) == 0
    said = console.export_text()
    assert f"{tmp_path / 'out' / 'lerobot'}: {STEPS} steps" in said
    assert f"dovetail train --demos {tmp_path / '001.npz'}" in said
    assert (tmp_path / "out" / "lerobot" / "meta" / "info.json").exists()


def test_a_page_on_which_nothing_was_shown_says_how_it_is_done(tmp_path, monkeypatch):
    monkeypatch.setattr(Record, "show", lambda self, console, logs: [])
    with pytest.raises(LogError, match="Demonstration: Begin"):
        Record(logs=tmp_path).run(Console(quiet=True))
    assert list(tmp_path.iterdir()) == []
