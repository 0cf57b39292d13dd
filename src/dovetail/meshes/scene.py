"""The pair in three dimensions, in a page that needs nothing from outside."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.errors import MissingDependencyError, install_command
from dovetail.meshes.figures import DRAWN, FINGER, PLUG, SOCKET, STALK
from dovetail.meshes.hold import Body, Hold, Stalk
from dovetail.types import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Mesh3d

NOTE = "Drag to turn, scroll to zoom, click a name to hide it."
"""Hint on the use of the picture."""
_CELLS = 400
"""Corners of a mesh that are nearer than this share of its size are drawn as one."""
_LIFT = 0.010
"""Between plug and socket where the plug is drawn above [m]."""


def draw_scene(plug: Body, socket: Body, hold: Hold) -> str:
    """Return the pair with what holds the plug, inserted and above, as HTML.

    Args:
        plug: Inserted [m].
        socket: The mesh that it goes into [m].
        hold: Fingers and stalk.

    Raises:
        MissingDependencyError: plotly is not installed.
    """
    try:
        from plotly.graph_objects import Figure
        from plotly.io import to_html
    except ImportError as error:
        raise MissingDependencyError(
            f"the picture in 3D needs plotly ({error}): {install_command('parts')}"
        ) from error
    rising = [_mesh("plug", plug.vertices, plug.faces, PLUG)]
    if (grip := hold.used_grip) is not None:
        heights = (grip.low, float(plug.vertices[:, 2].max()) + DRAWN)
        rising += [_prism("finger", pad, heights, FINGER) for pad in grip.pads()]
    if (stalk := hold.used_stalk) is not None:
        rising += _pieces(stalk)
    fixed = _mesh("socket", socket.vertices, socket.faces, SOCKET, opacity=0.45)
    figure = Figure([*rising, fixed])
    moved = list(range(len(rising)))
    places = [("inserted", 0.0), ("above", 1e3 * (hold.depth + _LIFT))]
    buttons = [
        {
            "label": name,
            "method": "restyle",
            "args": [{"z": [(np.array(t.z) + up).round(3) for t in rising]}, moved],
        }
        for name, up in places
    ]
    figure.update_layout(
        height=560,
        margin={"l": 0, "r": 0, "t": 30, "b": 0},
        scene={
            "aspectmode": "data",
            "xaxis": {"title": {"text": "x [mm]"}},
            "yaxis": {"title": {"text": "y [mm]"}},
            "zaxis": {"title": {"text": "z [mm]"}},
        },
        updatemenus=[{"type": "buttons", "direction": "right", "buttons": buttons}],
    )
    return to_html(
        figure,
        full_html=False,
        include_plotlyjs=True,
        config={"responsive": True, "displaylogo": False},
    )


def _mesh(
    name: str, vertices: Array, faces: Any, color: str, opacity: float = 1.0
) -> "Mesh3d":
    from plotly.graph_objects import Mesh3d

    corners, triangles = coarser(vertices, faces)
    x, y, z = (1e3 * corners).round(3).T
    i, j, k = triangles.T
    return Mesh3d(
        **{"x": x, "y": y, "z": z, "i": i, "j": j, "k": k},
        name=name,
        color=color,
        opacity=opacity,
        flatshading=True,
        showlegend=True,
        hoverinfo="name",
    )


def coarser(vertices: Array, faces: Any) -> tuple[Array, Any]:
    """Return a mesh for the eye: corners in one cell of a grid are one.

    Args:
        vertices: Corners [m].
        faces: Triangles.
    """
    cell = float(np.ptp(vertices, axis=0).max()) / _CELLS
    keys = np.round(vertices / cell).astype(np.int64)
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    triangles = index.reshape(-1)[faces]
    a, b, c = triangles.T
    return vertices[first], triangles[(a != b) & (b != c) & (c != a)]


def _prism(name: str, corners: Array, heights: Sequence[float], color: str) -> "Mesh3d":
    """Return a convex outline from one height to another."""
    count = len(corners)
    ring = np.arange(count)
    after = (ring + 1) % count
    walls = [
        np.stack([ring, after, after + count], axis=1),
        np.stack([ring, after + count, ring + count], axis=1),
    ]
    fan = np.stack([np.zeros(count - 2, int), ring[1:-1], ring[2:]], axis=1)
    faces = np.concatenate([*walls, fan, fan + count])
    points = np.concatenate([np.insert(corners, 2, z, axis=1) for z in heights])
    return _mesh(name, points, faces, color)


def _pieces(stalk: Stalk) -> list["Mesh3d"]:
    """Return the convex pieces of a stalk, and its head."""
    drawn = [
        _prism("stalk", piece, (stalk.low, stalk.neck), STALK)
        for piece in stalk.pieces()
    ]
    return [*drawn, _prism("head", stalk.head(), (stalk.neck, stalk.high), STALK)]
