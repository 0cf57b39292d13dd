"""Pictures with the arm's configuration beside each, as a folder."""

import csv
import io
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.errors import ConfigError
from dovetail.files import write_atomic
from dovetail.perceive.opencv import opencv
from dovetail.perceive.rehearsal import Shot
from dovetail.perceive.sources import read_picture
from dovetail.robots.robot import Robot
from dovetail.types import Vec7

POSES = "poses.csv"
"""The file with a line for each picture."""
COLUMNS = ("picture", *(f"q{i}" for i in range(1, 8)))
"""Its columns: the picture's file, joint angles [rad]."""

_BEYOND = 0.1
"""How far a measured angle may lie outside of the joint's limits [rad]."""


def read_shots(folder: Path, robot: Robot) -> Iterator[Shot]:
    """Yield the pictures of a folder with their configurations.

    Args:
        folder: With pictures and `POSES`.
        robot: The arm, whose joints have limits.

    Raises:
        ConfigError: No such folder, no table of poses, a line that is none, or angles
            that no joint has, as in degrees; names the line.
    """
    table = folder / POSES
    try:
        text = table.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{table} cannot be read ({error}); it has the columns "
            f"{', '.join(COLUMNS)}: a picture's file and the joint angles [rad]"
        ) from error
    rows = list(csv.DictReader(io.StringIO(text)))
    if not rows or tuple(rows[0]) != COLUMNS:
        raise ConfigError(
            f"{table} needs the columns {', '.join(COLUMNS)} and a line per picture"
        )
    for number, row in enumerate(rows, 2):
        try:
            q = np.array([float(row[name]) for name in COLUMNS[1:]])
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{table}, line {number}: {error}") from error
        if not all(map(math.isfinite, q)):
            raise ConfigError(f"{table}, line {number}: an angle is not finite")
        _require_joints(q, robot, f"{table}, line {number}")
        yield Shot(read_picture(folder / Path(row["picture"]).name), q)


def _require_joints(q: Vec7, robot: Robot, where: str) -> None:
    """Refuse angles that are far beyond the joints' limits."""
    low, high = robot.limits.q_min, robot.limits.q_max
    outside = np.maximum(low - q, q - high)
    i = int(outside.argmax())
    if outside[i] <= _BEYOND:
        return
    words = "see whether the columns are in order"
    if (np.radians(q) >= low).all() and (np.radians(q) <= high).all():
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
