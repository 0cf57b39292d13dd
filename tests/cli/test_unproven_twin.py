"""What lies outside that for which the limits are proven is named by every command."""

import io
import subprocess
import sys
import warnings
from dataclasses import replace

import gymnasium as gym
import pytest
from rich.console import Console

from dovetail.cli import run
from dovetail.commands.cockpit import Cockpit
from dovetail.commands.command_line import parse
from dovetail.commands.unproven import warn_of_arm
from dovetail.control.config import LimitConfig
from dovetail.errors import ConfigError, UnprovenWarning
from dovetail.learn.config import TrainConfig
from dovetail.plants.twin import list_twins, load_twin
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot_text import write_robot_text


def said_of(twin, arm=None):
    out = io.StringIO()
    warn_of_arm(Console(file=out, width=1000), twin, arm)
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
    assert "shown to hold: 0 to 20 %; give a robot" in mass


@pytest.mark.parametrize("twin", [None, *list_twins()])
def test_nothing_is_said_of_what_is_inside(twin):
    assert said_of(twin) == []
    assert said_of(None, "mujoco") == []


@pytest.mark.parametrize("arm", ["fri://0.0.0.0", "grpc://127.0.0.1"])
def test_margins_of_an_exact_arm_are_named(arm):
    (text,) = said_of(None, f"{arm}?margins=model")
    assert text.startswith(f"warning: arm '{arm}?margins=model' has margins=model")
    assert text.endswith("leave margins out, or use them with a simulated arm")
    assert said_of(None, arm) == []


BEYOND = ["--delay", "12ms", "--mass-error", "0.25", "--payload-error", "1.2"]


@pytest.mark.parametrize(
    "words",
    [
        ["evaluate", "peg_square", "--tries", "1", "--max-steps", "2", "--no-tare"],
        ["identify", "record", "--sequences", "1", "--steps", "2"],
    ],
)
def test_what_is_declared_reaches_the_arm_and_is_named(
    tmp_path, capsys, monkeypatch, words
):
    built = []
    make = LimitConfig.for_period.__func__

    def keep(*args, **given):
        built.append(given)
        return make(LimitConfig, *args, **given)

    monkeypatch.setattr(LimitConfig, "for_period", keep)
    words = [*words, *BEYOND, "--arm", "twin:medium", "--out", str(tmp_path / "out")]
    assert run(words) == 0
    delay, mass, payload, *_ = capsys.readouterr().out.splitlines()
    assert delay == (
        "warning: as declared, the loop's delay is 12 ms, for which the limits are "
        "unproven; shown to hold: 0 to 10 ms; shorten it, or keep the arm away from "
        "people and expect stops"
    )
    assert mass.startswith("warning: as declared, the error of a link's mass is 25 %")
    assert payload.startswith("warning: as declared, the payload's error is 1.2 kg")
    wanted = {"delay": 0.012, "mass_error": 0.25, "payload_error": 1.2}
    assert all(wanted.items() <= given.items() for given in built)
    assert built


def test_the_cockpit_and_a_training_take_what_is_declared():
    wanted = {"delay": 0.012, "mass_error": 0.25, "payload_error": 1.2}
    assert wanted.items() <= parse(Cockpit, BEYOND).choice().settings.items()
    config = parse(TrainConfig, BEYOND)
    assert config.env_options()["delay"] == 0.012
    assert "--delay 12ms" in config.command()


@pytest.mark.parametrize(
    ("text", "message"),
    [("12", "--delay is '12'; give a number and its unit"), ("60ms", "0 to 0.05 s")],
)
def test_a_delay_that_is_none_is_refused(capsys, text, message):
    try:
        code = run(["evaluate", "peg_square", "--twin", "easy", "--delay", text])
    except SystemExit as stop:  # tyro's own
        code = stop.code
    assert code == 2
    said = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert message in said


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


def test_the_cabinet_says_it_before_it_begins(far, capsys, monkeypatch):
    """It said nothing of the masses."""
    monkeypatch.setattr("dovetail.commands.cabinet.Server", _no_server)
    assert run(["cabinet", "--twin", str(far), "--control", "none"]) == 2
    mass, delay = capsys.readouterr().out.splitlines()
    assert mass.startswith("cabinet: warning: the error of a link's mass is 30 %")
    assert delay.startswith("cabinet: warning: delay is 15 ms of the twin")


def test_the_cabinet_says_what_is_noted_of_its_robot(capsys, monkeypatch):
    monkeypatch.setattr("dovetail.commands.cabinet.Server", _no_server)
    text = write_robot_text(replace(iiwa14(), name="told", notes=("a note",)))
    assert run(["cabinet", "--robot", text, "--control", "none"]) == 2
    lines = capsys.readouterr().out.splitlines()
    assert lines.count("cabinet: note: a note") == 1


def _no_server(*args, **options):
    raise ConfigError("no server here")


def test_in_python_an_environment_warns_once_by_field(far):
    with warnings.catch_warnings(record=True) as caught:
        warnings.resetwarnings()
        for _ in range(2):
            gym.make("dovetail/PegInHole-v0", twin=str(far)).close()
        gym.make("dovetail/PegInHole-v0", arm=f"twin:{far}").close()
    said = [str(w.message) for w in caught if w.category is UnprovenWarning]
    delay, mass = said
    assert delay.startswith(f"twin {far}, command_delay: the loop's delay is 15 ms")
    assert "shown to hold: 0 to 10 ms" in delay
    assert mass.startswith(
        f"twin {far}, mass_scale: the error of a link's mass is 30 %"
    )


@pytest.mark.parametrize("place", [{}, {"twin": "hard"}, {"arm": "twin:medium"}])
def test_in_python_nothing_is_said_of_what_is_inside(place):
    with warnings.catch_warnings():
        warnings.simplefilter("error", UnprovenWarning)
        gym.make("dovetail/PegInHole-v0", **place).close()


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_command_does_not_say_it_twice(far, tmp_path, workers):
    words = ["evaluate", "peg_square", "--tries", "1", "--twin", str(far)]
    words += ["--max-steps", "2", "--no-tare", "--workers", workers]
    done = subprocess.run(
        [sys.executable, "-m", "dovetail", *words, "--out", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.count("the loop's delay is 15 ms") == 1
    assert "UnprovenWarning" not in done.stderr
