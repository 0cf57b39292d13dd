"""A twin outside that for which the limits are proven is named by every command."""

import io
from dataclasses import replace

import pytest
from rich.console import Console

from dovetail.cli import run
from dovetail.commands.unproven import warn_of_twin
from dovetail.plants.twin import list_twins, load_twin


def said_of(twin, arm=None):
    out = io.StringIO()
    warn_of_twin(Console(file=out, width=1000), twin, arm)
    return out.getvalue().splitlines()


@pytest.fixture
def far(tmp_path):
    """File of a twin that is later, and heavier, than the limits were made for."""
    file = tmp_path / "far.toml"
    masses = (1.3,) + (1.0,) * 6
    twin = replace(load_twin("medium"), command_delay=0.015, mass_scale=masses)
    file.write_text(twin.to_toml())
    return file


def test_delay_and_masses_are_named_with_value_range_and_remedy(far):
    delay, mass = said_of(far)
    assert said_of(None, f"twin:{far}") == [delay, mass]
    assert "the loop's delay is 15 ms" in delay
    assert "shown to hold: 0 to 10 ms; shorten it" in delay
    assert "the error of a link's mass is 30 %" in mass
    assert "shown to hold: 0 to 20 %; identify the arm" in mass


@pytest.mark.parametrize("twin", [None, *list_twins()])
def test_nothing_is_said_of_what_is_inside(twin):
    assert said_of(twin) == []
    assert said_of(None, "mujoco") == []


@pytest.mark.parametrize(
    "words",
    [
        ["demo", "--tries", "1", "--twin", "FAR"],
        ["evaluate", "peg_square", "--tries", "1", "--twin", "FAR"],
        ["identify", "record", "--sequences", "1", "--steps", "2", "--arm", "twin:FAR"],
    ],
)
def test_a_command_says_it_before_it_begins(far, tmp_path, capsys, words):
    words = [word.replace("FAR", str(far)) for word in words]
    assert run([*words, "--out", str(tmp_path / "out")]) == 0
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert first.startswith(f"warning: twin {far}: the loop's delay is 15 ms")
    assert second.startswith(f"warning: twin {far}: the error of a link's mass is 30 %")
