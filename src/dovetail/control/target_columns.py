"""A Target as one row of numbers, for logs: all its fields, exactly."""

import numpy as np

from dovetail import _core
from dovetail.errors import ConfigError
from dovetail.types import Array

_TWIST = "x y z a b c"
_SPEED = ("m/s",) * 3 + ("rad/s",) * 3
_ACCELERATION = ("m/s2",) * 3 + ("rad/s2",) * 3
_FIELDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "f_star": (_TWIST, _ACCELERATION),
    "position_d": ("x y z", ("m",) * 3),
    "quat_wxyz_d": ("w x y z", ("1",) * 4),
    "velocity_d": (_TWIST, _SPEED),
    "acceleration_d": (_TWIST, _ACCELERATION),
    "age": ("", ("s",)),
    "near_plane": ("x y z d", ("1", "1", "1", "m")),
    "f_tare": (_TWIST, _ACCELERATION),
    "stay": ("", ("1",)),
    "joint_mode": ("", ("1",)),
    "q_d": ("1 2 3 4 5 6 7", ("rad",) * 7),
}
"""Names of the components of each Target field, and their units."""

TARGET_UNITS: dict[str, str] = {
    f"{field}_{part}".rstrip("_"): unit
    for field, (parts, units) in _FIELDS.items()
    for part, unit in zip(parts.split() or [""], units, strict=True)
}
"""Unit of each column, in order."""

_ENDS = np.cumsum([len(units) for _, units in _FIELDS.values()])[:-1]


def target_row(target: "_core.Target") -> Array:
    """Return a Target's numbers, shape (len(TARGET_UNITS),)."""
    parts = (
        *(target.f_star, target.position_d, target.quat_wxyz_d),
        *(target.velocity_d, target.acceleration_d, target.age, target.near_plane),
        *(target.f_tare, target.stay, target.joint_mode, target.q_d),
    )
    return np.hstack([np.asarray(part, dtype=float) for part in parts])


def target_of(row: Array) -> "_core.Target":
    """Return the Target that a row of `target_row` was.

    Raises:
        ConfigError: A number that no Target can have; says which, and what is allowed.
    """
    parts = dict(zip(_FIELDS, np.split(row, _ENDS), strict=True))
    stay, joint_mode = parts["stay"].item(), parts["joint_mode"].item()
    if stay not in range(8) or joint_mode not in range(2):
        raise ConfigError(
            f"a Target's stay is {stay:g} and its joint_mode {joint_mode:g}; allowed "
            "are 0 to 7, and 0 or 1"
        )
    target = _core.Target(
        f_star=parts["f_star"],
        position_d=parts["position_d"],
        quat_wxyz_d=parts["quat_wxyz_d"],
        joint_mode=bool(joint_mode),
        q_d=parts["q_d"],
    )
    target.velocity_d, target.acceleration_d = (
        parts["velocity_d"],
        parts["acceleration_d"],
    )
    target.age, target.stay = parts["age"].item(), int(stay)
    target.near_plane, target.f_tare = parts["near_plane"], parts["f_tare"]
    try:
        _core.check_target(target)
    except ValueError as error:
        raise ConfigError(f"a Target's {error}") from error
    return target
