"""Robots are found by name, and a stranger's by module:function."""

import numpy as np
import pytest

from dovetail.control.config import LimitConfig
from dovetail.errors import ConfigError
from dovetail.robots.find import find_robot, list_robots
from dovetail.robots.iiwa14 import iiwa14

OWN = """
from dataclasses import replace
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.motors import Motors

def strong():
    return replace(iiwa14(), name="strong", motors=Motors(armature=[0.2] * 7))

def nothing():
    return 7
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "own_arm.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)


def test_a_file_in_the_folder_is_a_robot():
    assert list_robots() == (
        "fr3",
        "gen3",
        "iiwa14",
        "iiwa7",
        "med14",
        "panda",
        "sawyer",
    )
    assert find_robot().name == "iiwa14-drake"


def test_an_unknown_name_lists_the_known():
    known = ", ".join(list_robots())
    with pytest.raises(
        ConfigError, match=f"'kr16' is unknown; known: {known}; or give"
    ):
        find_robot("kr16")


def test_a_robot_of_a_stranger_is_named_by_module_and_function(own):
    robot = find_robot("own_arm:strong")
    limits = LimitConfig.for_period(robot, 0.001)
    np.testing.assert_array_equal(limits.armature, np.full(7, 0.2))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("own_arm:strongest", "no function 'strongest' in a module 'own_arm'"),
        ("no_arm:strong", "PYTHONPATH"),
        ("own_arm:nothing", "gave a int"),
    ],
)
def test_what_is_no_robot_is_refused(own, name, words):
    with pytest.raises(ConfigError, match=words):
        find_robot(name)


def test_an_inertia_set_is_put_on_the_bare_arm():
    lbr, back = iiwa14("lbr"), iiwa14("lbr").with_inertia("drake")
    assert (lbr.name, back.name) == ("iiwa14-lbr", "iiwa14-drake")
    np.testing.assert_array_equal(back.links.mass, iiwa14().links.mass)
    with pytest.raises(ConfigError, match="known: drake, pybullet, lbr"):
        lbr.with_inertia("kuka")
