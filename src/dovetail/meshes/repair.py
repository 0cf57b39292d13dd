"""Repair of a triangle mesh: one closed surface, its triangles seen from outside."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail.errors import ConfigError
from dovetail.meshes.flat_faces import remade_faces
from dovetail.types import Array

_SAME = 1e-7
"""Distance up to which two corners are one [m]."""
_ON_EDGE = 2e-6
"""Distance from an edge up to which a corner lies on it [m]."""
_OPENING_MAX = 0.02
"""Largest share of the surface that is closed over openings."""
_ROUNDS = 12


class Repaired(NamedTuple):
    """A closed mesh, and what was done to it."""

    vertices: Array
    faces: NDArray[np.int64]
    was_closed: bool
    notes: tuple[str, ...]


def repair(name: str, vertices: Array, faces: NDArray[np.int64]) -> Repaired:
    """Return a mesh as one closed surface with its triangles seen from outside.

    Args:
        name: Of its file, for messages.
        vertices: Corners [m].
        faces: Triangles.

    Raises:
        ConfigError: It is open, is not one body, or encloses nothing; says where.
    """
    notes: list[str] = []
    vertices, faces = _weld(vertices, faces)
    faces, dropped = _drop_empty(vertices, faces)
    if dropped:
        notes.append(f"{dropped} triangles without area or given twice left out")
    if not len(faces):
        raise ConfigError(f"{name} has no triangle with an area", name="mesh")
    edges = _open_edges(faces)
    was_closed = not len(edges)
    if not was_closed:
        count = len(edges)
        faces = _split_at_corners(vertices, faces)
        edges = _open_edges(faces)
        if len(edges) < count:
            notes.append(
                f"{count - len(edges)} open edges closed: corners of their neighbours "
                "lie on them"
            )
    if len(edges) and (flat := remade_faces(vertices, faces, edges)) is not None:
        faces, count = flat
        faces = _split_at_corners(vertices, faces)
        faces, fins = _drop_fins(faces)
        if fins:
            notes.append(f"{fins} triangles left out: no neighbour on any side")
        edges = _open_edges(faces)
        notes.append(f"{count} flat faces made anew: their triangles overlapped")
    if len(edges):
        faces, closed = _fill(name, vertices, faces, edges)
        notes.append(f"{closed} openings closed")
    faces, turned = _wind(faces)
    faces, is_inside_out = _outwards(name, vertices, faces)
    if turned:
        notes.append(f"{turned} triangles turned round")
    if is_inside_out:
        notes.append("turned inside out: its triangles were seen from inside")
    return Repaired(vertices, faces, was_closed, tuple(notes))


def _weld(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Return the mesh with corners at one place made one, and unused ones left out."""
    x, y, z = np.round((vertices - vertices.min(axis=0)) / _SAME).astype(np.int64).T
    _, index = np.unique(x * (int(y.max()) + 1) + y, return_inverse=True)
    _, first, index = np.unique(
        index * (int(z.max()) + 1) + z, return_index=True, return_inverse=True
    )
    faces = index[faces]
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[first][used], faces.reshape(-1, 3)


def _drop_empty(
    vertices: Array, faces: NDArray[np.int64]
) -> tuple[NDArray[np.int64], int]:
    """Return the triangles with three different corners, each once, and the rest."""
    a, b, c = faces.T
    kept = faces[(a != b) & (b != c) & (c != a)]
    key = np.sort(kept, axis=1)
    _, index = np.unique(key[:, 0] * len(vertices) + key[:, 1], return_inverse=True)
    _, index, count = np.unique(
        index * len(vertices) + key[:, 2], return_inverse=True, return_counts=True
    )
    # Twice, seen from either side: a wall without a thickness. Both go.
    sign = _parity(kept)
    total = np.bincount(index, weights=sign)
    first = np.full(len(count), len(kept))
    np.minimum.at(first, index, np.arange(len(kept)))
    kept = kept[np.sort(first[(total != 0) | (count == 1)])]
    return kept, len(faces) - len(kept)


