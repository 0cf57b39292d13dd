"""Records of settings: every field is checked, and an error carries its facts."""

import pickle
from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.settings import (
    Range,
    check_values,
    defaults_of,
    names_in,
    ranges_of,
    settings,
    values_of,
)


@settings(eq=False)
class Springs:
    """Springs of two joints."""

    stiffness: Annotated[np.ndarray, Range(0.0, 10.0, "Nm/rad", ("A1", "A2"))]
    """Their stiffness."""
    turns: Annotated[int, Range(1, 5, "turns")] = 2
    """Turns of each."""


@settings(owner="box")
class Box(Springs):
    """A box with springs in it."""

    word: Literal["open", "shut"] = "shut"
    """How it is."""
    file: Path | None = None
    """Its drawing."""
    sides: tuple[float, ...] = ()
    """Lengths."""
    is_heavy: bool = False
    """True if it is."""


GIVEN = {"stiffness": 3.0}


def test_a_record_has_the_fields_of_those_it_inherits():
    box = Box(**GIVEN, file="a.svg", sides=[1, 2])
    assert set(names_in(Box)) == {
        *("stiffness", "turns", "word", "file", "sides", "is_heavy")
    }
    np.testing.assert_array_equal(box.stiffness, [3.0, 3.0])
    assert (box.file, box.sides, box.turns) == (Path("a.svg"), (1.0, 2.0), 2)
    assert values_of(box)["sides"] == (1.0, 2.0)
    assert "stiffness" not in defaults_of(Box)
    assert defaults_of(Box)["turns"] == 2
    assert set(ranges_of(Box)) == {"stiffness", "turns"}


@pytest.mark.parametrize(
    ("given", "name", "value", "unit", "allowed"),
    [
        ({"stiffness": [1.0, 11.0]}, "stiffness[A2]", 11.0, "Nm/rad", (0.0, 10.0)),
        ({"stiffness": ["a", 1.0]}, "stiffness[A1]", "a", "Nm/rad", (0.0, 10.0)),
        ({"stiffness": np.nan}, "stiffness[A1]", None, "Nm/rad", (0.0, 10.0)),
        ({"stiffness": [1.0] * 3}, "stiffness", (1.0,) * 3, "Nm/rad", (0.0, 10.0)),
        ({"turns": 6}, "turns", 6, "turns", (1, 5)),
        ({"turns": 1.5}, "turns", 1.5, "turns", (1, 5)),
        ({"turns": True}, "turns", True, "turns", (1, 5)),
        ({"turns": None}, "turns", None, "turns", (1, 5)),
        ({"word": "ajar"}, "word", "ajar", "1", ("open", "shut")),
        ({"file": 3}, "file", 3, "1", ()),
        ({"sides": "12"}, "sides", "12", "1", ()),
        ({"sides": ["a"]}, "sides", "a", "1", ()),
        ({"is_heavy": "perhaps"}, "is_heavy", "perhaps", "1", ()),
        ({"is_heavy": "no"}, "is_heavy", "no", "1", ()),
        ({"is_heavy": 1}, "is_heavy", 1, "1", ()),
        ({"sides": ["1"]}, "sides", "1", "1", ()),
        ({"sides": [True]}, "sides", True, "1", ()),
    ],
)
def test_a_wrong_value_is_an_error_with_its_facts(given, name, value, unit, allowed):
    with pytest.raises(ConfigError) as caught:
        Box(**GIVEN | given)
    error = caught.value
    assert (error.name, error.unit, error.allowed) == (name, unit, allowed)
    if value is not None:
        assert error.value == value
    assert str(error).startswith(f"box {name} ")


def test_a_record_with_arrays_is_equal_to_itself_alone():
    @settings()
    class Lid:
        """A lid."""

        size: float = 1.0
        """Its size."""

    @settings(eq=False)
    class Chest(Springs, Lid):
        """A chest."""

    first, second = Chest(stiffness=1.0), Chest(stiffness=2.0)
    assert first != second
    assert first == first
    assert Lid() == Lid()


def test_an_unknown_setting_is_named_with_the_nearest_known_one():
    with pytest.raises(ConfigError) as caught:
        Box(**GIVEN, turn=3)
    assert caught.value.name == "turn"
    assert "turns" in caught.value.allowed
    assert "did you mean turns?" in str(caught.value)


def test_a_setting_without_a_default_must_be_given():
    with pytest.raises(ConfigError) as caught:
        Box()
    assert caught.value.name == "stiffness"


def test_a_record_cannot_be_changed_and_its_copy_is_checked():
    box = Box(**GIVEN)
    with pytest.raises(FrozenInstanceError):
        box.turns = 3
    with pytest.raises(ValueError, match="read-only"):
        box.stiffness[0] = 1.0
    assert replace(box, turns=4).turns == 4
    with pytest.raises(ConfigError):
        replace(box, turns=9)


def test_a_record_and_its_error_can_be_sent_to_another_process():
    box = pickle.loads(pickle.dumps(Box(**GIVEN, sides=(1.0,))))
    assert box.sides == (1.0,)
    error = ConfigError("a", name="b", value=1, unit="m", allowed=(0, 1))
    again = pickle.loads(pickle.dumps(error))
    assert vars(again) == vars(error)
    assert str(again) == "a"


def test_a_record_in_a_record_is_given_as_one():
    @settings()
    class Crate:
        """A crate."""

        box: Box | None = None
        """What is in it."""

    box = Box(**GIVEN)
    assert Crate(box=box).box is box
    with pytest.raises(ConfigError) as caught:
        Crate(box={"stiffness": 1.0})
    assert caught.value.name == "box"


def test_settings_are_checked_alone():
    assert check_values(Box, {"sides": [1.0], "file": "a"}) == {
        "sides": (1.0,),
        "file": Path("a"),
    }
    with pytest.raises(ConfigError) as caught:
        check_values(Box, {"turns": 9})
    assert caught.value.name == "turns"
