"""A robot file as it was read: its tree for MuJoCo, and what MuJoCo drops of it."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dovetail.robots.drawn import Drawn
from dovetail.robots.xml_file import Node


@dataclass(frozen=True, kw_only=True)
class RobotFile:
    """A URDF or MJCF file, with nothing left in it that opens or generates more."""

    path: Path
    """Path of the file."""
    tree: ET.Element
    """Tree for MuJoCo: bodies, joints, masses, and motors' limits."""
    velocity: Mapping[str, float] = field(default_factory=dict)
    """Speed limits by joint [rad/s], of a URDF."""
    effort: Mapping[str, float] = field(default_factory=dict)
    """Torque limits by joint [Nm], of a URDF."""
    said: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """Joints for which the file gives damping or armature; "*" is all."""
    mimics: Mapping[str, str] = field(default_factory=dict)
    """Joints that another one moves, and which."""
    endless: frozenset[str] = frozenset()
    """Joints of a URDF that turn without end."""
    drawn: Mapping[str, list[Drawn]] = field(default_factory=dict)
    """Meshes of the links, in their frames, of a URDF."""
    meshes: Mapping[str, Path] = field(default_factory=dict)
    """Files of triangles by the name that the tree has for them, of an MJCF."""
    notes: tuple[str, ...] = ()
    """Unused parts of the file."""
    places: Mapping[tuple[str, str], str] = field(default_factory=dict)
    """Lines by kind (joint, body) and name."""

    def where(self, kind: str, name: str) -> str:
        """Return a joint or a body for a message, with its line."""
        place = self.places.get((kind, name))
        word = "link" if kind == "body" and self.tree.tag == "robot" else kind
        return f"{word} {name} ({place})" if place else f"{word} {name}"


def places_of(root: ET.Element) -> dict[tuple[str, str], str]:
    """Return the lines of the joints and bodies below an element."""
    kinds = {"joint": "joint", "freejoint": "joint", "body": "body", "link": "body"}
    return {
        (kinds[node.tag], str(node.get("name"))): node.place
        for node in root.iter()
        if isinstance(node, Node) and node.tag in kinds
    }
