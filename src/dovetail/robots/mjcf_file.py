"""Reader of an MJCF file, reduced so that MuJoCo opens and generates nothing."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dovetail.errors import ConfigError
from dovetail.robots.meshes import KINDS, is_near, path_beside
from dovetail.robots.robot_file import RobotFile, places_of
from dovetail.robots.xml_file import DEPTH, ELEMENTS, Node, named, read_xml, shown

_MOTORS = ("general", "motor", "position", "velocity", "intvelocity", "damper")
_BODIES = ("body", "frame", "joint", "freejoint", "inertial", "geom", "site")
_KEPT = {
    "mujoco": ("compiler", "default", "asset", "worldbody", "actuator"),
    "default": ("default", "joint", "geom", "site", "mesh", *_MOTORS),
    "worldbody": _BODIES,
    "body": _BODIES,
    "frame": _BODIES,
    "asset": ("mesh",),
    "actuator": _MOTORS,
}
"""Elements that are kept, by the element that they are in."""
_GENERATORS = ("attach", "composite", "flexcomp", "replicate")
"""Elements that make bodies: without them the arm would be another one."""
_ATTRIBUTES = {
    "mujoco": (),
    "compiler": (
        *("angle", "autolimits", "balanceinertia", "boundinertia", "boundmass"),
        *("eulerseq", "inertiafromgeom", "inertiagrouprange", "settotalmass"),
    ),
    "mesh": (
        *("name", "class", "file", "vertex", "face", "scale", "refpos", "refquat"),
        "inertia",
    ),
}
"""Attributes that are kept, where not every one is."""
_DROPPED = ("material", "user", "plugin")
"""Attributes that say nothing of an arm; MuJoCo pads `user` to the longest."""
_WORDS = ("name", "class", "childclass", "mesh", "joint", "jointinparent", "file")
"""Attributes that are no numbers, so that nan is a name there."""
_FILES = 20
"""Most files that one file includes."""
_NOTES = 10


def read_mjcf(root: Node, path: Path) -> RobotFile:
    """Take over the elements of an MJCF file that say something of an arm.

    Raises:
        ConfigError: An element that generates bodies, a file outside of the folder, or
            an invalid number; names the element and its line.
    """
    whole = _with_included(root, path)
    tree = _kept(whole, path)
    joints = [*_joints(tree)]
    return RobotFile(
        path=path,
        tree=tree,
        said={
            fact: frozenset(
                "*" if is_default else str(joint.get("name"))
                for joint, is_default in joints
                if any(joint.get(word) is not None for word in words)
            )
            for fact, words in (
                ("damping", ("damping", "springdamper")),
                ("armature", ("armature",)),
            )
        },
        meshes=_name_meshes(tree, whole, path),
        notes=tuple(_notes(whole, path)),
        places=places_of(tree),
    )


def _with_included(root: Node, path: Path) -> Node:
    """Return the tree with what it includes, each file once, in place of <include>."""
    seen = {path.resolve()}
    count = sum(1 for _ in root.iter())

    def expand(node: Node, depth: int) -> Node:
        nonlocal count
        whole = Node(node.tag, node.attrib)
        vars(whole)["place"] = node.place
        if depth > DEPTH:
            raise ConfigError(f"{path}: {named(node)} is nested more than {DEPTH} deep")
        for child in node:
            assert isinstance(child, Node)
            if child.tag != "include":
                whole.append(expand(child, depth + 1))
                continue
            file = path_beside(path, child.get("file", ""))
            if not is_near(file, path):
                raise ConfigError(
                    f"{path}: {named(child)} includes {shown(child.get('file', ''))}; "
                    "only files of its own folder and of the one above are read"
                )
            if file.resolve() in seen or len(seen) > _FILES:
                raise ConfigError(
                    f"{path}: {named(child)} includes {file.name} once more, or more "
                    f"than {_FILES} files"
                )
            seen.add(file.resolve())
            part = read_xml(file, included=True)
            count += sum(1 for _ in part.iter())
            if count > ELEMENTS:
                raise ConfigError(
                    f"{path} has more than {ELEMENTS} elements with what it includes"
                )
            whole.extend(expand(part, depth + 1))
        return whole

    return expand(root, 1)


def _kept(node: Node, path: Path) -> Node:
    """Return an element with those in it that say something of an arm."""
    attributes = {
        name: value
        for name, value in node.items()
        if name in _ATTRIBUTES.get(node.tag, (name,)) and name not in _DROPPED
    }
    for name, value in attributes.items():
        if name not in _WORDS and not all(map(_is_finite, value.split())):
            raise ConfigError(
                f"{path}: {named(node)}: {name} is {shown(value)!r}; it must be finite"
            )
    copy = Node(node.tag, attributes)
    vars(copy)["place"] = node.place
    for child in node:
        assert isinstance(child, Node)
        if child.tag in _GENERATORS:
            raise ConfigError(
                f"{path}: {named(child)} generates bodies, which a robot file may not; "
                "write them out, for example by saving the compiled model with "
                "mujoco.mj_saveLastXML"
            )
        if child.tag in _KEPT.get(node.tag, ()):
            copy.append(_kept(child, path))
    return copy


def _is_finite(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return True  # a word, or no number: MuJoCo says so


def _joints(node: Node) -> Iterator[tuple[Node, bool]]:
    """Yield each joint, and whether it is the default of others."""
    for child in node:
        assert isinstance(child, Node)
        if child.tag == "joint":
            yield child, node.tag == "default"
        yield from _joints(child)


def _name_meshes(tree: Node, whole: Node, path: Path) -> dict[str, Path]:
    """Put a name of ours in place of each mesh's file, and return the files by it."""
    options: dict[str, str] = {}
    for compiler in whole.iter("compiler"):
        options |= compiler.attrib
    folder = options.get("meshdir", options.get("assetdir", ""))
    files: dict[str, Path] = {}
    for mesh in tree.findall("asset/mesh"):
        if (given := mesh.get("file")) is None:
            continue
        inner = Path(given).name if options.get("strippath") == "true" else given
        file = path_beside(path, str(Path(folder) / inner))
        if mesh.get("name") is None:
            mesh.set("name", Path(given).stem)
        suffix = file.suffix.lower() if file.suffix.lower() in KINDS else ".stl"
        name = f"mesh{len(files)}{suffix}"
        mesh.set("file", name)
        files[name] = file
    return files


def _notes(whole: Node, path: Path) -> Iterator[str]:
    """Say what of the joints the controller and its limits cannot use."""
    found = [
        f"{path.name}: the spring of {named(joint)} is not used"
        for joint, _ in _joints(whole)
        if any(joint.get(word) is not None for word in ("stiffness", "springdamper"))
    ]
    found += [
        f"{path.name}: the equality of {named(node)} is not used"
        for node in whole.findall("equality/joint")
    ]
    yield from found[:_NOTES]
    if len(found) > _NOTES:
        yield f"{path.name}: {len(found) - _NOTES} more such things are not used"
