"""Read a seven-joint arm from a URDF or MJCF file, through MuJoCo's own loader."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.errors import ConfigError
from dovetail.robots.drawn import Drawn, read_drawn
from dovetail.robots.geometry import Geometry
from dovetail.robots.inertia import merge_bodies
from dovetail.robots.links import Links
from dovetail.robots.robot_limits import RobotLimits
from dovetail.types import Array, Mat33, Vec3

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import mujoco

NUM_JOINTS = 7


def load_robot(
    path: Path,
    root: str,
    *,
    joints: "Sequence[str] | None" = None,
    flange: str | None = None,
    dq_max: "Sequence[float] | None" = None,
    tau_max: "Sequence[float] | None" = None,
) -> "dict[str, Any]":
    """Read the fields of a `Robot`; bodies fixed to a link are merged into it.

    Args:
        path: URDF or MJCF file; its meshes need not exist for a URDF.
        root: Root element, ``robot`` for URDF or ``mujoco`` for MJCF.
        joints: Names of the seven hinges from base to flange, if there are others;
            the others stay at their zero.
        flange: Site or body that is the flange; default the last link's frame.
        dq_max: Speed limits [rad/s]; MJCF has none, URDF's are the default.
        tau_max: Torque limits [Nm]; default from the file.

    Raises:
        ConfigError: Unreadable file, not seven hinges in a row, a limit missing.
    """
    import mujoco

    model, limits, shapes = _compile(path, root)
    names = _joint_names(model, path, joints)
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in names]
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    data.qpos[model.jnt_qposadr[ids]] = 0.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    frames = _joint_frames(model, data, ids, names)
    mass, com, inertia = _links(model, data, ids, frames)
    position, rotation = _flange(model, data, ids, flange)
    _, last = frames[-1]
    if not all(model.jnt_limited[ids]):
        free = names[list(model.jnt_limited[ids]).index(0)]
        raise ConfigError(f"joint {free} in {path} has no position limits: add a range")
    speed = _limit("dq_max", dq_max, names, limits["velocity"], path)
    effort = limits["effort"] or _motor_limits(model)
    torque = _limit("tau_max", tau_max, names, effort, path)
    return {
        "name": path.stem,
        "geometry": Geometry(
            origin_position=np.array([p for p, _ in _relative(frames)]),
            origin_rotation=np.array([R for _, R in _relative(frames)]),
            flange_position=last.T @ (position - frames[-1][0]),
            flange_rotation=last.T @ rotation,
        ),
        "links": Links(mass=mass, com=com, inertia=inertia),
        "limits": RobotLimits(
            q_min=model.jnt_range[ids, 0],
            q_max=model.jnt_range[ids, 1],
            dq_max=speed,
            tau_max=torque,
        ),
        "drawn": _drawn(model, data, ids, frames, shapes),
    }


def _compile(
    path: Path, root: str
) -> "tuple[mujoco.MjModel, dict[str, dict], dict[str, list[Drawn]]]":
    """Compile the file; for a URDF also read limits that MuJoCo drops, and shapes."""
    import mujoco

    limits: dict[str, dict[str, float]] = {"velocity": {}, "effort": {}}
    try:
        tree = ET.parse(path)
    except (OSError, ET.ParseError) as error:
        raise ConfigError(f"cannot read robot file {path}: {error}") from error
    if tree.getroot().tag != root:
        raise ConfigError(
            f"{path} has root element <{tree.getroot().tag}>, expected <{root}>: "
            "URDF files start with <robot>, MJCF files with <mujoco>"
        )
    try:
        if root == "mujoco":
            return mujoco.MjModel.from_xml_path(str(path)), limits, {}
        shapes = read_drawn(tree.getroot(), path)
        _prepare_urdf(tree.getroot(), limits)
        options = ET.SubElement(tree.getroot(), "mujoco")
        ET.SubElement(options, "compiler", fusestatic="false", strippath="true")
        text = ET.tostring(tree.getroot(), encoding="unicode")
        return mujoco.MjModel.from_xml_string(text), limits, shapes
    except ValueError as error:
        raise ConfigError(f"MuJoCo cannot load {path}: {error}") from error


def _prepare_urdf(robot: ET.Element, limits: dict[str, dict[str, float]]) -> None:
    """Drop the shapes, whose meshes may be missing, and note the joints' limits."""
    for link in robot.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    for joint in robot.iter("joint"):
        for element in joint.findall("limit"):
            for kind, known in limits.items():
                if element.get(kind) is not None:
                    known[str(joint.get("name"))] = float(str(element.get(kind)))


def _joint_names(
    model: "mujoco.MjModel", path: Path, joints: "Sequence[str] | None"
) -> list[str]:
    """Return the seven hinges' names, or say which joints the file has."""
    import mujoco

    hinge = int(mujoco.mjtJoint.mjJNT_HINGE)
    every = [model.joint(i).name or f"(unnamed {i})" for i in range(model.njnt)]
    names = list(joints) if joints is not None else every
    for name in names:
        if name not in every:
            known = ", ".join(every)
            raise ConfigError(f"{path} has no joint {name!r}; known: {known}")
        if model.jnt_type[every.index(name)] != hinge:
            raise ConfigError(f"joint {name} in {path} is not a hinge")
    if len(names) != NUM_JOINTS:
        raise ConfigError(
            f"{path} has {len(names)} joints ({', '.join(names) or 'none'}); an arm of "
            f"{NUM_JOINTS} hinges is needed: name them with joints=[...]"
        )
    return names


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


def _motor_limits(model: "mujoco.MjModel") -> dict[str, float]:
    """Read torque limits from the joints or from the actuators that drive them."""
    import mujoco

    limits: dict[str, float] = {}
    for i in range(model.nu):
        if (
            model.actuator_trntype[i] == int(mujoco.mjtTrn.mjTRN_JOINT)
            and model.actuator_forcelimited[i]
        ):
            joint = model.joint(int(model.actuator_trnid[i, 0])).name
            gear = abs(float(model.actuator_gear[i, 0]))
            limits[joint] = gear * float(np.abs(model.actuator_forcerange[i]).min())
    for i in range(model.njnt):
        if model.jnt_actfrclimited[i]:
            limits[model.joint(i).name] = float(np.abs(model.jnt_actfrcrange[i]).min())
    return limits


def _limit(
    name: str,
    given: "Sequence[float] | None",
    joints: list[str],
    known: "Mapping[str, float]",
    path: Path,
) -> Array:
    """Take the given limits, else the file's, else say which joint has none."""
    if given is not None:
        return np.array(given, dtype=float)
    for joint in joints:
        if joint not in known:
            raise ConfigError(
                f"{path} gives no {name} for joint {joint}: pass {name}=[...] with "
                f"{NUM_JOINTS} values"
            )
    return np.array([known[joint] for joint in joints])
