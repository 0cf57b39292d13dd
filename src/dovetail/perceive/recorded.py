"""Pictures with the arm's configuration beside each, as a folder."""

import csv
import io
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.errors import ConfigError
from dovetail.files import write_atomic
from dovetail.perceive.opencv import opencv
from dovetail.perceive.picture import read_picture
from dovetail.perceive.rehearsal import Shot
from dovetail.reading import read_text
from dovetail.robots.robot import Robot
from dovetail.types import Array, Vec7

POSES = "poses.csv"
"""The file with a line for each picture."""
COLUMNS = ("picture", *(f"q{i}" for i in range(1, 8)))
"""Its columns: the picture's file, joint angles [rad]."""

_BEYOND = 0.1
"""Largest distance of a measured angle outside of the joint's limits [rad]."""
_WHOLE_TURN = 2.0 * math.pi


def read_shots(
    folder: Path, robot: Robot, say: Callable[[str], None] = lambda text: None
) -> Iterator[Shot]:
    """Yield the pictures of a folder with their configurations.

    Angles of 0 to 2 pi, as some drivers give them, are brought into the joints' range
    by a whole turn.

    Args:
        folder: With pictures and `POSES`.
        robot: The arm, whose joints have limits.
        say: Called with a sentence where angles were turned.

    Raises:
        ConfigError: No such folder, no table of poses, a line that is none, or angles
            that no joint has, as in degrees; names the line.
    """
    table = folder / POSES
    names, angles = _read_table(table)
    turned, is_degrees = _turned(angles, robot), _is_degrees(angles, robot)
    for number, q in enumerate(turned, 2):
        _require_joints(q, robot, f"{table}, line {number}", is_degrees=is_degrees)
    changed = (turned != angles).any(axis=0)
    if changed.any():
        joints = ", ".join(COLUMNS[1 + i] for i in np.flatnonzero(changed))
        say(
            f"{table}: a whole turn, 2 pi, was taken off angles of {joints} that are "
            "outside of the joint's range"
        )
    for name, q in zip(names, turned, strict=True):
        yield Shot(read_picture(folder / name), q)


def _read_table(table: Path) -> tuple[list[str], Array]:
    """Return the pictures' names and the angles [rad], shape (pictures, 7)."""
    try:
        text = read_text(table)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{table} cannot be read ({error}); it has the columns "
            f"{', '.join(COLUMNS)}: a picture's file and the joint angles [rad]"
        ) from error
    try:
        rows = list(csv.DictReader(io.StringIO(text)))
    except csv.Error as error:
        raise ConfigError(f"{table} is no table: {error}") from error
    if not rows or tuple(rows[0]) != COLUMNS:
        raise ConfigError(
            f"{table} needs the columns {', '.join(COLUMNS)} and a line per picture"
        )
    angles = []
    for number, row in enumerate(rows, 2):
        try:
            q = [float(row[name]) for name in COLUMNS[1:]]
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{table}, line {number}: {error}") from error
        if not all(map(math.isfinite, q)):
            raise ConfigError(f"{table}, line {number}: an angle is not finite")
        angles.append(q)
    return [Path(row["picture"]).name for row in rows], np.array(angles)


def _turned(angles: Array, robot: Robot) -> Array:
    """Return angles [rad], those out of a joint's range 2 pi off where that is in it.

    Args:
        angles: As they were given [rad], shape (pictures, 7).
        robot: The arm, whose joints have limits.
    """
    low, high = robot.limits.q_min - _BEYOND, robot.limits.q_max + _BEYOND
    other = angles - np.copysign(_WHOLE_TURN, angles)
    is_out = (angles < low) | (angles > high)
    fits = (other >= low) & (other <= high) & (np.abs(angles) <= _WHOLE_TURN)
    return np.where(is_out & fits, other, angles)


def _is_degrees(angles: Array, robot: Robot) -> bool:
    """Say whether a table is in degrees; angles of up to 2 pi may well be in rad."""
    low, high = robot.limits.q_min - _BEYOND, robot.limits.q_max + _BEYOND
    inside = (np.radians(angles) >= low) & (np.radians(angles) <= high)
    return bool(np.abs(angles).max() > _WHOLE_TURN and inside.all())


def _require_joints(q: Vec7, robot: Robot, where: str, *, is_degrees: bool) -> None:
    """Refuse angles that are far beyond the joints' limits."""
    low, high = robot.limits.q_min, robot.limits.q_max
    outside = np.maximum(low - q, q - high)
    i = int(outside.argmax())
    if outside[i] <= _BEYOND:
        return
    words = "see whether the columns are in order"
    if is_degrees:
        words = "these are degrees instead of radians: multiply by pi / 180"
    raise ConfigError(
        f"{where}: q{i + 1} is {q[i]:g} rad; the joint goes from {low[i]:.2f} "
        f"to {high[i]:.2f} rad: {words}"
    )


def keep_shots(shots: Iterable[Shot], folder: Path) -> Iterator[Shot]:
    """Yield pictures and write each into a folder; the table comes last."""
    cv: Any = opencv()
    lines = [",".join(COLUMNS)]
    for number, shot in enumerate(shots):
        name = f"{number:03d}.png"
        done, content = cv.imencode(".png", shot.picture)
        if not done:
            raise ConfigError(f"picture {number} cannot be written as PNG")
        write_atomic(folder / name, content.tobytes())
        lines.append(",".join([name, *(repr(float(a)) for a in shot.q)]))
        yield shot
    write_atomic(folder / POSES, "\n".join(lines) + "\n")
