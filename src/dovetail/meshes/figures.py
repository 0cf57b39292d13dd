"""Pictures of a plug in its socket as PNG: sections, the gap, and what holds it."""

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from dovetail.meshes.gaps import Clearance
from dovetail.meshes.hold import Body, Hold
from dovetail.meshes.slices import Slicer
from dovetail.types import Array
from dovetail.workcell.planar import import_shapely

PLUG = "#e58c26"
SOCKET = "#d8d2c4"
FINGER = "#d1495b"
STALK = "#3e7cb1"
DRAWN = 0.008
"""Length of the fingers above the plug in a picture [m]."""
_PIECES = "#0b7a75"
_INK = "#4a4640"


def draw_sections(
    sections: Sequence[tuple[float, Any, Any, list[Array]]], clearance: Clearance
) -> bytes:
    """Draw the pair at some heights: the whole above, the tightest place below.

    Args:
        sections: Height [m], area of the plug, area of the socket, and the outlines of
            the convex pieces there.
        clearance: The gap, which has these heights.

    Returns:
        A PNG file.
    """
    figure = Figure(figsize=(2.9 * len(sections), 6.2), dpi=110)
    grid = figure.subplots(2, len(sections), squeeze=False)
    figure.subplots_adjust(0.035, 0.08, 0.99, 0.95, 0.18, 0.16)
    levels = {level.z: level for level in clearance.levels}
    view = _view([plug for _, plug, _, _ in sections])
    for column, (z, plug, socket, pieces) in enumerate(sections):
        whole, close = grid[:, column]
        for axes in (whole, close):
            _fill(axes, socket, SOCKET)
            _fill(axes, plug, PLUG)
        whole.set_xlim(*view[0])
        whole.set_ylim(*view[1])
        whole.set_title(f"z = {1e3 * z:.2f} mm", fontsize=9, color=_INK)
        lines = [1e3 * np.vstack([corners, corners[:1]]) for corners in pieces]
        close.add_collection(LineCollection(lines, colors=_PIECES, linewidths=0.6))
        gaps = levels[z]
        if not len(gaps.gaps):
            close.clear()
            close.set_axis_off()
            continue
        at = int(gaps.gaps.argmin())
        ends = 1e3 * np.array([gaps.points[at], gaps.walls[at]])
        middle, gap = ends.mean(axis=0), 1e3 * float(gaps.gaps[at])
        half = min(max(4.0 * abs(gap), 0.3), 3.0)
        close.plot(*ends.T, color=FINGER, linewidth=2.0)
        close.set_xlim(middle[0] - half, middle[0] + half)
        close.set_ylim(middle[1] - half, middle[1] + half)
        close.set_title(f"tightest here: {gap:.3f} mm", fontsize=9, color=_INK)
        square = middle + half * np.array(
            [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]
        )
        whole.plot(*square.T, color=FINGER, linewidth=1.0)
    _finish(grid)
    grid[0, 0].set_ylabel("whole, y [mm]", fontsize=8)
    grid[1, 0].set_ylabel("close, y [mm]", fontsize=8)
    _legend(
        figure,
        [
            Patch(color=PLUG, label="plug"),
            Patch(color=SOCKET, label="socket"),
            Line2D([], [], color=_PIECES, label="convex pieces"),
            Line2D([], [], color=FINGER, label="smallest gap"),
        ],
    )
    return _png(figure)


def draw_clearance(mesh: Clearance, pieces: Clearance | None) -> bytes:
    """Draw the gap over the height: of the meshes, and of their convex pieces.

    Returns:
        A PNG file.
    """
    figure = Figure(figsize=(7.0, 3.6), dpi=110)
    axes = figure.subplots()
    figure.subplots_adjust(0.09, 0.13, 0.98, 0.97)
    for clearance, color, name in ((mesh, PLUG, "meshes"), (pieces, _PIECES, "pieces")):
        found = [one for one in clearance.levels if len(one.gaps)] if clearance else []
        if not found:
            continue
        z = 1e3 * np.array([one.z for one in found])
        low, quarter, half, most = (
            1e3
            * np.array(
                [np.quantile(one.gaps, (0.0, 0.25, 0.5, 0.75)) for one in found]
            ).T
        )
        style = "-" if color == PLUG else "--"
        axes.fill_betweenx(z, quarter, most, color=color, alpha=0.18, linewidth=0)
        axes.plot(half, z, style, color=color, linewidth=1.0, label=f"{name}, median")
        axes.plot(low, z, style, color=color, linewidth=2.0, label=f"{name}, smallest")
    axes.axvline(0.0, color=_INK, linewidth=0.8)
    axes.set_xlabel("gap [mm]; the band is its middle half", fontsize=8)
    axes.set_ylabel("height, the mouth at 0 [mm]", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    return _png(figure)


def draw_hold(plug: Body, socket: Body, hold: Hold) -> bytes:
    """Draw what holds the plug: cuts along and across the fingers, and from above.

    Args:
        plug: Inserted [m].
        socket: The mesh that it goes into [m].
        hold: Fingers and stalk.

    Returns:
        A PNG file.
    """
    figure = Figure(figsize=(9.6, 4.2), dpi=110)
    grid = figure.subplots(1, 3)
    figure.subplots_adjust(0.06, 0.16, 0.98, 0.98, 0.22)
    turn = hold.grip.turn if hold.grip else 0.0
    middle = hold.grip.middle if hold.grip else plug.vertices[:, :2].mean(axis=0)
    names = ("along the fingers", "across the fingers")
    for axes, name, more in zip(grid, names, (0.0, np.pi / 2.0), strict=False):
        for body, color in ((socket, SOCKET), (plug, PLUG)):
            _fill(axes, _cut(body, turn + more, middle), color)
        _draw_holder(axes, hold, turn + more, middle)
        axes.set_xlabel(f"{name} [mm]", fontsize=8)
        axes.set_ylabel("height [mm]", fontsize=8)
    above = grid[2]
    _fill(above, seen_from_above(socket), SOCKET)
    _fill(above, seen_from_above(plug), PLUG)
    grip, stalk = hold.used_grip, hold.used_stalk
    if stalk is not None:
        _fill(above, stalk.outline, STALK, 0.8)
    if grip is not None:
        for pad in grip.pads():
            above.fill(*(1e3 * pad).T, color=FINGER, alpha=0.7)
    above.set_xlabel("x, from above [mm]", fontsize=8)
    above.set_ylabel("y [mm]", fontsize=8)
    _finish([grid])
    _zoom(above, hold, plug)
    handles = [Patch(color=PLUG, label="plug"), Patch(color=SOCKET, label="socket")]
    if grip is not None:
        handles.append(Patch(color=FINGER, alpha=0.7, label="fingers"))
    if stalk is not None:
        handles.append(Patch(color=STALK, alpha=0.7, label="stalk"))
    _legend(figure, handles)
    return _png(figure)


def _zoom(axes: Any, hold: Hold, plug: Body) -> None:
    """Show the plug and the fingers, not all of a large socket."""
    points = [plug.vertices[:, :2]]
    if hold.grip is not None:
        points += list(hold.grip.pads())
    low = 1e3 * np.min([one.min(axis=0) for one in points], axis=0) - 3.0
    high = 1e3 * np.max([one.max(axis=0) for one in points], axis=0) + 3.0
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])


