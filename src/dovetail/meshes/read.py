"""Meshes of solid bodies from STL, OBJ, PLY and 3MF: bounded, repaired, in metres.

Only the file itself is opened: no material, no texture, and no other file that it
names. Names of objects in it are not read.
"""

import io
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail.errors import ConfigError, MissingDependencyError, install_command
from dovetail.meshes.repair import repair
from dovetail.printable import printable
from dovetail.reading import read_bytes
from dovetail.types import Array, Vec3

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}
"""Units of a file's lengths [m]."""
_LENGTHS = UNITS | {"micron": 1e-6, "foot": 0.3048}
"""The same with those that only a 3MF says [m]."""
FORMATS = ("stl", "obj", "ply", "3mf")
"""Ends of the names of files that are read."""
MAX_BYTES = 60_000_000
"""Largest file; also largest content of a 3MF's archive."""
MAX_TRIANGLES = 500_000
"""Most triangles of a mesh."""
MAX_PLACED = 20
"""Most objects that a 3MF places, as items or as components of others."""
SIZE_RANGE = (0.003, 0.4)
"""Longest side of the box around a part [m]."""
_NAME_MAX = 40


class Mesh(NamedTuple):
    """A closed surface around one body."""

    name: str
    """Name of its file without the ending, for messages."""
    vertices: Array
    """Corners of its triangles [m], shape (corners, 3)."""
    faces: NDArray[np.int64]
    """Triangles, counter-clockwise from outside: indices, shape (triangles, 3)."""
    units: str
    """Unit in which its file was read: mm, cm, m or inch; micron or foot of a 3MF."""
    units_from: str
    """Origin of the unit: "given", "file" or "guessed"."""
    was_closed: bool
    """True if every edge of the file's triangles had two of them, before repairs."""
    notes: tuple[str, ...] = ()
    """Repairs and guesses, one sentence each."""

    @property
    def volume(self) -> float:
        """Volume [m3]."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0

    @property
    def centre(self) -> Vec3:
        """Centre of mass of an even body [m]."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
        return volumes @ (a + b + c) / 4.0 / volumes.sum()

    @property
    def box(self) -> tuple[Vec3, Vec3]:
        """Lowest and highest corner of the box around it [m]."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)


def read_mesh(path: str | Path, units: str | None = None) -> Mesh:
    """Return the body in a file.

    Args:
        path: An STL (text or binary), OBJ, PLY or 3MF.
        units: Of its lengths: mm, cm, m or inch. Without it a 3MF says its own, and
            for the others it is guessed by the size, and said in the notes.

    Raises:
        ConfigError: It cannot be read, is too large, or is no closed surface of one
            body; says which, and what to do.
        MissingDependencyError: trimesh is not installed.
    """
    return _finish(_load(Path(path)), units, None)


def read_meshes(
    plug: str | Path, socket: str | Path, units: str | None = None
) -> tuple[Mesh, Mesh]:
    """Return the bodies in two files of one pair, in one unit.

    Args:
        plug: As `read_mesh`.
        socket: As `read_mesh`.
        units: Of both; a guess is made once, by the larger one.

    Raises:
        ConfigError: As `read_mesh`.
        MissingDependencyError: trimesh is not installed.
    """
    both = _load(Path(plug)), _load(Path(socket))
    if Path(plug).expanduser().resolve() == Path(socket).expanduser().resolve():
        raise ConfigError(
            f"plug and socket are the same file, {Path(plug).name}; give one of each",
            name="mesh",
        )
    size = max(float(np.ptp(one.vertices, axis=0).max()) for one in both)
    first, second = (_finish(one, units, size) for one in both)
    return first, second


class _Raw(NamedTuple):
    """Triangles as a file has them."""

    path: Path
    vertices: Array
    faces: NDArray[np.int64]
    units: str | None


def import_trimesh() -> Any:
    """Return the module trimesh.

    Raises:
        MissingDependencyError: It is not installed.
    """
    try:
        import trimesh
    except ImportError as error:
        raise MissingDependencyError(
            f"meshes need trimesh, which is not installed: {install_command('parts')}"
        ) from error
    return trimesh


def _load(path: Path) -> _Raw:
    """Return the triangles in a file, or refuse it."""
    ending = path.suffix.lower().lstrip(".")
    if ending not in FORMATS:
        more = (
            "; export STL or 3MF from CAD" if ending in ("step", "stp", "iges") else ""
        )
        raise ConfigError(
            f"{path.name} ends in {ending[:10]!r}; known: {', '.join(FORMATS)}{more}",
            name="mesh",
            value=ending,
            allowed=FORMATS,
        )
    trimesh = import_trimesh()
    try:
        content = read_bytes(path.expanduser(), MAX_BYTES)
    except OSError as error:
        raise ConfigError(
            f"cannot read the mesh {path}: {error.strerror}", name="mesh"
        ) from error
    if ending == "3mf":
        _require_small_archive(path, content)
    bodies, units = _bodies(trimesh, path, ending, content)
    if not bodies:
        raise ConfigError(
            f"{path.name} has no triangles: it is empty, cut short, or no "
            f"{ending.upper()}; export it again",
            name="mesh",
        )
    if len(bodies) != 1:
        raise _several(path, len(bodies))
    (body,) = bodies
    faces = np.array(body.faces, dtype=np.int64)
    if len(faces) > MAX_TRIANGLES:
        raise ConfigError(
            f"{path.name} has {len(faces)} triangles; allowed: up to {MAX_TRIANGLES}. "
            "Export it from CAD with a coarser tolerance",
            name="mesh",
            value=len(faces),
            allowed=(4, MAX_TRIANGLES),
        )
    if not 0 <= faces.min() <= faces.max() < len(body.vertices):
        raise ConfigError(
            f"{path.name} has a triangle with a corner that is not there; export it "
            "again",
            name="mesh",
        )
    used, faces = np.unique(faces, return_inverse=True)  # no stray corner has a size
    vertices = np.array(body.vertices, dtype=float)[used]
    faces = faces.reshape(-1, 3)
    if not np.isfinite(vertices).all():
        raise ConfigError(
            f"{path.name} has a corner that is NaN or infinite; export it again",
            name="mesh",
        )
    return _Raw(path, vertices, faces, _known_unit(path, units))


def _bodies(
    trimesh: Any, path: Path, ending: str, content: bytes
) -> tuple[list[Any], Any]:
    """Return the bodies in a file's content, and the unit that it says."""
    try:
        scene = trimesh.load_scene(
            io.BytesIO(content),
            file_type=ending,
            resolver=None,
            process=False,
            skip_materials=True,
            split_objects=False,
            group_material=False,
            maintain_order=True,
        )
        bodies = [one for one in scene.dump() if isinstance(one, trimesh.Trimesh)]
        units = scene.units if ending == "3mf" else None
    except Exception as error:  # a reader of strangers' files raises anything
        said = printable(f"{type(error).__name__}: {error}")[:120]
        raise ConfigError(
            f"{path.name} is no {ending.upper()} that can be read ({said}); export it "
            "again",
            name="mesh",
        ) from error
    bodies = [body for body in bodies if len(body.faces)]
    if ending == "obj" and bodies:  # faces of one body may have several materials
        bodies = [trimesh.util.concatenate(bodies)]
    return bodies, units


