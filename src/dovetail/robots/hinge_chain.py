"""Choice of the seven hinges of an arm among the joints of a robot file."""

from typing import TYPE_CHECKING, Any

from dovetail.errors import ConfigError
from dovetail.robots.robot_file import RobotFile
from dovetail.robots.xml_file import listed

if TYPE_CHECKING:
    from collections.abc import Sequence

    import mujoco

NUM_JOINTS = 7
_GRIP = ("gripper", "finger", "jaw", "knuckle")
"""Words in the name of a hinge that opens a hand, and is none of the arm's."""


def choose_hinges(
    spec: "mujoco.MjSpec", file: RobotFile, joints: "Sequence[str] | None"
) -> list[str]:
    """Return the names of the seven hinges, from base to flange.

    Without names it is the one row of seven hinges that begins at the base. Slides,
    joints that mimic another, hinges that are called a gripper's, and what branches off
    after the seventh (fingers) or beside them (a head) are others. Another eighth hinge
    in the row is not, as nothing says which of them are the arm's.

    Args:
        spec: The file, each joint with a name.
        file: Its path, lines and mimics.
        joints: The names, if they are given.

    Raises:
        ConfigError: No such row, or several; names the joints.
    """
    kinds = _kinds(spec)
    every = listed([f"{n} ({k})" if k != "hinge" else n for n, k in kinds.items()])
    if joints is not None:
        return _require_given(list(joints), kinds, file, every)
    rows = _rows(spec, file, kinds)
    found = list(dict.fromkeys(row[:NUM_JOINTS] for row in rows if len(row) == 7))
    if len(found) == 1:
        return list(found[0])
    if found:
        arms = "; ".join(f"{row[0]} to {row[-1]}" for row in found[:4])
        raise ConfigError(
            f"{file.path} has {len(found)} rows of {NUM_JOINTS} hinges ({arms}), and "
            f"an arm is one: name its seven from base to flange with joints=[...] of "
            "from_urdf or from_mjcf, or leave the other arm out of the file"
        )
    longest = max(map(len, rows), default=0)
    hinges = sum(kind == "hinge" for kind in kinds.values())
    most = "" if longest in (hinges, 0) else f", at most {longest} of them in a row"
    grips = [name for name, kind in kinds.items() if kind == "hinge" and _grips(name)]
    remedy = "these have " + str(hinges)
    if longest > NUM_JOINTS or grips:
        taken = f"not counted as a hand's, by name: {listed(grips)}; " if grips else ""
        remedy = (
            f"{taken}name the seven from base to flange with joints=[...] of from_urdf "
            "or from_mjcf; the others stay at their zero"
        )
    raise ConfigError(
        f"{file.path} has {len(kinds)} joints ({every}){most}; an arm has {NUM_JOINTS} "
        f"hinges in a row: {remedy}"
    )


def others_note(spec: "mujoco.MjSpec", file: RobotFile, names: list[str]) -> list[str]:
    """Say which joints are taken and which stay; nothing where there are no others."""
    others = [name for name in _kinds(spec) if name not in names]
    if not others:
        return []
    return [
        f"{file.path.name}: the arm is {names[0]} to {names[-1]}; {listed(others)} "
        f"{'stays' if len(others) == 1 else 'stay'} at zero"
    ]


def _kinds(spec: "mujoco.MjSpec") -> dict[str, str]:
    """Return the kind of each joint by its name."""
    import mujoco

    return {
        joint.name: str(mujoco.mjtJoint(joint.type).name).removeprefix("mjJNT_").lower()
        for joint in spec.joints
    }


def _require_given(
    names: list[str], kinds: dict[str, str], file: RobotFile, every: str
) -> list[str]:
    """Return the names that are given, or say why they are not seven hinges."""
    for name in names:
        if name not in kinds:
            raise ConfigError(f"{file.path} has no joint {name!r}; known: {every}")
    hinges = sum(kinds[name] == "hinge" for name in names)
    if hinges < NUM_JOINTS:
        raise ConfigError(
            f"{file.path} has {len(kinds)} joints ({every}); an arm of {NUM_JOINTS} "
            f"hinges is needed, and joints=[...] have {hinges}"
        )
    if len(names) != NUM_JOINTS or len(set(names)) != NUM_JOINTS:
        raise ConfigError(
            f"joints=[...] names {len(set(names))} different joints ({listed(names)}); "
            f"an arm has {NUM_JOINTS}"
        )
    for name in names:
        if name in file.mimics:
            raise ConfigError(
                f"{file.path}: {file.where('joint', name)} mimics {file.mimics[name]} "
                "and has no motor of its own: name seven others with joints=[...]"
            )
    return names


def _grips(name: str) -> bool:
    return any(word in name.lower() for word in _GRIP)


def _rows(
    spec: "mujoco.MjSpec", file: RobotFile, kinds: dict[str, str]
) -> list[tuple[str, ...]]:
    """Return the hinges in a row from the base: each until it branches or ends.

    A row of seven that branches is whole: fingers branch off. A shorter one goes on in
    each of its branches, but for those of a hand.
    """
    rows: list[tuple[str, ...]] = []
    first = _hinges_below(spec.worldbody, file, kinds)
    open_rows = [((name,), body) for name, body in first]
    while open_rows:
        row, body = open_rows.pop()
        below = _hinges_below(body, file, kinds)
        further = [(name, at) for name, at in below if not _grips(name)]
        if not further or (len(row) == NUM_JOINTS and len(below) > 1):
            rows.append(row)
            continue
        open_rows += [((*row, name), at) for name, at in further]
    return rows


def _hinges_below(
    body: Any, file: RobotFile, kinds: dict[str, str]
) -> list[tuple[str, Any]]:
    """Return the next hinges below a body, and their bodies; a mimic is none."""
    found: list[tuple[str, Any]] = []
    for child in body.bodies:
        own = [
            joint.name
            for joint in child.joints
            if kinds[joint.name] == "hinge" and joint.name not in file.mimics
        ]
        # two hinges of one body are no row of links
        found += [(own[0], child)] if own else _hinges_below(child, file, kinds)
    return found
