"""Read a seven-joint arm from a URDF or MJCF file, through MuJoCo's own loader.

MuJoCo gets the bodies, joints and masses alone (`urdf`, `mjcf_file`): it opens no file
and generates nothing, and most of what is wrong is said here, with its line.
"""

import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.errors import ConfigError, UnprovenWarning
from dovetail.robots.drawn import Drawn
from dovetail.robots.file_masses import require_masses
from dovetail.robots.file_motors import read_motors, read_torque_limits
from dovetail.robots.flange import choose_flange
from dovetail.robots.geometry import Geometry
from dovetail.robots.hinge_chain import NUM_JOINTS, choose_hinges, others_note
from dovetail.robots.inertia import merge_bodies
from dovetail.robots.links import Links
from dovetail.robots.mjcf_file import read_mjcf
from dovetail.robots.motors import Motors
from dovetail.robots.own_hand import leave_hand_out
from dovetail.robots.robot_file import RobotFile
from dovetail.robots.robot_limits import RobotLimits
from dovetail.robots.urdf import read_urdf
from dovetail.robots.xml_file import listed, read_xml, write_xml
from dovetail.types import Array, Mat33, Vec3

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import mujoco

USUAL_SPEED = 1.5
"""Speed limit of a joint where a file has none that can be used [rad/s]."""
_SPEED_MOST = 7.0
"""Fastest joint that is believed [rad/s]; beyond it a limit is a placeholder."""
_ENDLESS = 2.0 * np.pi
"""Range to either side of a joint that turns without end [rad]."""


def load_robot(
    path: Path,
    root: str,
    *,
    joints: "Sequence[str] | None" = None,
    flange: str | None = None,
    dq_max: "Sequence[float] | None" = None,
    tau_max: "Sequence[float] | None" = None,
    motors: Motors | None = None,
    complete: bool = False,
) -> "dict[str, Any]":
    """Read the fields of a `Robot`; bodies fixed to a link are merged into it.

    What the file does not say, or what cannot be used of it, is in the robot's notes
    and a warning (`UnprovenWarning`).

    Args:
        path: URDF or MJCF file; its meshes need not exist for a URDF.
        root: Root element, ``robot`` for URDF or ``mujoco`` for MJCF.
        joints: Names of the seven hinges from base to flange, where several rows of
            seven could be meant; others stay at their zero.
        flange: Site or body that is the flange; default the last link's frame.
        dq_max: Speed limits [rad/s]; MJCF has none, URDF's are the default.
        tau_max: Torque limits [Nm]; default from the file.
        motors: Friction and rotor inertia; default from the file.
        complete: Choose what the file leaves open: a speed that is not given is
            `USUAL_SPEED`, the flange is the frame of such a name, and a hand that moves
            is left out.

    Raises:
        ConfigError: Unreadable file, not seven hinges in a row, a limit missing, a body
            without mass or with an inertia that no body has; names it and its line.
    """
    import mujoco

    file = _read(path, root)
    model, names, notes = _compile(file, joints, is_bare=complete)
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in names]
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    frames = _joint_frames(model, data, ids, names)
    mass, com, inertia = _links(model, data, ids, frames)
    low, high = _ranges(model, ids, names, file, notes)
    known = file.velocity
    if complete and dq_max is None:
        known = _believed(names, known, file, notes)
    speed = _limit("dq_max", dq_max, names, known, file)
    effort = file.effort or read_torque_limits(model)
    torque = _limit("tau_max", tau_max, names, effort, file)
    if tau_max is None and len(set(torque)) == 1:
        notes.append(
            f"{path.name} gives every joint {torque[0]:g} Nm, which may be a "
            "placeholder: compare it with the maker's data"
        )
    end = _flange(model, data, ids, flange)
    if complete and flange is None:
        moved = [body for body, i in _owners(model, ids).items() if i == NUM_JOINTS - 1]
        end, said = choose_flange(model, data, moved, frames, file)
        notes.append(said)
    if motors is None:
        motors = read_motors(model, ids, names, file)
    for note in (*notes, *motors.notes):
        warnings.warn(note, UnprovenWarning, stacklevel=3)
    return {
        "name": path.stem,
        "geometry": _geometry(frames, end),
        "links": Links(mass=mass, com=com, inertia=inertia),
        "limits": RobotLimits(q_min=low, q_max=high, dq_max=speed, tau_max=torque),
        "motors": motors,
        "drawn": _drawn(model, data, ids, frames, file.drawn),
        "notes": tuple(notes),
    } | ({"gripper": "any"} if complete else {})


def _read(path: Path, root: str) -> RobotFile:
    """Read the file, and refuse one of the other kind."""
    tree = read_xml(path)
    if tree.tag != root:
        raise ConfigError(
            f"{path} has root element <{tree.tag}>, expected <{root}>: "
            "URDF files start with <robot>, MJCF files with <mujoco>"
        )
    return read_urdf(tree, path) if root == "robot" else read_mjcf(tree, path)


