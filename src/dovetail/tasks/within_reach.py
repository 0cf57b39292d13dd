"""Fixtures within an arm's reach: the task's own, or moved towards a short arm."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from dovetail.poses import quat_about_z
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.region import Region
from dovetail.types import Array
from dovetail.workcell.workcell import Walls, Workcell

_SIZES = (1.0, 0.5, 0.25)
"""Shares of the region's extent that are tried, best first."""
_ROOMS = (0.12, 0.06)
"""Room between fixtures and the ends of the reach [m], best first: tools start up to
0.12 m beside them. With less than the last the task's own places are not used."""
_STEP = 0.01
"""Difference of two shifts that are tried [m]."""
_NEAREST = 0.30
"""Least distance of the region's middle from the arm's foot [m]."""


def within_reach(
    cell: Workcell, usual: Region, places: Sequence[FixturePose], *, moves_walls: bool
) -> Workcell:
    """Return a cell whose fixtures stand where the arm reaches them.

    It stays as it is where the arm reaches the task's own places and some way beyond
    them, or where no shift towards its foot helps: then what is out of reach is refused
    when it is used.

    Args:
        cell: The cell, with the task's own fixtures.
        usual: Region from which they are drawn.
        places: Where a policy is tried, which lie in it.
        moves_walls: Move the walls of the TCP with the fixtures.
    """
    if _has_room(cell, usual, usual, places, _ROOMS[-1]):
        return cell
    out = usual.middle[:2]
    distance = float(np.linalg.norm(out))
    shifts = np.arange(0.0, max(distance - _NEAREST, 0.0) + _STEP / 2.0, _STEP)
    for size, room, shift in product(_SIZES, _ROOMS, shifts.tolist()):
        by = -shift * np.array([*out, 0.0]) / distance
        region = _moved(usual, by, size)
        if _has_room(cell, region, usual, places, room):
            return _placed(cell, region, by if moves_walls else np.zeros(3))
    return cell


def _has_room(
    cell: Workcell,
    region: Region,
    usual: Region,
    places: Sequence[FixturePose],
    room: float,
) -> bool:
    """Say whether an arm reaches all of a region, and so far beyond it [m]."""
    poses = [region.carry(place, usual).pose() for place in places]
    poses += region.corners(places[0].facing)
    return all(cell.out_of_reach(pose) <= -room for pose in poses)


def _moved(region: Region, by: Array, size: float) -> Region:
    """Return a region moved by a vector [m], and shrunk to a share of its extent."""
    middle, half = region.middle + by, size * region.half
    low, high = (middle - half).round(4).tolist(), (middle + half).round(4).tolist()
    return Region(tuple(low), tuple(high), region.yaw)


def _placed(cell: Workcell, region: Region, by: Array) -> Workcell:
    """Return a cell whose fixtures stand in a region, its walls moved [m]."""
    low, high = (tuple((np.array(w) + by).round(4).tolist()) for w in cell.walls)
    walls: Walls = (low, high)
    ends = (f"{a:g} to {b:g}" for a, b in zip(region.low, region.high, strict=True))
    box = ", ".join(f"{axis} {end}" for axis, end in zip("xyz", ends, strict=True))
    too = " (the walls of the tool moved with it)" if by.any() else ""
    return replace(
        cell,
        place=cell.place._replace(
            position=region.middle, quat_wxyz=quat_about_z(region.middle_yaw)
        ),
        walls=walls,
        fixtures=region,
        note=f"the {cell.fixture.name} is drawn within {box} m{too}, as "
        f"{cell.robot.name} does not reach well beyond the task's own places",
    )
