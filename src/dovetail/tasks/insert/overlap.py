"""Overlap of two parts: the two shapes that are deepest in one another."""

import xml.etree.ElementTree as ET
from typing import NamedTuple

from dovetail.plants.mjcf import add_part, add_vertices
from dovetail.poses import Pose
from dovetail.workcell.parts import Part


class Overlap(NamedTuple):
    """Two shapes that overlap."""

    one: str
    """Name of the first part's shape."""
    other: str
    """Name of the second part's."""
    depth: float
    """Depth of one in the other [m]."""


def deepest_overlap(one: Part, other: Part, place: Pose) -> Overlap | None:
    """Return where two parts overlap most, or None.

    Args:
        one: A part.
        other: Another.
        place: Pose of the other's frame in the first one's.
    """
    import mujoco

    root = ET.fromstring(
        '<mujoco><option><flag multiccd="disable"/></option><asset/>'
        '<default><default class="tool"><geom contype="1" conaffinity="0"/></default>'
        '<default class="world"><geom contype="0" conaffinity="1"/></default>'
        "</default><worldbody/></mujoco>"
    )
    assets, world = root.find("asset"), root.find("worldbody")
    assert assets is not None
    assert world is not None
    placed = [shape.moved(*place) for shape in other.primitives]
    add_vertices(assets, [*one.primitives, *placed])
    moving = ET.SubElement(world, "body")
    ET.SubElement(moving, "freejoint")
    ET.SubElement(moving, "inertial", pos="0 0 0", mass="1", diaginertia="1 1 1")
    for shape in one.primitives:
        add_part(moving, shape, "tool")
    for shape in placed:
        add_part(world, shape, "world")
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    if not data.ncon:
        return None
    contact = min(data.contact[: data.ncon], key=lambda contact: contact.dist)
    names = sorted(
        (model.geom(i) for i in contact.geom), key=lambda geom: geom.contype[0]
    )
    return Overlap(names[1].name, names[0].name, -float(contact.dist))
