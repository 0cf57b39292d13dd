"""A results folder is of one configuration, for one command at a time."""

import json

import pytest

from dovetail.errors import ConfigError
from dovetail.plants.twin import load_twin
from dovetail.reproduce.folder import locked, open_folder, write_twins

SETTINGS = {"seed": 0, "budget": {"name": "quick", "shifts": (0.0, 0.02)}}


def test_the_same_settings_go_on_in_the_same_folder(tmp_path):
    root = open_folder(tmp_path / "out", SETTINGS)
    assert open_folder(tmp_path / "out", SETTINGS) == root


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (SETTINGS | {"seed": 1}, "seed is 0 there and 1 here"),
        ({"seed": 0, "budget": {"name": "full"}}, "budget.name is 'quick' there"),
    ],
)
def test_other_settings_are_refused_and_nothing_is_changed(tmp_path, settings, message):
    root = open_folder(tmp_path / "out", SETTINGS)
    before = (root / "reproduce.json").read_bytes()
    with pytest.raises(ConfigError) as error:
        open_folder(tmp_path / "out", settings)
    assert message in str(error.value)
    assert "nothing was changed" in str(error.value)
    assert (root / "reproduce.json").read_bytes() == before


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(ConfigError, match=r"is not empty \(it holds thesis\.tex\)"):
        open_folder(tmp_path, SETTINGS)


def test_damaged_settings_are_named(tmp_path):
    root = open_folder(tmp_path / "out", SETTINGS)
    (root / "reproduce.json").write_text("{")
    with pytest.raises(ConfigError, match=r"reproduce\.json is damaged"):
        open_folder(root, SETTINGS)


def test_a_second_command_in_the_folder_is_refused(tmp_path):
    with (
        locked(tmp_path),
        pytest.raises(ConfigError, match="another `dovetail reproduce` works"),
        locked(tmp_path),
    ):
        pass
    with locked(tmp_path):
        pass


def test_the_folder_keeps_the_twins_it_was_measured_on(tmp_path):
    medium = load_twin("medium")
    write_twins(tmp_path, {"medium": medium})
    assert load_twin(tmp_path / "twins" / "medium.toml") == medium
    assert load_twin(tmp_path / "twins" / "medium-in-drake.toml").engine == "drake"


def test_the_settings_are_readable(tmp_path):
    root = open_folder(tmp_path / "out", SETTINGS)
    assert json.loads((root / "reproduce.json").read_text())["budget"]["shifts"] == [
        0.0,
        0.02,
    ]
