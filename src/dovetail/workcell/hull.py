"""Convex hull of points, and volume, centre and inertia of what it encloses."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail.types import Array, Mat33, Vec3

_FLAT = 1e-12
"""Distance from a plane, per size of the hull, up to which a point is on it."""


class Solid(NamedTuple):
    """A body of even density."""

    volume: float
    """[m3]"""
    centre: Vec3
    """Centre of mass [m]."""
    inertia: Mat33
    """Inertia about the centre per mass [m2], axes of the points."""


def thickness(points: Array) -> float:
    """Return the extent [m] of points along the axis in which they extend least."""
    if len(points) < 4:
        return 0.0
    centred = points - points.mean(axis=0)
    axis = np.linalg.svd(centred, full_matrices=False)[2][-1]
    return float(np.ptp(centred @ axis))


def hull_faces(points: Array) -> NDArray[np.int64]:
    """Return the triangles of the hull of points that are not flat.

    Each point is added to the hull of those before it: the faces that see it give way
    to a fan from their rim to it. A point on a face's plane does not see that face.

    Returns:
        Indices of the corners, counter-clockwise from outside, shape (faces, 3).
    """
    eps = _FLAT * float(np.ptp(points, axis=0).max())
    first = _tetrahedron(points)
    middle = points[first].mean(axis=0)
    a, b, c, d = first
    faces = np.array([(a, b, c), (a, c, d), (a, d, b), (b, d, c)])
    normals, offsets = _planes(points, faces)
    if normals[0] @ middle > offsets[0]:
        faces = faces[:, ::-1]
    for index, point in enumerate(points):
        normals, offsets = _planes(points, faces)
        sees = normals @ point - offsets > eps
        if not sees.any():
            continue
        edges = np.vstack([faces[sees][:, [i, (i + 1) % 3]] for i in range(3)])
        known = set(map(tuple, edges.tolist()))
        rim = [(i, j) for i, j in known if (j, i) not in known]
        faces = np.vstack([faces[~sees], [(i, j, index) for i, j in sorted(rim)]])
    return faces


@lru_cache(maxsize=4096)
def solid_of(numbers: tuple[float, ...]) -> Solid:
    """Return the body whose corners are these: x y z of each, one after the other [m].

    Tetrahedra from an inner point to each face of the hull are summed up.
    """
    points = np.array(numbers).reshape(-1, 3)
    inner = points.mean(axis=0)
    corners = (points - inner)[hull_faces(points)]  # (faces, 3, 3)
    volumes = np.linalg.det(corners) / 6.0
    volume = float(volumes.sum())
    sums = corners.sum(axis=1)
    centre = volumes @ sums / 4.0 / volume
    # The integral of x x^T over a tetrahedron with a corner in the origin.
    squares = np.einsum("fki,fkj->fij", corners, corners)
    squares += np.einsum("fi,fj->fij", sums, sums)
    second = np.einsum("f,fij->ij", volumes, squares) / 20.0 / volume
    second -= np.outer(centre, centre)
    inertia = np.trace(second) * np.eye(3) - second
    return Solid(volume, inner + centre, inertia)


def _tetrahedron(points: Array) -> list[int]:
    """Return four points that are far from one plane."""
    a = int(points[:, 0].argmin())
    apart = points - points[a]
    b = int((apart**2).sum(axis=1).argmax())
    along = apart[b] / np.linalg.norm(apart[b])
    beside = apart - np.outer(apart @ along, along)
    c = int((beside**2).sum(axis=1).argmax())
    d = int(np.abs(apart @ np.cross(apart[b], apart[c])).argmax())
    return [a, b, c, d]


def _planes(points: Array, faces: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return unit normals of triangles, and the distances of their planes [m]."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(length, np.finfo(float).tiny)
    return normals, np.einsum("fi,fi->f", normals, a)


def thinner(points: Array, distance: float) -> Array | None:
    """Return corners of a hull whose sides all moved inwards, level faces left alone.

    A face moves along its normal by the distance, times how steep it is. The corners
    are those of the planes: faces of the hull of the planes' dual points.

    Args:
        points: Corners of the hull [m].
        distance: How far a vertical face moves; negative outwards [m].

    Returns:
        The corners [m], or None where nothing is left.
    """
    inner = points.mean(axis=0)
    normals, offsets = _planes(points - inner, hull_faces(points))
    offsets = offsets - distance * np.hypot(normals[:, 0], normals[:, 1])
    if offsets.min() <= _FLAT:
        return None
    dual = normals / offsets[:, None]
    planes, distances = _planes(dual, hull_faces(dual))
    return inner + planes / distances[:, None]