def _known_unit(path: Path, word: Any) -> str | None:
    """Return the unit that a file says."""
    if word is None:
        return None
    names = {
        "millimeter": "mm",
        "centimeter": "cm",
        "meter": "m",
        "inche": "inch",
        "feet": "foot",
    }
    known = names.get(str(word).removesuffix("s"), str(word).removesuffix("s"))
    if known not in _LENGTHS:
        raise ConfigError(
            f"{path.name} is in the unit {printable(str(word))[:20]!r}; known: "
            f"{', '.join(_LENGTHS)}",
            name="units",
            value=str(word)[:20],
            allowed=tuple(_LENGTHS),
        )
    return known


def _require_small_archive(path: Path, content: bytes) -> None:
    """Refuse a 3MF that unpacks to more than is read, has entities, or many bodies."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(one.file_size for one in archive.infolist())
            names = archive.namelist() if size <= MAX_BYTES else []
            models = [archive.read(n) for n in names if ".model" in n.lower()]
    except Exception as error:  # a reader of strangers' files raises anything
        said = printable(str(error))[:120]
        raise ConfigError(f"{path.name} is no 3MF: {said}", name="mesh") from error
    if size > MAX_BYTES:
        raise ConfigError(
            f"{path.name} unpacks to {size} bytes; allowed: up to {MAX_BYTES}. Export "
            "it from CAD with a coarser tolerance",
            name="mesh",
            value=size,
            allowed=(0, MAX_BYTES),
        )
    models = [one.replace(b"\0", b"") for one in models]  # it may be UTF-16
    if any(b"<!DOCTYPE" in one for one in models):
        raise ConfigError(
            f"{path.name} declares a document type; a 3MF has none. Export it again",
            name="mesh",
        )
    # Each item and each component names an object; trimesh takes time with the square.
    if (count := sum(one.count(b"objectid") for one in models)) > MAX_PLACED:
        raise _several(path, count)


def _several(path: Path, count: int) -> ConfigError:
    """Return the refusal of a file with another number of bodies than one."""
    return ConfigError(
        f"{path.name} holds {count} bodies; give one file for the plug and one for the "
        "socket, each with one closed body",
        name="mesh",
        value=count,
    )


def guess_units(size: float) -> str:
    """Return the unit in which a part's longest side is most likely given.

    Args:
        size: Longest side of a part, in the unknown unit.
    """
    if size < 0.4:
        return "m"
    return "inch" if size < 3.0 else "mm"


def _finish(raw: _Raw, units: str | None, size: float | None) -> Mesh:
    """Return a body in metres, repaired."""
    if units is not None and units not in UNITS:
        raise ConfigError(
            f"units are {units[:40]!r}; known: {', '.join(UNITS)}",
            name="units",
            value=units,
            allowed=tuple(UNITS),
        )
    own = float(np.ptp(raw.vertices, axis=0).max())
    notes = []
    where = "given" if units else "file" if raw.units else "guessed"
    unit = units or raw.units
    if unit is None:
        longest = own if size is None else size
        unit = guess_units(longest)
        whose = "its" if longest == own else "the other part's"
        low, high = SIZE_RANGE
        others = [
            f"{1e3 * longest * length:.3g} mm if they are {word}"
            for word, length in UNITS.items()
            if word != unit and low <= longest * length <= high
        ]
        notes.append(
            f"units guessed: {unit}, as {whose} longest side is {longest:g}, so "
            f"{1e3 * longest * UNITS[unit]:.3g} mm; give the units if it is another "
            f"({', '.join(others) or 'none other is likely'})"
        )
    side = own * _LENGTHS[unit]
    low, high = SIZE_RANGE
    if not low <= side <= high:
        fits = [word for word, one in UNITS.items() if low <= own * one <= high]
        raise ConfigError(
            f"the longest side of {raw.path.name} is {1e3 * side:.4g} mm in {unit} "
            f"({where}); allowed: {1e3 * low:g} to {1e3 * high:g} mm. "
            + (
                f"It would fit in {' or '.join(fits)}: give the units"
                if fits
                else "It fits in no unit: export the part alone, at its size"
            ),
            name="units",
            value=side,
            unit="m",
            allowed=SIZE_RANGE,
        )
    fixed = repair(raw.path.name, raw.vertices * _LENGTHS[unit], raw.faces)
    return Mesh(
        short_name(raw.path.stem),
        fixed.vertices,
        fixed.faces,
        unit,
        where,
        fixed.was_closed,
        (*notes, *fixed.notes),
    )


def short_name(text: str) -> str:
    """Return a text as a part may be named: one line, up to 40 characters."""
    return printable(text)[:_NAME_MAX]
