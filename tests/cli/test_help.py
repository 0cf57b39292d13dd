"""Each command's help: one screen, and everything behind --help-all."""

import importlib
from dataclasses import fields, is_dataclass
from typing import get_args

import pytest
import tyro

from dovetail.cli import COMMANDS, run
from dovetail.settings import defaults_of, names_in
from dovetail.tasks.options import option_types
from dovetail.tasks.peg_in_hole.task import PegInHole

SCREEN = 55
"""Lines of a help at 80 columns."""


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
WITH_MORE = [
    name
    for name in COMMANDS
    if hasattr(importlib.import_module(f"dovetail.commands.{name}"), "COMMON")
]


def shown(name, capsys, option="--help"):
    with pytest.raises(SystemExit) as stop:
        run([*name.split(), option])
    assert stop.value.code == 0
    return capsys.readouterr().out


def flat(text):
    """Return a help's words without its frame and its line breaks."""
    return " ".join(text.replace("│", " ").split())


@pytest.fixture(autouse=True)
def usual_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.parametrize("name", PAGES)
def test_the_help_of_a_command_is_one_screen(name, capsys):
    assert len(shown(name, capsys).splitlines()) <= SCREEN


@pytest.mark.parametrize("name", PAGES)
def test_everything_is_said_with_help_all(name, capsys):
    text = shown(name, capsys, "--help-all")
    for field in fields(PAGES[name]):
        option = f"--{field.name.replace('_', '-')}"
        is_positional = tyro.conf.Positional in getattr(field.type, "__metadata__", ())
        assert option in text or is_positional or field.name == "task_options", option


@pytest.mark.parametrize("name", [n for n in PAGES if "robot" in names_in(PAGES[n])])
def test_a_robot_may_be_a_file_on_every_command(name, capsys):
    text = shown(name, capsys, "--help-all")
    assert "Robot: a name, .urdf or .xml file, menagerie:NAME" in flat(text)


@pytest.mark.parametrize("name", WITH_MORE)
def test_the_short_help_lists_settings_that_there_are(name, capsys):
    common = vars(importlib.import_module(f"dovetail.commands.{name}"))["COMMON"]
    assert len(set(common)) == len(common)
    assert set(common) <= {f.name for f in fields(PAGES[name])}
    text = shown(name, capsys)
    more = len(fields(PAGES[name])) - len(common)
    assert f"{more} more options: --help-all" in text


@pytest.mark.parametrize("option", ["--help", "--help-all"])
@pytest.mark.parametrize("name", ["train", "evaluate", "export", "serve", "cabinet"])
def test_the_options_of_the_task_are_listed(name, option, capsys):
    text = shown(name, capsys, option)
    for own in option_types(PegInHole):
        assert f"--{own.replace('_', '-')} " in text


@pytest.mark.parametrize("name", PAGES)
def test_a_value_that_may_be_left_out_is_not_called_none(name, capsys):
    assert "None" not in shown(name, capsys)


@pytest.mark.parametrize("name", ["train", "evaluate"])
def test_a_switch_that_is_not_off_by_default_can_be_turned_off(name, capsys):
    text = shown(name, capsys, "--help-all")
    switches = [f.name for f in fields(PAGES[name]) if f.type in (bool, bool | None)]
    usual = defaults_of(PAGES[name])
    for switch in switches:
        option = switch.replace("_", "-")
        assert f"--{option}" in text
        assert (f"--no-{option}" in text) == (usual[switch] is not False)


@pytest.mark.parametrize("name", PAGES)
def test_the_help_keeps_to_the_terminal(name, capsys):
    _, *lines = shown(name, capsys).splitlines()  # the first is the usage
    assert max(map(len, lines)) <= 80
