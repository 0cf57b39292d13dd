"""What a body is drawn as: files of triangles, where they are on this machine.

Nothing collides with them and they weigh nothing.
"""

import importlib.util
import itertools
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from dovetail.poses import matrix_from_quat, quat_from_matrix
from dovetail.types import Array, Mat33, Vec3

KINDS = (".stl", ".obj", ".msh")
"""Files that MuJoCo reads."""
_MOST_FACES = 200_000
"""Of an STL file."""
Rgba = tuple[float, float, float, float]


class Drawn(NamedTuple):
    """One file of triangles, and where it is."""

    file: Path
    """Absolute."""
    position: Vec3
    """Of its frame in the body's [m]."""
    rotation: Mat33
    """Axes of its frame in the body's."""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Its lengths times these are metres."""
    rgba: Rgba | None = None
    """Its colour; None is the usual one."""

    def seen_from(self, position: Vec3, rotation: Mat33) -> "Drawn":
        """Return it in a frame in which its body's frame lies at this pose."""
        return self._replace(
            position=position + rotation @ self.position,
            rotation=rotation @ self.rotation,
        )


def bullet_file(*parts: str) -> Path | None:
    """Return a file of pybullet_data, without importing PyBullet; None is none."""
    spec = importlib.util.find_spec("pybullet_data")
    if spec is None or not spec.submodule_search_locations:
        return None
    file = Path(spec.submodule_search_locations[0]).joinpath(*parts)
    return file if file.exists() else None


def read_drawn(robot: ET.Element, path: Path) -> dict[str, list[Drawn]]:
    """Return what the links of a URDF are drawn as, by their names, in their frames.

    What is not here, or cannot be drawn, is left out: a plain body is in its place.

    Args:
        robot: Root of the URDF.
        path: Where that is.
    """
    colours = {
        name: colour
        for material in robot.iter("material")
        if (colour := _colour(material)) and (name := material.get("name"))
    }
    found: dict[str, list[Drawn]] = {}
    for link in robot.iter("link"):
        shapes = [_read_one(visual, path, colours) for visual in link.findall("visual")]
        found[str(link.get("name"))] = [shape for shape in shapes if shape is not None]
    return found


def _read_one(
    visual: ET.Element, path: Path, colours: Mapping[str, Rgba]
) -> Drawn | None:
    mesh = visual.find("geometry/mesh")
    file = None if mesh is None else _find_file(str(mesh.get("filename")), path)
    if mesh is None or file is None or not _can_draw(file):
        return None
    origin = visual.find("origin")
    place = {} if origin is None else origin.attrib
    material = visual.find("material")
    name = None if material is None else material.get("name")
    x, y, z = np.broadcast_to(_numbers(mesh.get("scale", "1 1 1")), 3)
    return Drawn(
        file,
        _numbers(place.get("xyz", "0 0 0")),
        _from_rpy(_numbers(place.get("rpy", "0 0 0"))),
        (float(x), float(y), float(z)),
        colours.get(name or ""),
    )


def _find_file(name: str, path: Path) -> Path | None:
    """Find a mesh by the name that a URDF gives it: of a package, or beside it."""
    kind, _, rest = name.rpartition("://")
    if Path(rest).suffix.lower() not in KINDS:
        return None
    if kind == "file":
        return Path(rest) if Path(rest).exists() else None
    folder = path.resolve().parent
    inside = Path(rest) if kind != "package" else Path(*Path(rest).parts[1:])
    for base in (folder, *folder.parents):
        for part in (Path(rest), inside):
            if (base / part).is_file():
                return base / part
    return None


def _colour(material: ET.Element) -> Rgba | None:
    colour = material.find("color")
    if colour is None:
        return None
    r, g, b, *a = _numbers(colour.get("rgba", "0.7 0.7 0.7")).tolist()
    return r, g, b, a[0] if a else 1.0


def _numbers(text: str) -> Array:
    return np.array([float(part) for part in text.split()])


def _can_draw(file: Path) -> bool:
    """Say whether MuJoCo reads a file: of STL the binary kind, and not too large."""
    if file.suffix.lower() == ".stl":
        with file.open("rb") as stream:
            count = int.from_bytes(stream.read(84)[80:], "little")
        return 0 < count <= _MOST_FACES and file.stat().st_size == 84 + 50 * count
    if file.suffix.lower() == ".obj":
        try:
            return 'face=""' not in _obj_content(file)
        except ValueError:
            return False
    return True


def _from_rpy(angles: Array) -> Mat33:
    """Return the rotation by roll, pitch and yaw [rad] about fixed axes."""
    turned = np.eye(3)
    for axis, angle in enumerate(angles):
        quat = np.zeros(4)
        quat[0], quat[1 + axis] = np.cos(angle / 2.0), np.sin(angle / 2.0)
        turned = matrix_from_quat(quat) @ turned
    return turned


def mesh_xml(name: str, drawn: Drawn) -> str:
    """Return the MJCF asset of one of these."""
    scale = " ".join(f"{part:.9g}" for part in drawn.scale)
    if drawn.file.suffix.lower() == ".obj":
        content = _obj_content(drawn.file)
    else:
        content = f"file={quoteattr(str(drawn.file))}"
    return f'<mesh name="{name}" {content} scale="{scale}" inertia="shell"/>'


@cache
def _obj_content(file: Path) -> str:
    """Return vertices and triangles of all objects in a file: MuJoCo reads one only."""
    vertices: list[str] = []
    faces: list[str] = []
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
        kind, *parts = line.split() or [""]
        if kind == "v":
            vertices.append(" ".join(parts[:3]))
        elif kind == "f":
            numbers = [int(part.partition("/")[0]) for part in parts]
            corners = [n - 1 if n > 0 else len(vertices) + n for n in numbers]
            pairs = itertools.pairwise(corners[1:])
            faces += [f"{corners[0]} {one} {other}" for one, other in pairs]
    return f'vertex="{"  ".join(vertices)}" face="{"  ".join(faces)}"'


def geom_xml(name: str, drawn: Drawn, usual: Rgba) -> str:
    """Return the MJCF geom of one of these, in its body's frame."""
    quat = quat_from_matrix(drawn.rotation)
    rgba = drawn.rgba or usual
    pos, turn, colour = (
        " ".join(f"{float(part):.9g}" for part in row)
        for row in (drawn.position, quat, rgba)
    )
    return (
        f'<geom class="visual" type="mesh" mesh="{name}" pos="{pos}" quat="{turn}" '
        f'rgba="{colour}" mass="0"/>'
    )
