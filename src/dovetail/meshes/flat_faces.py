"""Flat faces of a mesh whose triangles overlap one another, made anew."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail.types import Array, Vec3
from dovetail.workcell.planar import import_shapely

_FLAT = 2e-6
"""Distance from a plane up to which a corner is on it [m]."""
_MOST = 200
"""Most planes that are looked at."""


def remade_faces(
    vertices: Array, faces: NDArray[np.int64], edges: NDArray[np.int64]
) -> tuple[NDArray[np.int64], int] | None:
    """Return triangles with overlapping ones in a plane made anew, and how many planes.

    Bad exports fold the triangles of a flat face over one another. What the other faces
    leave open in its plane is the face's rim, from which new triangles are made.

    Args:
        vertices: Corners [m].
        faces: Triangles.
        edges: Those that an odd number of triangles share.
    """
    count = 0
    for normal, offset in _planes(vertices, faces, edges):
        height: Array = np.abs(vertices @ normal - offset)[faces]
        inside: NDArray[np.bool_] = height.max(axis=1) < _FLAT
        new = _remade(vertices, faces, inside, normal)
        if new is not None:
            faces = np.vstack([faces[~inside], new])
            count += 1
    return (faces, count) if count else None


def _planes(
    vertices: Array, faces: NDArray[np.int64], edges: NDArray[np.int64]
) -> list[tuple[Vec3, float]]:
    """Return the planes of triangles at open edges, each once: normal and distance."""
    open_pairs = np.zeros(len(vertices), dtype=bool)
    open_pairs[edges] = True
    near = faces[open_pairs[faces].sum(axis=1) >= 2]
    a, b, c = (vertices[near[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    size = np.linalg.norm(normals, axis=1)
    order = np.argsort(-size)
    found: list[tuple[Vec3, float]] = []
    for i in order[size[order] > 1e-12].tolist():
        normal = normals[i] / size[i]
        offset = float(normal @ a[i])
        is_known = any(
            abs(normal @ one) > 1.0 - 1e-6
            and abs(np.sign(normal @ one) * offset - other) < _FLAT
            for one, other in found
        )
        if not is_known:
            found.append((normal, offset))
        if len(found) >= _MOST:
            break
    return found


def _remade(
    vertices: Array, faces: NDArray[np.int64], inside: NDArray[np.bool_], normal: Vec3
) -> NDArray[np.int64] | None:
    """Return new triangles for those in a plane; None if they do not overlap."""
    shapely = import_shapely()
    first: Vec3 = np.zeros(3)
    first[int(np.abs(normal).argmin())] = 1.0
    u: Vec3 = np.cross(normal, first).astype(float)
    u /= np.linalg.norm(u)
    flat = np.stack([vertices @ u, vertices @ np.cross(normal, u)], axis=1)
    triangles = shapely.polygons(flat[faces[inside]])
    sizes = shapely.area(triangles)
    covered = shapely.union_all(shapely.make_valid(triangles[sizes > 0.0]))
    if sizes.sum() <= covered.area * (1.0 + 1e-6):
        return None
    rim = _rim(faces[~inside], inside, faces)
    lines = shapely.linestrings(flat[rim])
    cells = shapely.get_parts(shapely.polygonize(lines))
    shapely.prepare(covered)
    cells = [one for one in cells if covered.contains(one.representative_point())]
    return _triangles(cells, flat, rim)


def _rim(
    others: NDArray[np.int64], inside: NDArray[np.bool_], faces: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the edges that other triangles leave open at those in a plane."""
    edges = np.sort(others[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    kept, count = np.unique(edges, axis=0, return_counts=True)
    in_plane = np.zeros(int(faces.max()) + 1, dtype=bool)
    in_plane[faces[inside]] = True
    return kept[(count % 2 == 1) & in_plane[kept].all(axis=1)]


def _triangles(
    cells: list[Any], flat: Array, rim: NDArray[np.int64]
) -> NDArray[np.int64]:
    shapely = import_shapely()
    index = {tuple(flat[i].tolist()): i for i in np.unique(rim).tolist()}
    found = []
    for cell in cells:
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(cell))
        corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
        found += [[index[x, y] for x, y in three] for three in corners.tolist()]
    return np.array(found, dtype=np.int64).reshape(-1, 3)
