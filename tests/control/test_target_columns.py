"""A Target and its row of numbers are the same thing."""

import json

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.target_columns import TARGET_UNITS, target_of, target_row
from dovetail.errors import ConfigError


def random_target(rng):
    """A Target none of whose fields is what it is from the start."""
    target = _core.Target(
        f_star=rng.normal(size=6), position_d=rng.normal(size=3), joint_mode=True
    )
    target.quat_wxyz_d = np.array([0.6, 0.0, -0.8, 0.0])
    target.velocity_d, target.acceleration_d = rng.normal(size=(2, 6))
    target.f_tare, target.q_d = rng.normal(size=6), rng.normal(size=7)
    target.near_plane = np.array([0.0, 0.6, 0.8, rng.normal()])
    target.age, target.stay = rng.uniform(), 5
    return target


def values_of(target):
    """Every public attribute of a Target, as numbers."""
    names = [name for name in vars(_core.Target) if not name.startswith("_")]
    return {name: np.ravel(getattr(target, name)).tolist() for name in names}


@pytest.mark.parametrize("seed", range(3))
def test_every_field_comes_back_also_from_json(seed):
    target = random_target(np.random.default_rng(seed))
    untouched = values_of(_core.Target())
    assert all(value != untouched[name] for name, value in values_of(target).items())
    row = target_row(target)
    assert len(row) == len(TARGET_UNITS)
    again = np.array(json.loads(json.dumps(row.tolist())))
    assert values_of(target_of(again)) == values_of(target)


def test_a_target_that_is_near_nothing_comes_back_too():
    row = json.loads(json.dumps(target_row(_core.Target()).tolist()))
    assert values_of(target_of(np.array(row))) == values_of(_core.Target())


def test_columns_have_the_units_of_what_they_name():
    numbers = target_row(random_target(np.random.default_rng(0)))
    found = dict(zip(TARGET_UNITS, numbers, strict=True))
    assert (found["quat_wxyz_d_y"], found["near_plane_z"], found["stay"]) == (
        -0.8,
        0.8,
        5,
    )
    assert (TARGET_UNITS["velocity_d_b"], TARGET_UNITS["f_star_z"]) == ("rad/s", "m/s2")


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("stay", 8.0, "stay is 8 and its joint_mode 0; allowed are 0 to 7"),
        ("stay", np.nan, "stay is nan"),
        ("joint_mode", 0.5, "its joint_mode 0.5"),
        ("quat_wxyz_d_w", 0.0, "quat_wxyz_d"),
        ("f_star_c", 1e12, r"f_star\[5\] is 1e\+12"),
        ("near_plane_d", np.nan, r"near_plane\[3\]"),
        ("age", -1.0, "age is -1 s"),
    ],
)
def test_a_row_that_no_target_can_be_is_refused(column, value, message):
    row = target_row(_core.Target())
    row[list(TARGET_UNITS).index(column)] = value
    with pytest.raises(ConfigError, match=message):
        target_of(row)
