"""A fixture in a figure's axes: from above and along its y, each with a section."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection

from dovetail.types import Array
from dovetail.workcell.end_outline import hull_line, surface_points
from dovetail.workcell.near_mouth import sections_at
from dovetail.workcell.parts import Part, Primitive

INK = "#4a4640"
_SEEN, _CUT = "#f4f1ea", "#dcd5c7"
_CUT_BELOW = 0.001
"""Depth below the fixture's z = 0 at which it is cut, as seen from above [m]: a part
may be only 2 mm deep."""
_WIDTH = 35
"""Characters of a title over one column."""
_QUARTER = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
"""Turn about x (wxyz) that brings y up, and z to -y."""


def draw_from_above(views: Sequence[Any], fixture: Part) -> None:
    """Draw a fixture from above in mm, darker where it reaches up to its mouth.

    What moves on it is where it starts.

    Args:
        views: Axes of matplotlib, x to the right, y upwards.
        fixture: In its own frame.
    """
    whole = Part(fixture.name, _shapes(fixture))
    _draw(views, _seen(whole), _SEEN)
    _draw(views, sections_at(whole, -_CUT_BELOW), _CUT)


def draw_from_side(views: Sequence[Any], fixture: Part) -> None:
    """Draw a fixture along its y in mm, darker where the plane y = 0 cuts it.

    What moves on it is where it starts.

    Args:
        views: Axes of matplotlib, x to the right, z upwards.
        fixture: In its own frame.
    """
    turned = [one.moved(np.zeros(3), _QUARTER) for one in _shapes(fixture)]
    aside = Part(fixture.name, tuple(turned))
    upright = np.array([1.0, -1.0])
    _draw(views, [line * upright for line in _seen(aside)], _SEEN)
    _draw(views, [line * upright for line in sections_at(aside, 0.0)], _CUT)


def figure_title(title: str, columns: int) -> str:
    """Return the title of a figure, broken into lines that fit over its columns."""
    return "\n".join(wrap(title, _WIDTH * columns))


def _shapes(fixture: Part) -> tuple[Primitive, ...]:
    """Return all shapes of a fixture, what moves on it where it starts."""
    moving = (one for piece in fixture.moving for one in piece.at(piece.joint.start))
    return (*fixture.primitives, *moving)


def _seen(part: Part) -> list[Array]:
    """Return the outline of each piece as seen along z [m]."""
    points = (surface_points(Part(part.name, (one,))) for one in part.primitives)
    return [hull_line(each[:, :2]) for each in points]


def _draw(views: Sequence[Any], lines: Sequence[Array], colour: str) -> None:
    """Fill convex areas, and draw the edge of all of them together.

    Their edges are drawn first: fillings then hide those between neighbours.
    """
    scaled = [1e3 * line for line in lines]
    for axes in views:
        for edge, width in ((INK, 1.6), (colour, 0.2)):
            areas = PolyCollection(
                scaled, facecolors=colour, edgecolors=edge, linewidths=width, zorder=0
            )
            axes.add_collection(areas)