def _parity(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return 1 for triangles whose sorted corners have their direction, else -1."""
    a, b, c = faces.T
    return np.where((a < b) ^ (b < c) ^ (c < a), 1, -1)


def _directed(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the three directed edges of each triangle, shape (3 triangles, 2)."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def _edge_key(edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a number for each edge, the same in both directions."""
    low, high = edges.min(axis=1), edges.max(axis=1)
    return low * (int(high.max(initial=0)) + 1) + high


def _open_edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the directed edges that an odd number of triangles share."""
    edges = _directed(faces)
    _, index, count = np.unique(
        _edge_key(edges), return_inverse=True, return_counts=True
    )
    return edges[count[index] % 2 == 1]


def _drop_fins(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the triangles without those whose three edges are all open."""
    _, index, count = np.unique(
        _edge_key(_directed(faces)), return_inverse=True, return_counts=True
    )
    is_fin = (count[index] % 2 == 1).reshape(-1, 3).all(axis=1)
    return faces[~is_fin], int(is_fin.sum())


def _split_at_corners(vertices: Array, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Split triangles where a neighbour's corner lies on their open edge."""
    for _ in range(_ROUNDS):
        edges = _open_edges(faces)
        if not len(edges) or len(edges) > 20_000:
            break
        open_corners = np.unique(edges)
        at = {tuple(edge): i // 3 for i, edge in enumerate(_directed(faces).tolist())}
        gone, new = set(), []
        for a, b in edges.tolist():
            face = at[a, b]
            if face in gone:
                continue
            between = _on_edge(vertices, a, b, open_corners)
            if len(between):
                c = next(v for v in faces[face].tolist() if v not in (a, b))
                line = [a, *between, b]
                new += [(u, v, c) for u, v in pairwise(line)]
                gone.add(face)
        if not gone:
            break
        kept = np.delete(faces, sorted(gone), axis=0)
        faces, _ = _drop_empty(vertices, np.vstack([kept, new]))
    return faces


def _on_edge(vertices: Array, a: int, b: int, among: NDArray[np.int64]) -> list[int]:
    """Return the corners that lie on an edge, in their order from a to b."""
    start, along = vertices[a], vertices[b] - vertices[a]
    length = float(np.linalg.norm(along))
    along = along / length
    apart = vertices[among] - start
    share = apart @ along
    beside = np.linalg.norm(apart - share[:, None] * along, axis=1)
    hits = (beside < _ON_EDGE) & (share > 0.0) & (share < length)
    hits &= (among != a) & (among != b)
    return among[hits][np.argsort(share[hits])].tolist()


def _fill(
    name: str, vertices: Array, faces: NDArray[np.int64], edges: NDArray[np.int64]
) -> tuple[NDArray[np.int64], int]:
    """Close small openings by a fan from one of their corners."""
    after = {b: a for a, b in edges.tolist()}  # the other way round
    added, loops, is_closed = [], 0, len(after) == len(edges)
    while after and is_closed:
        first, at = after.popitem()
        loop = [first]
        while at != first and at in after:
            loop.append(at)
            at = after.pop(at)
        is_closed = at == first
        loops += 1
        added += [(loop[0], u, v) for u, v in pairwise(loop[1:])]
    share = _area(vertices, np.array(added, dtype=np.int64).reshape(-1, 3)) / _area(
        vertices, faces
    )
    if not is_closed or share > _OPENING_MAX:
        low, high = vertices[edges].min(axis=(0, 1)), vertices[edges].max(axis=(0, 1))
        middle = ", ".join(f"{1e3 * v:.4g}" for v in (low + high) / 2.0)
        raise ConfigError(
            f"{name} is not closed: {len(edges)} edges have one triangle, about "
            f"({middle}) mm, over {1e3 * float((high - low).max()):.4g} mm. Close the "
            "surface in CAD and export a solid",
            name="mesh",
            value=len(edges),
        )
    return np.vstack([faces, added]), loops


def _area(vertices: Array, faces: NDArray[np.int64]) -> float:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2.0


def _wind(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the triangles so turned that neighbours go round in the same sense."""
    if _is_balanced(faces):
        return faces, 0
    edges = _directed(faces)
    _, index, count = np.unique(
        _edge_key(edges), return_inverse=True, return_counts=True
    )
    order = np.argsort(index, kind="stable")
    order = order[count[index[order]] == 2].reshape(-1, 2)
    one, other = order[:, 0] // 3, order[:, 1] // 3
    is_same = edges[order[:, 0], 0] == edges[order[:, 1], 0]  # one must turn
    beside: list[list[tuple[int, bool]]] = [[] for _ in faces]
    for i, j, turn in zip(one.tolist(), other.tolist(), is_same.tolist(), strict=True):
        beside[i].append((j, turn))
        beside[j].append((i, turn))
    turned = np.full(len(faces), -1)
    for start in range(len(faces)):
        if turned[start] >= 0:
            continue
        turned[start], heap, group = 0, [start], [start]
        while heap:
            i = heap.pop()
            for j, turn in beside[i]:
                if turned[j] < 0:
                    turned[j] = turned[i] ^ turn
                    heap.append(j)
                    group.append(j)
        if 2 * turned[group].sum() > len(group):
            turned[group] = 1 - turned[group]
    flip = turned == 1
    return np.where(flip[:, None], faces[:, ::-1], faces), int(flip.sum())


def _is_balanced(faces: NDArray[np.int64]) -> bool:
    """Say whether each edge is passed as often one way as the other."""
    edges = _directed(faces)
    _, index = np.unique(_edge_key(edges), return_inverse=True)
    sign = np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0)
    return not np.bincount(index, weights=sign).any()


def _shells(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a number for each triangle, the same for those that hang together."""
    label = np.arange(int(faces.max()) + 1)
    while True:
        least = label[faces].min(axis=1)
        new = label.copy()
        np.minimum.at(new, label[faces].ravel(), np.repeat(least, 3))
        new = new[new]  # a label is a corner, too: follow it
        if (new == label).all():
            return np.unique(label[faces[:, 0]], return_inverse=True)[1]
        label = new[label]


def _outwards(
    name: str, vertices: Array, faces: NDArray[np.int64]
) -> tuple[NDArray[np.int64], bool]:
    """Return the triangles seen from outside, or refuse what is not one body."""
    if not _is_balanced(faces):
        raise ConfigError(
            f"{name} has triangles that do not agree on what is inside; export a solid "
            "from CAD",
            name="mesh",
        )
    shells = _shells(faces)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    volumes = np.bincount(shells, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)
    total = float(np.abs(volumes).max())
    if total < 1e-11:
        raise ConfigError(
            f"{name} encloses {1e9 * total:.3g} mm3; give a solid body", name="mesh"
        )
    largest = int(np.abs(volumes).argmax())
    is_inside_out = bool(volumes[largest] < 0.0)
    volumes = -volumes if is_inside_out else volumes
    bodies = int((volumes > 1e-4 * total).sum())
    if bodies != 1:
        raise ConfigError(
            f"{name} has {bodies} bodies that do not touch; give one closed body "
            "(unite them in CAD, or leave out what does not mate)",
            name="mesh",
            value=bodies,
        )
    kept = (np.abs(volumes) > 1e-4 * total)[shells]
    faces = faces[kept]
    return (faces[:, ::-1] if is_inside_out else faces), is_inside_out
