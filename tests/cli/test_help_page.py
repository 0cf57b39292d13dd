"""The help of commands with many options: groups, each option on a line."""

import importlib
from dataclasses import is_dataclass
from itertools import pairwise
from typing import get_args

import pytest

from dovetail.cli import COMMANDS, run
from dovetail.commands.help_page import title_of
from dovetail.control.sections import settings_in
from dovetail.tasks.options import option_types
from dovetail.tasks.peg_in_hole.task import PegInHole

GROUPED = {
    name: vars(module)
    for name in COMMANDS
    if "GROUPS" in vars(module := importlib.import_module(f"dovetail.commands.{name}"))
}


def pages():
    """Every command that has a help, subcommands too, and its settings."""
    for name, (settings, _) in COMMANDS.items():
        kind = vars(importlib.import_module(f"dovetail.commands.{name}"))[settings]
        if is_dataclass(kind):
            yield name, kind
        for part in get_args(kind):
            inner, subcommand = get_args(part)
            yield f"{name} {subcommand.name}", inner


PAGES = dict(pages())


def shown(name, capsys, option="--help"):
    with pytest.raises(SystemExit) as stop:
        run([*name.split(), option])
    assert stop.value.code == 0
    return capsys.readouterr().out.splitlines()


def test_the_commands_with_many_options_have_groups():
    assert {"demo", "export", "train", "evaluate", "cabinet"} <= set(GROUPED)


@pytest.mark.parametrize("name", GROUPED)
def test_every_option_is_in_one_group(name):
    module = GROUPED[name]
    grouped = [field for names in module["GROUPS"].values() for field in names]
    assert sorted(grouped) == sorted(settings_in(module[COMMANDS[name][0]]))


@pytest.mark.parametrize("option", ["--help", "--help-all"])
@pytest.mark.parametrize("name", PAGES)
def test_options_are_titled_in_words(name, option, capsys, monkeypatch):
    """Not by the fields that lead to them, as "cell.task-options options"."""
    monkeypatch.setenv("COLUMNS", "100")
    settings = settings_in(PAGES[name]).values()
    lines = ["", *(line.strip() for line in shown(name, capsys, option))]
    titles = {line for above, line in pairwise(lines) if line and not above}
    said = {title_of(s.owner) for s in settings if s.owner is not PAGES[name]}
    assert said <= titles
    sections = {field for s in settings for field in s.trail[:-1]}
    assert not [t for t in titles if t in sections or t.endswith(" options")]


@pytest.mark.parametrize("width", [60, 80, 100, 200])
@pytest.mark.parametrize("name", GROUPED)
def test_the_page_keeps_to_the_terminal(name, width, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    assert max(map(len, shown(name, capsys))) <= min(width, 100)


def test_an_option_of_train_is_one_line(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    lines = shown("train", capsys)
    options = [line for line in lines if line.startswith("  ")]
    assert all(line.startswith("  --") for line in options)
    number = (
        len(settings_in(GROUPED["train"]["Train"])) + len(option_types(PegInHole)) - 1
    )
    assert len(options) == number


def test_the_page_says_names_values_and_defaults(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    lines = [" ".join(line.split()) for line in shown("train", capsys)]
    assert "--steps N Environment steps at most; see `until` (60000)" in lines
    assert "--from NAME Policy to start from: a file, or the name of a shipped one" in (
        lines
    )
    assert "--period TIME Control period: 1ms, 2ms, 2.5ms or 5ms (5ms)" in lines
    assert any(line.startswith("--[no-]tare Measure") for line in lines)
    assert "learning algorithm" in lines
    assert shown("evaluate", capsys)[0] == "usage: dovetail evaluate POLICY [OPTIONS]"


@pytest.mark.parametrize("name", ["demo", "export"])
def test_a_value_that_may_be_left_out_is_said_in_words(name, capsys):
    text = "\n".join(shown(name, capsys))
    assert "None" not in text
    assert "--robot NAME" in text


def test_everything_is_said_with_help_all(capsys):
    text = " ".join(shown("train", capsys, "--help-all"))
    assert "carries" in text
    assert "--exploration-noise" in text
