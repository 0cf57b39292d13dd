"""Files of triangles: found beside a robot file, and read within bounds."""

import io
import itertools
import os
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail.errors import ConfigError
from dovetail.reading import read_bytes
from dovetail.types import Array

KINDS = (".stl", ".obj")
"""Files that are read: binary STL, and Wavefront OBJ."""
BYTES = 20_000_000
"""Largest file [bytes]."""
FACES = 200_000
"""Most triangles of a file."""
_LINES = 2_000_000
"""Most lines of an OBJ file."""
_CORNERS = 64
"""Most corners of a face."""
_LARGEST = 1e6
"""Largest coordinate."""
_PACKAGE_DEPTH = 3
"""Most levels that a package may be above a robot file's folder."""


class Mesh(NamedTuple):
    """Triangles."""

    vertices: Array
    """Corners, shape (number of corners, 3), in the file's unit."""
    faces: NDArray[np.int_]
    """Corners of each triangle, shape (number of triangles, 3)."""


@lru_cache(maxsize=16)
def read_mesh(file: Path) -> Mesh:
    """Read the triangles of a file.

    Raises:
        ConfigError: Unreadable, too large, no triangles, or no area; the message says
            which.
    """
    kind = file.suffix.lower()
    if kind not in KINDS:
        raise ConfigError(f"mesh {file} is no {' or '.join(KINDS)} file")
    try:
        content = read_bytes(file, BYTES)
    except OSError as error:
        reason = error.strerror or error
        raise ConfigError(f"cannot read mesh {file}: {reason}") from error
    try:
        mesh = _of_stl(content) if kind == ".stl" else _of_obj(content)
        _require_area(mesh)
    except (ValueError, OverflowError) as error:
        raise ConfigError(f"mesh {file}: {error}") from error
    return mesh


def _of_stl(content: bytes) -> Mesh:
    count = int.from_bytes(content[80:84], "little")
    if len(content) != 84 + 50 * count:
        raise ValueError("it is no binary STL file; text STL is not read")
    _require_count(count)
    rows = np.frombuffer(content[84:], dtype=np.uint8).reshape(count, 50)
    corners = rows[:, 12:48].copy().view("<f4").astype(float).reshape(-1, 3)
    return Mesh(corners, np.arange(3 * count).reshape(count, 3))


def _of_obj(content: bytes) -> Mesh:
    """Return vertices and triangles of all objects in a file: MuJoCo reads one only."""
    vertices: list[float] = []  # flat lists: a list of lists is slow to make
    faces: list[int] = []
    for number, line in enumerate(io.BytesIO(content)):
        if number >= _LINES:
            raise ValueError(f"it has more than {_LINES} lines")
        kind, *parts = line.split(None, 3) or [b""]
        if kind == b"v":
            if len(parts) < 3:
                raise ValueError("a vertex has fewer than three coordinates")
            z = parts[2].split(None, 1)[0]
            vertices += float(parts[0]), float(parts[1]), float(z)
        elif kind == b"f":
            words = line.split(None, _CORNERS + 1)[1:]
            if len(words) > _CORNERS:
                raise ValueError(f"a face has more than {_CORNERS} corners")
            corners = [_corner(word, len(vertices) // 3) for word in words]
            for one, other in itertools.pairwise(corners[1:]):
                faces += corners[0], one, other
        if len(faces) > 3 * FACES or len(vertices) > 9 * FACES:
            break
    _require_count(len(faces) // 3, len(vertices) // 3)
    return Mesh(np.array(vertices).reshape(-1, 3), np.array(faces).reshape(-1, 3))


def _corner(part: bytes, count: int) -> int:
    number = int(part.partition(b"/")[0])
    corner = number - 1 if number > 0 else count + number
    if not 0 <= corner < count:
        raise ValueError(f"a face has the vertex {number}; there are {count}")
    return corner


def _require_count(faces: int, vertices: int = 0) -> None:
    if not 0 < faces <= FACES or vertices > 3 * FACES:
        raise ValueError(
            f"it has {faces} triangles and {vertices} vertices, or more; allowed: 1 to "
            f"{FACES} and up to {3 * FACES}; write a coarser one"
        )


def _require_area(mesh: Mesh) -> None:
    """Refuse corners that are nowhere, and triangles that are no surface."""
    corners = mesh.vertices
    if not (np.isfinite(corners).all() and np.abs(corners).max() <= _LARGEST):
        raise ValueError(f"it has a coordinate beyond {_LARGEST:g}")
    a, b, c = (corners[mesh.faces[:, i]] for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    if not area > 1e-9 * np.abs(corners).max() ** 2:
        raise ValueError("its triangles have no area")


def path_beside(path: Path, name: str) -> Path:
    """Return the path that a robot file means by a name, without `..` in it."""
    return Path(os.path.normpath(path.absolute().parent / name))


def is_near(file: Path, path: Path) -> bool:
    """Say whether a file is below a robot file's folder, or below the one above.

    A robot file that others may have made names no other place to be read.
    """
    return file.is_relative_to(_roots(path)[-1])


def _roots(path: Path) -> list[Path]:
    """Return the folder of a robot file and, but for the root, the one above."""
    folder = path_beside(path, ".")
    return [folder] if folder.parent == folder.parent.parent else [*_up(folder, 1)]


def _up(folder: Path, count: int) -> list[Path]:
    """Return a folder and up to so many above."""
    return [folder, *folder.parents[:count]]


def find_mesh(name: str, path: Path) -> Path:
    """Find a mesh by the name that a URDF gives it: of a package, or beside it.

    Args:
        name: ``package://NAME/...``, ``file://...`` or a path.
        path: The URDF.

    Raises:
        ConfigError: Not there, of another kind, or at a place that is not read.
    """
    kind, _, rest = name.rpartition("://")
    if "\0" in name or Path(rest).suffix.lower() not in KINDS:
        raise ConfigError(f"it is no {' or '.join(KINDS)} file")
    roots = _roots(path)
    places = [(roots[-1], base / rest) for base in roots]
    package, *parts = Path(rest).parts
    if kind == "package" and package not in ("/", ".", ".."):
        inside = Path(*parts)
        places += [(roots[-1], base / inside) for base in roots]
        for base in _up(roots[0], _PACKAGE_DEPTH):
            root = base if base.name == package else base / package
            places.append((root, root / inside))
    for root, place in places:
        file = Path(os.path.normpath(place))
        if file.is_relative_to(root) and file.is_file():
            return file
    raise ConfigError(
        "it is not in the file's folder, in the one above, or in its package's"
    )