def _compile(
    file: RobotFile, joints: "Sequence[str] | None", *, is_bare: bool
) -> "tuple[mujoco.MjModel, list[str], list[str]]":
    """Return the model of the seven hinges, all others welded, their names, and notes.

    Bare, it is without a hand of its own.
    """
    import mujoco

    text, places = write_xml(file.tree)
    try:
        spec = mujoco.MjSpec.from_string(text)
        for index, joint in enumerate(spec.joints):
            joint.name = joint.name or f"unnamed {index}"
        names = choose_hinges(spec, file, joints)
        notes = [*file.notes, *others_note(spec, file, names)]
        if is_bare:
            notes += leave_hand_out(spec, file, names[-1])
        for joint in spec.joints:
            if joint.name not in names:
                spec.delete(joint)
        for actuator in list(spec.actuators):
            if actuator.target not in names:
                spec.delete(actuator)
        require_masses(spec, file)
        return spec.compile(), names, notes
    except ValueError as error:  # MuJoCo's own, but for a ConfigError
        if isinstance(error, ConfigError):
            raise
        words = " ".join(str(error).split()).replace("XML Error: ", "")
        words = words.removeprefix("Error: ")
        words = re.sub(r"line (\d+)", lambda m: places[int(m[1]) - 1], words)
        raise ConfigError(f"MuJoCo cannot load {file.path}: {words}") from error


def _joint_frames(
    model: "mujoco.MjModel", data: "mujoco.MjData", ids: list[int], names: list[str]
) -> list[tuple[Vec3, Mat33]]:
    """Place a frame at each joint with its z along the axis, at q = 0, in the world."""
    frames: list[tuple[Vec3, Mat33]] = []
    for i, joint in enumerate(ids):
        body = int(model.jnt_bodyid[joint])
        if i and ids[i - 1] not in _joints_above(model, body):
            raise ConfigError(
                f"joint {names[i]} does not follow joint {names[i - 1]}: the seven "
                "joints must form one chain, listed from base to flange"
            )
        R = data.xmat[body].reshape(3, 3)
        turn = _rotation_to(R.T @ data.xaxis[joint])
        frames.append((np.array(data.xanchor[joint]), R @ turn))
    return frames


def _joints_above(model: "mujoco.MjModel", body: int) -> set[int]:
    """Return every joint between a body's parent and the world, and none of its own."""
    above: set[int] = set()
    while body > 0:
        body = int(model.body_parentid[body])
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        above |= set(range(first, first + count))
    return above


def _rotation_to(axis: Vec3) -> Mat33:
    """Return the smallest rotation that takes z to a unit axis."""
    if axis[2] < -1.0 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([-axis[1], axis[0], 0.0])
    x, y, _ = cross
    K = np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + K + K @ K / (1.0 + axis[2])


def _relative(frames: list[tuple[Vec3, Mat33]]) -> list[tuple[Vec3, Mat33]]:
    """Express each frame in the one before it, the first in the world."""
    parents = [(np.zeros(3), np.eye(3)), *frames[:-1]]
    return [
        (P.T @ (p - o), P.T @ R) for (o, P), (p, R) in zip(parents, frames, strict=True)
    ]


def _geometry(frames: list[tuple[Vec3, Mat33]], flange: tuple[Vec3, Mat33]) -> Geometry:
    """Return joints and flange, each in the frame before it."""
    inside, (at, last), (position, rotation) = _relative(frames), frames[-1], flange
    return Geometry(
        origin_position=np.array([p for p, _ in inside]),
        origin_rotation=np.array([R for _, R in inside]),
        flange_position=last.T @ (position - at),
        flange_rotation=last.T @ rotation,
    )


def _owners(model: "mujoco.MjModel", ids: list[int]) -> dict[int, int]:
    """Return with which of the seven joints each body moves; the base with none."""
    moved = {int(model.jnt_bodyid[joint]): i for i, joint in enumerate(ids)}
    owners: dict[int, int] = {}
    for body in range(1, model.nbody):  # a parent comes before its children
        parent = int(model.body_parentid[body])
        owner = moved.get(body, owners.get(parent))
        if owner is not None:
            owners[body] = owner
    return owners


def _drawn(
    model: "mujoco.MjModel",
    data: "mujoco.MjData",
    ids: list[int],
    frames: list[tuple[Vec3, Mat33]],
    shapes: "Mapping[str, Sequence[Drawn]]",
) -> tuple[tuple[Drawn, ...], ...]:
    """Put what is drawn into the frames of the base and of the seven joints."""
    bodies = {model.body(i).name: i for i in range(model.nbody)}
    owners = _owners(model, ids)
    drawn: list[list[Drawn]] = [[] for _ in (None, *ids)]
    for link, parts in shapes.items():
        body = bodies.get(link, 0)  # the base is the world
        at, axes = data.xpos[body], data.xmat[body].reshape(3, 3)
        joint = owners.get(body)
        p, R = (np.zeros(3), np.eye(3)) if joint is None else frames[joint]
        seen = [part.seen_from(R.T @ (at - p), R.T @ axes) for part in parts]
        drawn[0 if joint is None else joint + 1] += seen
    return tuple(tuple(parts) for parts in drawn)


