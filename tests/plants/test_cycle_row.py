"""The layout of a cycle's row and of its flags: old logs hold these numbers."""

import numpy as np

from dovetail import _core
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS, CYCLE_UNITS, FLAG_MASK

JOINTS = range(1, 8)
OLD_COLUMNS = (
    "time",
    *(f"{stem}{i}" for stem in ("q", "dq", "tau") for i in JOINTS),
    *("x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz"),
    *("fx", "fy", "fz", "fsx", "fsy", "fsz", "flags"),
)
WRENCH = [f"wrench_{part}{axis}" for part in "fm" for axis in "xyz"]
OLD_BITS = {
    **{"joint_position": 0, "joint_velocity": 7, "joint_acceleration": 14},
    **{"torque": 21, "wall_position": 28, "wall_velocity": 31},
    **{"wall_acceleration": 34, "wall_displaced": 37, "bad_input": 40, "unsafe": 41},
    **{"qp_early": 42, "target_late": 43, "stopped": 44, "implausible": 45},
    "ended": 46,
}


def test_columns_are_those_of_every_log_so_far():
    assert (*OLD_COLUMNS, *WRENCH) == CYCLE_COLUMNS
    more = [f"tau_{kind}{i}" for kind in ("measured", "external") for i in JOINTS]
    more += ["sequence", "motion", "elapsed", "reason"]
    assert _core.servo_columns() == [*CYCLE_COLUMNS, *more]
    assert CYCLE_UNITS["dq7"] == "rad/s"
    assert CYCLE_UNITS["fsx"] == "m/s2"
    assert (CYCLE_UNITS["wrench_fx"], CYCLE_UNITS["wrench_mz"]) == ("N", "Nm")


def test_flags_have_the_bits_of_every_log_so_far_and_share_none():
    lowest = {name: (mask & -mask).bit_length() - 1 for name, mask in FLAG_MASK.items()}
    assert lowest == OLD_BITS
    assert sum(FLAG_MASK.values()) == (1 << 47) - 1


def test_a_row_has_each_number_in_its_column(rng):
    parts = {"q": 7, "dq": 7, "tau": 7, "position": 3, "quat_wxyz": 4, "twist": 6}
    parts |= {"contact_force": 3, "f_star": 3}
    vectors = {name: rng.normal(size=size) for name, size in parts.items()}
    wrench = rng.normal(size=6)
    row = _core.cycle_row(time=0.25, flags=_core.Flags(), wrench=wrench, **vectors)
    numbers = [0.25, *np.concatenate([*vectors.values()]), 0, *wrench]
    np.testing.assert_array_equal(row, numbers)
    assert row[COLUMN["fx"]] == vectors["contact_force"][0]
