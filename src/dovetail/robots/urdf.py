"""Reader of a URDF: checked, and written as MuJoCo reads it."""

import xml.etree.ElementTree as ET
from pathlib import Path

from dovetail.errors import ConfigError
from dovetail.robots.drawn import read_drawn
from dovetail.robots.robot_file import RobotFile, places_of
from dovetail.robots.xml_file import (
    DEPTH,
    Node,
    listed,
    named,
    number,
    numbers,
    shown,
)

_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_COMPILER = ("balanceinertia", "boundmass", "boundinertia", "settotalmass")
"""Settings of a URDF's own <mujoco><compiler> that are kept; an arm needs no others."""
_DYNAMICS = {"damping": "damping", "frictionloss": "friction"}
"""URDF attributes of a motor, by MuJoCo's word for each."""
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def read_urdf(robot: Node, path: Path) -> RobotFile:
    """Check the links and joints of a URDF.

    Raises:
        ConfigError: Not a tree of links, an unknown type, or an attribute that is no
            number; names link or joint, and the line.
    """
    for node in robot.iter():
        if node.tag.startswith("xacro:"):
            raise ConfigError(
                f"{path} has {named(node)}: it is a xacro file; expand it first: xacro "
                f"{path.name} > arm.urdf"
            )
    links, joints = _by_name(robot, "link", path), _by_name(robot, "joint", path)
    _require_tree(links, joints, path)
    drawn, notes = read_drawn(robot, path)
    tree = ET.Element("robot", name="arm")
    tree.extend([_link(link) for link in links.values()])
    tree.extend([_joint(joint) for joint in joints.values()])
    ET.SubElement(ET.SubElement(tree, "mujoco"), "compiler", _compiler(robot))
    limits = {name: joint.find("limit") for name, joint in joints.items()}
    known = {
        kind: {
            name: number(limit, kind)
            for name, limit in limits.items()
            if limit is not None and limit.get(kind) is not None
        }
        for kind in ("velocity", "effort")
    }
    return RobotFile(
        path=path,
        tree=tree,
        velocity=known["velocity"],
        effort=known["effort"],
        said={
            "damping": frozenset(
                name
                for name, joint in joints.items()
                if joint.find("dynamics[@damping]") is not None
            )
        },
        mimics={
            name: str(mimic.get("joint"))
            for name, joint in joints.items()
            if (mimic := joint.find("mimic")) is not None
        },
        endless=frozenset(
            name for name, joint in joints.items() if joint.get("type") == "continuous"
        ),
        drawn=drawn,
        notes=notes,
        places=places_of(robot),
    )


def _by_name(robot: Node, tag: str, path: Path) -> dict[str, Node]:
    found: dict[str, Node] = {}
    for node in robot.findall(tag):
        assert isinstance(node, Node)
        name = node.get("name")
        if not name:
            raise ConfigError(f"{path}: {named(node)} has no name")
        if name in found:
            raise ConfigError(
                f"{path}: {named(node)} is there twice: the first is in "
                f"{found[name].place}; rename one"
            )
        found[name] = node
    return found


def _require_tree(links: dict[str, Node], joints: dict[str, Node], path: Path) -> None:
    """Refuse joints whose links are unknown, or that make no tree."""
    parents: dict[str, str] = {}
    mounts: dict[str, Node] = {}
    for joint in joints.values():
        if joint.get("type") not in _TYPES:
            raise ConfigError(
                f"{path}: {named(joint)} has the type {shown(str(joint.get('type')))!r}"
                f"; known: {', '.join(_TYPES)}"
            )
        ends = {}
        for end in ("parent", "child"):
            node = joint.find(end)
            ends[end] = link = "" if node is None else node.get("link", "")
            if link not in links:
                raise ConfigError(
                    f"{path}: the {end} of {named(joint)} is "
                    f"{shown(link) if link else 'missing'}; the file's links: "
                    f"{listed([*links])}"
                )
        child = ends["child"]
        if child in mounts:
            raise ConfigError(
                f"{path}: {named(links[child])} is the child of two joints, "
                f"{named(mounts[child])} and {named(joint)}; a link has one parent"
            )
        parents[child], mounts[child] = ends["parent"], joint
    roots = [name for name in links if name not in parents]
    if len(roots) != 1:
        raise ConfigError(
            f"{path} has {len(roots)} links that no joint carries ({listed(roots)}); "
            "an arm has one, its base"
        )
    for link in links:
        above, steps = link, 0
        while above in parents:
            above, steps = parents[above], steps + 1
            if steps > min(len(links), DEPTH):
                raise ConfigError(
                    f"{path}: {named(links[link])} hangs on more than {DEPTH} joints, "
                    "or on itself: the joints make a loop"
                )


