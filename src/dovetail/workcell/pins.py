"""Pins of a held part: which of them is led into its opening, so that all go in."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dovetail.types import Array
from dovetail.workcell.end_outline import hull_line
from dovetail.workcell.near_mouth import inside, walls_about
from dovetail.workcell.outline import area_centre, moved_corners

_SAME = 1e-6
"""Distance up to which two pieces touch, or two corners are one [m]."""
_ALONE = 0.0005
"""Least distance by which a corner that is led is farther out than all other pins [m]:
tilted towards it, the part touches with it alone."""
_WALLED = 0.5
"""Share of walls about a corner from which they stop it [1]."""


class Pin(NamedTuple):
    """One of several pins of a held part, by which it is led."""

    opening: Array
    """Convex outline of its opening, counter-clockwise, shape (corners, 2) [m]."""
    corner: Array
    """Corner of the opening at which walls stop it, x y [m]."""


def led_pin(
    pins: Sequence[Array],
    tips: Sequence[Array],
    fixture: Sequence[Array],
    gap: float,
) -> Pin | None:
    """Return the one of several pins by which a part is led; None where it has none.

    It reaches down to the part's end, and has a corner that is lowest when the part is
    tilted towards it, and that walls stop. Of several it is the widest, then the one
    with most walls, then the farthest out.

    Args:
        pins: Sections of the held part, see `sections_near_end`.
        tips: The same at its very end: shorter pins are not in them.
        fixture: Sections of the fixture, see `sections_near_mouth`.
        gap: How much wider a pin's opening is on each side [m].
    """
    apart, found = _apart(pins), []
    for pin in apart if len(apart) > 1 else ():
        if not any(_touch(pin, tip) for tip in tips):
            continue
        others = np.vstack([one for one in apart if one is not pin])
        middle, opening = area_centre(pin), moved_corners(pin, gap)
        walls = walls_about(opening - middle, [line - middle for line in fixture])
        out = (pin - middle) / np.linalg.norm(pin - middle, axis=1, keepdims=True)
        ahead = (pin * out).sum(axis=1) - (others @ out.T).max(axis=0)
        width = float(inside(pin, middle[None]).min())
        for i in np.flatnonzero((ahead > _ALONE) & (walls > _WALLED)).tolist():
            rank = round(width, 5), float(walls[i]), round(math.hypot(*pin[i]), 5), i
            found.append((rank, Pin(opening, opening[i])))
    return max(found, key=lambda one: one[0])[1] if found else None


def _apart(sections: Sequence[Array]) -> list[Array]:
    """Return convex outlines that are apart from one another.

    Sections that touch become one outline; so does what such an outline holds, as a
    shell holds its contacts.
    """
    lines = [line for line in map(_without_doubles, sections) if len(line) > 2]
    while len(merged := _merged(lines)) < len(lines):
        lines = merged
    return lines


def _merged(lines: Sequence[Array]) -> list[Array]:
    """Return the outline around each group of lines that touch one another."""
    groups: list[list[Array]] = []
    for line in lines:
        group, others = [line], []
        for other in groups:
            if any(_touch(line, one) for one in other):
                group += other
            else:
                others.append(other)
        groups = [*others, group]
    return [_without_doubles(hull_line(np.vstack(group))) for group in groups]


def _without_doubles(line: Array) -> Array:
    return line[np.linalg.norm(np.roll(line, -1, axis=0) - line, axis=1) > _SAME]


def _touch(one: Array, other: Array) -> bool:
    """Say whether two convex lines meet: no edge of either parts them."""
    if (one.min(axis=0) > other.max(axis=0) + _SAME).any():
        return False
    if (other.min(axis=0) > one.max(axis=0) + _SAME).any():
        return False
    parted = inside(one, other), inside(other, one)
    return all(bool(way.max(axis=1).min() >= -_SAME) for way in parted)
