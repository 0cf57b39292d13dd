"""Meshes that a body is drawn with, as files on this machine.

Nothing collides with them and they weigh nothing.
"""

import importlib.util
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import matrix_from_quat, quat_from_matrix, quat_from_vector
from dovetail.robots.meshes import FACES, find_mesh, read_mesh
from dovetail.robots.xml_file import named, numbers, shown
from dovetail.types import Mat33, Vec3

_SCALE = (1e-6, 1e6)
"""Smallest and largest scale of a mesh."""
_BYTES = 40_000_000
"""Most of an arm's files in all [bytes]."""
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


def read_drawn(
    robot: ET.Element, path: Path
) -> tuple[dict[str, list[Drawn]], tuple[str, ...]]:
    """Read what the links of a URDF are drawn as.

    What is not here, or cannot be drawn, is left out: a plain body is in its place.

    Args:
        robot: Root of the URDF.
        path: Where that is.

    Returns:
        Shapes by the links' names, in their frames, and notes on what is left out.

    Raises:
        ConfigError: A colour that is no numbers.
    """
    colours = {
        name: colour
        for material in robot.iter("material")
        if (colour := _colour(material)) and (name := material.get("name"))
    }
    found: dict[str, list[Drawn]] = {}
    lacks: list[str] = []
    size = faces = 0
    for link in robot.iter("link"):
        shapes = found.setdefault(str(link.get("name")), [])
        for visual in link.findall("visual"):
            if (mesh := visual.find("geometry/mesh")) is None:
                continue
            try:
                one = _read_one(visual, mesh, path, colours)
                size += one.file.stat().st_size
                if size > _BYTES or faces > FACES:
                    raise ConfigError(
                        f"an arm's meshes may have {_BYTES} bytes and {FACES} triangles"
                    )
                faces += len(read_mesh(one.file).faces)
                shapes.append(one)
            except ConfigError as error:
                name = shown(str(mesh.get("filename")))
                lacks.append(f"{name}, in {named(link)}: {error}")
    if not lacks:
        return found, ()
    count = f"{len(lacks)} mesh{'es are' if len(lacks) > 1 else ' is'} not drawn"
    return found, (f"{path.name}: {count}; the first is {lacks[0]}",)


def _read_one(
    visual: ET.Element, mesh: ET.Element, path: Path, colours: Mapping[str, Rgba]
) -> Drawn:
    origin = visual.find("origin")
    place = visual if origin is None else origin
    material = visual.find("material")
    name = None if material is None else material.get("name")
    scale = np.broadcast_to(numbers(mesh, "scale", "1 1 1", (1, 3)), 3).tolist()
    low, high = _SCALE
    if not all(low <= abs(part) <= high for part in scale):
        raise ConfigError(f"{named(mesh)} has the scale {scale}")
    return Drawn(
        find_mesh(str(mesh.get("filename")), path),
        numbers(place, "xyz", "0 0 0"),
        _from_rpy(numbers(place, "rpy", "0 0 0")),
        (scale[0], scale[1], scale[2]),
        colours.get(name or ""),
    )


def _colour(material: ET.Element) -> Rgba | None:
    colour = material.find("color")
    if colour is None:
        return None
    r, g, b, *a = numbers(colour, "rgba", "0.7 0.7 0.7", (3, 4)).tolist()
    return r, g, b, a[0] if a else 1.0


def _from_rpy(angles: Vec3) -> Mat33:
    """Return the rotation by roll, pitch and yaw [rad] about fixed axes."""
    x, y, z = (matrix_from_quat(quat_from_vector(turn)) for turn in np.diag(angles))
    return z @ y @ x


def add_mesh(assets: ET.Element, name: str, drawn: Drawn) -> None:
    """Add the MJCF asset of one of these."""
    scale = _words(drawn.scale)
    mesh = ET.SubElement(assets, "mesh", name=name, scale=scale, inertia="shell")
    if drawn.file.suffix.lower() == ".obj":  # of these MuJoCo reads the first object
        content = read_mesh(drawn.file)
        mesh.set("vertex", _words(content.vertices.ravel()))
        mesh.set("face", " ".join(map(str, content.faces.ravel().tolist())))
    else:
        mesh.set("file", str(drawn.file))


def add_geom(body: ET.Element, name: str, drawn: Drawn, usual: Rgba) -> None:
    """Add the MJCF geom of one of these, in its body's frame."""
    facts = {"class": "visual", "type": "mesh", "mesh": name, "mass": "0"}
    ET.SubElement(
        body,
        "geom",
        facts,
        pos=_words(drawn.position),
        quat=_words(quat_from_matrix(drawn.rotation)),
        rgba=_words(drawn.rgba or usual),
    )


def _words(values: "Vec3 | tuple[float, ...]") -> str:
    return " ".join(f"{float(value):.9g}" for value in values)