def _cut(body: Body, turn: float, middle: Array) -> Any:
    """Return an upright section through a point, along a direction [m]."""
    along = np.array([np.cos(turn), np.sin(turn)])
    across = np.array([-along[1], along[0]])
    flat = body.vertices[:, :2] - middle
    turned = np.stack([flat @ along, body.vertices[:, 2], flat @ across], axis=1)
    faces = body.faces[:, ::-1]  # the turned axes are left-handed
    return Slicer(turned, faces).at(0.0)


def seen_from_above(body: Body) -> Any:
    """Return the area that a body covers, seen from above."""
    shapely = import_shapely()
    corners = body.vertices[body.faces]  # (triangles, 3, 3)
    a, b, c = (corners[:, i, :2] for i in range(3))
    (x, y), (u, v) = (b - a).T, (c - a).T
    shown = shapely.polygons(corners[np.abs(x * v - y * u) > 1e-12][:, :, :2])
    return shapely.union_all(shown, grid_size=1e-6)


def _draw_holder(axes: Any, hold: Hold, turn: float, middle: Array) -> None:
    """Draw fingers and stalk from the side, as far as they reach in a direction."""
    along = np.array([np.cos(turn), np.sin(turn)])
    if (grip := hold.used_grip) is not None:
        for pad in grip.pads():
            heights = (grip.low, grip.high + DRAWN)
            _box(axes, (pad - middle) @ along, heights, FINGER)
    if (stalk := hold.used_stalk) is not None:
        corners = import_shapely().get_coordinates(stalk.outline)
        ends = (corners - middle) @ along
        _box(axes, ends, (stalk.low, stalk.neck), STALK)
        _box(axes, ends, (stalk.neck, stalk.high), STALK)


def _box(axes: Any, ends: Array, heights: tuple[float, float], color: str) -> None:
    left, right = 1e3 * ends.min(), 1e3 * ends.max()
    low, high = 1e3 * heights[0], 1e3 * heights[1]
    corners = [(left, low), (right, low), (right, high), (left, high)]
    axes.fill(*np.array(corners).T, color=color, alpha=0.6)


def _view(areas: Sequence[Any]) -> list[tuple[float, float]]:
    """Return the range of x and of y that shows the plug and what is around it [mm]."""
    bounds = np.array([area.bounds for area in areas if not area.is_empty])
    low, high = 1e3 * bounds[:, :2].min(axis=0), 1e3 * bounds[:, 2:].max(axis=0)
    middle, half = (low + high) / 2.0, 0.75 * float((high - low).max()) + 1.0
    return [(float(m - half), float(m + half)) for m in middle]


def _fill(axes: Any, area: Any, color: str, alpha: float = 1.0) -> None:
    """Draw an area of shapely [m] in mm, its cutouts left free."""
    shapely = import_shapely()
    for one in shapely.get_parts(area):
        if one.geom_type != "Polygon" or one.is_empty:
            continue
        lines = [one.exterior, *one.interiors]
        path = Path.make_compound_path(
            *(Path(1e3 * np.array(line.coords), closed=True) for line in lines)
        )
        axes.add_patch(
            PathPatch(path, facecolor=color, edgecolor=_INK, linewidth=0.5, alpha=alpha)
        )


def _finish(grid: Any) -> None:
    for row in grid:
        for axes in row:
            axes.autoscale_view()  # a patch alone does not
            axes.set_aspect("equal")
            axes.locator_params(nbins=5)
            axes.tick_params(labelsize=7)
            axes.spines[["top", "right"]].set_visible(False)


def _legend(figure: Any, handles: list[Any]) -> None:
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=len(handles),
        frameon=False,
        fontsize=8,
    )


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
