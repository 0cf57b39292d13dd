"""Plain strips of a fixture beside its opening, on which a held part is slid."""

from typing import NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, matrix_from_quat
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.tasks.task import Task
from dovetail.types import Vec3, Vec4
from dovetail.workcell.near_mouth import inside, sections_near_mouth
from dovetail.workcell.workcell import Workcell

STRIPS = 2
HALF_MAX, HALF_MIN = 0.025, 0.012
"""Longest and shortest half way along a strip [m]."""
EDGE = 0.004
"""Distance that a part keeps from the edges of a strip [m]."""
_ROUNDING = 1e-9  # m
_SAMPLES = 15
"""Points along and across a strip under which the fixture must be."""


class Strip(NamedTuple):
    """Plain strip, world axes."""

    middle: Vec3
    """Point on the surface, in the middle [m]."""
    along: Vec3
    """Unit vector of the way on it."""
    normal: Vec3
    """Unit vector out of the surface."""
    half: float
    """Half of the way of the TCP [m]."""
    quat_wxyz: Vec4
    """Rotation of the tool, its end flat on the surface."""


def plain_strips(task: Task, cell: Workcell, fixture: Pose) -> tuple[Strip, Strip]:
    """Return a strip along the fixture's x and one along its y, beside its opening.

    Args:
        task: Tells of the opening, and how the tool points.
        cell: Its held part is slid.
        fixture: Where the fixture is.

    Raises:
        ConfigError: The task tells of no opening, its fixture stands out over the
            mouth, or has no plain surface for the part beside it.
    """
    outline = task.outline()
    proud = float(cell.fixture.corners[:, 2].max())
    if outline is None or outline.is_post or proud > EDGE / 10.0:
        raise ConfigError(
            f"the {cell.fixture.name} has no plain surface beside an opening: record "
            f"contact with a fixture that has one, such as that of {DEFAULT_ENV}, or "
            "leave --contact out"
        )
    held = cell.held.corners
    end = held[held[:, 2] > held[:, 2].max() - EDGE / 10.0]
    size = float(np.abs(end[:, :2]).max())
    opening = np.abs(outline.opening).max(axis=0)
    goal = task.goal(fixture)
    R = matrix_from_quat(fixture.quat_wxyz)

    def strip(along: int) -> Strip:
        across = 1 - along
        begin, outer = float(opening[across]), outline.outer
        half = min(HALF_MAX, outer - size - EDGE)
        width = outer - begin
        if half < HALF_MIN or width < 2.0 * size:
            raise ConfigError(
                f"the {cell.fixture.name} has {1e3 * width:.1f} mm of plain surface "
                f"beside its opening, and the {cell.held.name} is "
                f"{2e3 * size:.1f} mm wide: record contact with a wider one, or leave "
                "--contact out"
            )
        at = 0.5 * (begin + outer)
        _require_under(cell, along, at, (half + size, size))
        middle = fixture.position + at * R[:, across]
        return Strip(middle, R[:, along], R[:, 2], half, goal.quat_wxyz)

    return strip(0), strip(1)


def _require_under(
    cell: Workcell, along: int, at: float, half: tuple[float, float]
) -> None:
    """Refuse a strip that is not all on the fixture.

    Args:
        cell: Of the fixture, in its own frame.
        along: Axis of the strip, 0 or 1.
        at: Its middle on the other axis [m].
        half: Half sizes of what the part covers along it and across [m].
    """
    way, aside = (np.linspace(-size, size, _SAMPLES) for size in half)
    points = np.stack(np.meshgrid(way, at + aside), axis=-1).reshape(-1, 2)
    if along == 1:
        points = points[:, ::-1]
    is_under = np.zeros(len(points), dtype=bool)
    for line in sections_near_mouth(cell.fixture, EDGE):
        is_under |= inside(line, points).min(axis=0) > -_ROUNDING
    if not is_under.all():
        x, y = 1e3 * points[~is_under][0]
        raise ConfigError(
            f"the {cell.fixture.name} has no plain surface for the {cell.held.name} "
            f"beside its opening: nothing is under it {x:.1f} {y:.1f} mm from the "
            "middle; record contact with a wider one, or leave --contact out"
        )