def _copy(node: Node, tag: str, facts: dict[str, tuple[int, ...]]) -> Node:
    """Return an element with these attributes alone, each of so many numbers."""
    copy = Node(tag)
    vars(copy)["place"] = node.place
    for name, counts in facts.items():
        if node.get(name) is not None:
            copy.set(
                name, " ".join(map(repr, numbers(node, name, None, counts).tolist()))
            )
    return copy


def _link(link: Node) -> Node:
    """Return a link with its mass alone, without shapes."""
    copy = _copy(link, "link", {})
    copy.set("name", str(link.get("name")))
    inertial = link.find("inertial")
    if inertial is None:
        return copy
    mass = inertial.find("mass")
    inertia = inertial.find("inertia")
    for node, what in ((mass, "mass"), (inertia, "inertia")):
        if node is None:
            raise ConfigError(f"{named(link)}: its <inertial> has no <{what}>")
    assert isinstance(mass, Node)
    assert isinstance(inertia, Node)
    if number(mass, "value") < 0.0:
        raise ConfigError(f"{named(link)} has a mass of {mass.get('value')} kg: < 0")
    into = _copy(Node("inertial"), "inertial", {})
    into.extend(_origin(inertial))
    into.append(_copy(mass, "mass", {"value": (1,)}))
    full = _copy(inertia, "inertia", dict.fromkeys(_MOMENTS, (1,)))
    for moment in _MOMENTS:
        full.set(moment, full.get(moment, "0"))
    into.append(full)
    copy.append(into)
    return copy


def _origin(node: ET.Element) -> list[Node]:
    origin = node.find("origin")
    if not isinstance(origin, Node):
        return []
    return [_copy(origin, "origin", {"xyz": (3,), "rpy": (3,)})]


def _joint(joint: Node) -> Node:
    copy = _copy(joint, "joint", {})
    copy.set("name", str(joint.get("name")))
    copy.set("type", str(joint.get("type")))
    for end in ("parent", "child"):
        node = joint.find(end)
        assert node is not None  # see _require_tree
        ET.SubElement(copy, end, link=str(node.get("link")))
    copy.extend(_origin(joint))
    facts = {
        "axis": {"xyz": (3,)},
        "limit": dict.fromkeys(("lower", "upper"), (1,)),
        "dynamics": dict.fromkeys(("damping", "friction"), (1,)),
    }
    for tag, attributes in facts.items():
        if isinstance(node := joint.find(tag), Node):
            copy.append(_copy(node, tag, attributes))
    _require_facts(copy, joint)
    axis = copy.find("axis")
    if axis is None:
        return copy
    if joint.get("type") in ("fixed", "floating"):
        copy.remove(axis)
    elif not numbers(axis, "xyz").any():
        raise ConfigError(f"{named(joint)} has the axis 0 0 0: give its direction")
    return copy


def _require_facts(copy: Node, joint: Node) -> None:
    """Drop limits that a joint does not have, and refuse reversed or negative ones."""
    limit, dynamics = copy.find("limit"), copy.find("dynamics")
    if limit is not None:
        if joint.get("type") in ("continuous", "planar"):
            copy.remove(limit)
        elif number(limit, "lower", "0") > number(limit, "upper", "0"):
            raise ConfigError(f"{named(joint)}: lower is more than upper; swap them")
    for fact in _DYNAMICS.values():
        if dynamics is not None and number(dynamics, fact, "0") < 0.0:
            raise ConfigError(f"{named(joint)}: {fact} is < 0; it must be >= 0")


def _compiler(robot: Node) -> dict[str, str]:
    """Return MuJoCo's options: the file's that change a mass, and dovetail's own."""
    options = {
        name: value
        for compiler in robot.findall("mujoco/compiler")
        for name, value in compiler.items()
        if name in _COMPILER
    }
    return options | {"fusestatic": "false", "strippath": "true"}