def _links(
    model: "mujoco.MjModel",
    data: "mujoco.MjData",
    ids: list[int],
    frames: list[tuple[Vec3, Mat33]],
) -> tuple[Array, Array, Array]:
    """Collect the bodies that move with each joint, in that joint's frame."""
    owners = _owners(model, ids)
    parts: list[list[tuple[float, Vec3, Mat33]]] = [[] for _ in ids]
    for body in range(1, model.nbody):
        if body in owners:
            p, R = frames[owners[body]]
            axes = R.T @ data.ximat[body].reshape(3, 3)
            inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
            part = (float(model.body_mass[body]), R.T @ (data.xipos[body] - p), inertia)
            parts[owners[body]].append(part)
    merged = [merge_bodies(*bodies) for bodies in parts]
    mass = np.array([m for m, _, _ in merged])
    return mass, np.array([c for _, c, _ in merged]), np.array([i for *_, i in merged])


def _flange(
    model: "mujoco.MjModel", data: "mujoco.MjData", ids: list[int], name: str | None
) -> tuple[Vec3, Mat33]:
    """Find the flange frame at q = 0 in the world."""
    import mujoco

    if name is None:
        body = int(model.jnt_bodyid[ids[-1]])
        return np.array(data.xpos[body]), data.xmat[body].reshape(3, 3).copy()
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if site >= 0:
        return np.array(data.site_xpos[site]), data.site_xmat[site].reshape(3, 3).copy()
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if body < 0:
        known = [model.site(i).name for i in range(model.nsite)]
        known += [model.body(i).name for i in range(1, model.nbody)]
        raise ConfigError(f"no site or body {name!r}; known: {', '.join(known)}")
    return np.array(data.xpos[body]), data.xmat[body].reshape(3, 3).copy()


def _ranges(
    model: "mujoco.MjModel",
    ids: list[int],
    names: list[str],
    file: RobotFile,
    notes: list[str],
) -> tuple[Array, Array]:
    """Return the position limits, or say which joint has none.

    A joint that turns without end gets a whole turn to either side, and a note.
    """
    low, high = model.jnt_range[ids, 0].copy(), model.jnt_range[ids, 1].copy()
    endless: list[str] = []
    for i, (joint, name) in enumerate(zip(ids, names, strict=True)):
        where = f"{file.path}: {file.where('joint', name)}"
        if low[i] > high[i]:
            raise ConfigError(
                f"{where} has the range {low[i]:g} to {high[i]:g} rad; swap its ends"
            )
        if model.jnt_limited[joint] and low[i] < high[i]:
            continue
        may_be_endless = name in file.endless or file.tree.tag == "mujoco"
        if model.jnt_limited[joint] or not may_be_endless:
            raise ConfigError(
                f"{where} has no position limits: give it a range (in a URDF the type "
                "revolute, and lower and upper of its <limit>)"
            )
        low[i], high[i] = -_ENDLESS, _ENDLESS
        endless.append(name)
    if endless:
        notes.append(
            f"{file.path.name} leaves {listed(endless)} without position limits; "
            f"{-_ENDLESS:.4g} to {_ENDLESS:.4g} rad, a turn to either side, is assumed"
        )
    return low, high


def _believed(
    names: list[str], known: "Mapping[str, float]", file: RobotFile, notes: list[str]
) -> "dict[str, float]":
    """Return the speed limits, the usual one where none can be used, with a note."""
    lacks = [name for name in names if not 0.0 < known.get(name, 0.0) <= _SPEED_MOST]
    if lacks:
        said = {f"{known[name]:g} rad/s" for name in lacks if name in known}
        which = "no joint" if len(lacks) == len(names) else "not of every joint"
        notes.append(
            f"{file.path.name} gives a speed limit of {which}"
            f"{' that can be used (' + ', '.join(sorted(said)) + ')' if said else ''}: "
            f"{USUAL_SPEED:g} rad/s is assumed of {listed(lacks)}"
        )
    return {**known, **dict.fromkeys(lacks, USUAL_SPEED)}


def _limit(
    name: str,
    given: "Sequence[float] | None",
    joints: list[str],
    known: "Mapping[str, float]",
    file: RobotFile,
) -> Array:
    """Take the given limits, else the file's, else say which joint has none."""
    if given is not None:
        return np.array(given, dtype=float)
    for joint in joints:
        if not known.get(joint, 0.0) > 0.0:
            said = f"{name} {known[joint]:g}" if joint in known else f"no {name}"
            raise ConfigError(
                f"{file.path} gives {file.where('joint', joint)} {said}: write it "
                f"into the file, or pass {name}=[...] with {NUM_JOINTS} values"
            )
    return np.array([known[joint] for joint in joints])
