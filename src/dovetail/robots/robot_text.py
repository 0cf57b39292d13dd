"""A robot as one text that names no file: what settings and a policy carry of it."""

import json
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from dovetail.errors import ConfigError
from dovetail.reading import parse_json
from dovetail.robots.arrays import ArrayFacts
from dovetail.robots.geometry import Geometry
from dovetail.robots.links import Links
from dovetail.robots.motors import Motors
from dovetail.robots.robot import Robot
from dovetail.robots.robot_limits import RobotLimits

Part = TypeVar("Part", bound=ArrayFacts)

TEXT_MAX = 100_000
"""Longest text [characters]; an arm takes about 8,000."""
_NAME_MAX = 60
_NOTES, _NOTE_MAX = 60, 2_000
_KEYS = ("name", "gripper", "arrays", "coulomb", "postures", "notes", "motor_notes")
_POSTURES = ("down", "forward", "rest")


def write_robot_text(robot: Robot) -> str:
    """Return a bare robot as a text; its meshes are left out, as they are files.

    Its name and notes are cut to what `read_robot_text` takes: they come from a file.
    """
    motor_notes = robot.motors.notes
    arrays = {n: a.tolist() for n, a in robot.arrays().items() if np.isfinite(a).all()}
    table = {
        "name": _shown(robot.name, _NAME_MAX),
        "gripper": robot.gripper,
        "arrays": arrays,
        "coulomb": robot.motors.coulomb.tolist(),
        "postures": {name: q.tolist() for name, q in robot.postures.items()},
        "notes": [_shown(one, _NOTE_MAX) for one in robot.notes[:_NOTES]],
        "motor_notes": [_shown(one, _NOTE_MAX) for one in motor_notes[:_NOTES]],
    }
    return json.dumps(table, allow_nan=False, separators=(", ", ": "))


def _shown(text: str, most: int) -> str:
    """Return the first characters of a text, those that no terminal shows as spaces."""
    return "".join(c if c.isprintable() else " " for c in text[:most])


@lru_cache(maxsize=64)
def read_robot_text(text: str) -> Robot:
    """Return the robot of a text. Nothing in it is executed, and no file is read.

    Raises:
        ConfigError: It is too long, has an unknown or missing key, or is no arm.
    """
    if len(text) > TEXT_MAX:
        raise ConfigError(
            f"the robot has {len(text)} characters; allowed: up to {TEXT_MAX}"
        )
    table = parse_json(text, "the robot", is_finite=True)
    if not isinstance(table, dict) or set(table) != set(_KEYS):
        raise ConfigError(
            f"the robot is {text[:60]!r}...; needed: the keys {', '.join(_KEYS)}, as a "
            "training writes them"
        )
    arrays, postures = table["arrays"], table["postures"]
    parts = Geometry, Links, RobotLimits, Motors
    _require_known("arrays", arrays, [name for part in parts for name in part.shapes])
    _require_known("postures", postures, _POSTURES)

    def part(kind: type[Part], **more: Any) -> Part:
        given = {n: _numbers(arrays[n], n) for n in kind.shapes if n in arrays}
        try:
            return kind(**given, **more)
        except TypeError as error:  # an array without a default is missing
            raise ConfigError(f"the robot's arrays are incomplete: {error}") from error

    notes = {name: _notes(table[name], name) for name in ("notes", "motor_notes")}
    coulomb = _numbers(table["coulomb"], "coulomb")
    return Robot(
        name=_word("name", table["name"]),
        gripper=_word("gripper", table["gripper"]),
        geometry=part(Geometry),
        links=part(Links),
        limits=part(RobotLimits),
        motors=part(Motors, coulomb=coulomb, notes=notes["motor_notes"]),
        postures={name: _numbers(q, name) for name, q in postures.items()},
        notes=notes["notes"],
    )


def _require_known(name: str, table: Any, known: Iterable[str]) -> None:
    """Refuse what is no table, and a key that is not known."""
    unknown = set(table) - set(known) if isinstance(table, Mapping) else {"no table"}
    if unknown:
        said = ", ".join(sorted(unknown))[:80]
        raise ConfigError(f"the robot's {name}: {said}; known: {', '.join(known)}")


def _numbers(value: Any, name: str) -> Any:
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"the robot's {name} is no array of numbers") from error


def _word(name: str, value: Any) -> str:
    if not isinstance(value, str) or not value.isprintable() or len(value) > _NAME_MAX:
        raise ConfigError(
            f"the robot's {name} is {str(value)[:60]!r}; give a text of up to "
            f"{_NAME_MAX} characters"
        )
    return value


def _notes(value: Any, name: str) -> tuple[str, ...]:
    """Return notes that a terminal can show."""
    if (
        not isinstance(value, list)
        or len(value) > _NOTES
        or not all(
            isinstance(one, str) and one.isprintable() and len(one) <= _NOTE_MAX
            for one in value
        )
    ):
        raise ConfigError(
            f"the robot's {name}: needed are up to {_NOTES} texts of up to {_NOTE_MAX} "
            "characters"
        )
    return tuple(value)
