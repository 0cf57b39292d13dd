"""A command takes the options of the task that is chosen, by that task's own words."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import pytest

from dovetail.commands.command_line import find_task, parse
from dovetail.commands.evaluate import Evaluate
from dovetail.commands.serve import Serve
from dovetail.envs.registered import split_settings
from dovetail.errors import ConfigError
from dovetail.learn.config import TrainConfig
from dovetail.settings import Range
from dovetail.tasks.options import gather_options, own_options
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.rail_clip.task import RailClip

CLIP = ["--env", "dovetail/RailClip-v0"]


@dataclass(frozen=True, kw_only=True)
class Screw(RailClip):
    """A task with an option of each kind."""

    size: Literal["M3", "M4"] = "M4"
    """Size of the screw. The usual ones."""
    turns: int = 2
    pitch: Annotated[float, Range(0.0, 0.01, "m")] = 7e-4
    is_left: bool = False


def test_the_options_of_the_chosen_task_are_taken():
    words = ["--peg", "round", "--clearance", "0.001"]
    assert parse(Serve, words).task_options == {"peg": "round", "clearance": 0.001}
    assert parse(Serve, []).task_options == {}
    gear = ["--env", "dovetail/GearMesh-v0", "--clearance", "0.0003"]
    assert parse(Serve, gear).task_options == {"clearance": 0.0003}


def test_an_option_of_another_task_is_not_known(capsys):
    with pytest.raises(SystemExit):
        parse(Serve, [*CLIP, "--peg", "round"])
    assert "--peg" in capsys.readouterr().err


def test_each_plain_field_is_an_option_with_its_type():
    words = ["--size", "M3", "--turns", "3", "--pitch", "1e-3", "--is-left"]
    given = parse(Serve, words, Screw).task_options
    assert given == {"size": "M3", "turns": 3, "pitch": 1e-3, "is_left": True}
    assert set(own_options(Screw)) == set(given)


def changed(name, kind, **rest):
    """A task with one field more, or another word for its fixture."""
    about = {"__annotations__": {name: kind} if name else {}, **rest}
    return dataclass(frozen=True, kw_only=True)(type("Odd", (RailClip,), about))


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (changed("policy", str, policy="x"), "policy of Odd are also options"),
        (changed("mode", Literal["a", 1], mode="a"), "mode is one of 'a', 1; allowed"),
        (changed("thing", "OnlyForTypes", thing=None), "Odd's.*'OnlyForTypes'.*TYPE_"),
        (changed("hole_depth", float, hole_depth=1.0), None),
    ],
)
def test_a_name_that_means_two_things_is_one_message(task, message):
    if message is None:
        assert parse(Evaluate, ["p"], task).task_options == {}
        return
    with pytest.raises(ConfigError, match=message):
        parse(Evaluate, ["p"], task)


def test_what_a_task_works_out_itself_is_no_setting():
    task = changed("derived", float, derived=field(init=False, default=0.0))
    assert "derived" not in own_options(task)
    with pytest.raises(ConfigError, match=r"Odd got an .* argument 'derived'"):
        split_settings(task, {"derived": 1.0})


def test_what_is_resumed_keeps_its_options():
    again = parse(TrainConfig, [], before={"task_options": {"peg": "round"}})
    assert again.task_options["peg"] == "round"


def test_the_task_is_that_of_env():
    assert find_task(["x", *CLIP]) is RailClip
    assert find_task(["--env=dovetail/RailClip-v0"]) is RailClip
    assert find_task([]) is PegInHole
    assert find_task([], CLIP[1]) is RailClip


def test_flat_settings_are_gathered_and_nothing_else():
    found = gather_options({"peg": None, "clearance": 1e-3, "steps": 5}, PegInHole)
    assert found == {"steps": 5, "task_options": {"clearance": 1e-3}}
