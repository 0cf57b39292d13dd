"""The flange of a robot file: a frame that it names, or that of the last joint."""

import re
from typing import TYPE_CHECKING

import numpy as np

from dovetail.robots.robot_file import RobotFile
from dovetail.types import Mat33, Vec3

if TYPE_CHECKING:
    import mujoco

_NAMES = (
    r"flange",
    r"tool0",
    r"attachment",
    r"link_?8",
    r"end_?effector",
    r"^mount of ",
    r"(^|_)eef?($|_|\d)",
    r"(^|_)(hand|tool)($|_)",
)
"""Usual names of a flange, the first one found is taken."""
_PARALLEL = 1e-3
"""Largest sine between the flange's z and the last joint's axis."""
_ON_AXIS = 2e-3
"""Largest distance of the flange from that axis [m]."""


def choose_flange(
    model: "mujoco.MjModel",
    data: "mujoco.MjData",
    moved: list[int],
    frames: list[tuple[Vec3, Mat33]],
    file: RobotFile,
) -> tuple[tuple[Vec3, Mat33], str]:
    """Return the flange at q = 0 in the world, and what is said of it.

    It lies on the axis of the last joint, and its z points out of the arm. A frame of a
    usual name that does so is taken, else the last joint's own, turned if need be.

    Args:
        model: The arm.
        data: It at q = 0.
        moved: Bodies that move with the last joint.
        frames: The joints' frames, z along each axis.
        file: Its path, for the note.
    """
    at, axes = frames[-1]
    out = _outward(model, data, moved, frames)
    for name, p, R in _named(model, data, moved):
        aside = p - at - ((p - at) @ out) * out
        is_along = R[:, 2] @ out > np.sqrt(1.0 - _PARALLEL**2)
        if is_along and np.linalg.norm(aside) < _ON_AXIS:
            return (p, R), f"{file.path.name}: the flange is {name}"
    turn = np.eye(3) if axes[:, 2] @ out > 0.0 else np.diag([1.0, -1.0, -1.0])
    return (at, axes @ turn), (
        f"{file.path.name} names no flange (z out of the arm, on the last joint's "
        "axis): the tool is mounted where that joint is; add a link or site flange"
    )


def _outward(
    model: "mujoco.MjModel",
    data: "mujoco.MjData",
    moved: list[int],
    frames: list[tuple[Vec3, Mat33]],
) -> Vec3:
    """Return the direction of the last axis that leads out of the arm.

    From the sixth joint to the last link's frames and masses: the farthest along.
    """
    axis = frames[-1][1][:, 2]
    points = [data.xpos[body] for body in moved] + [data.xipos[body] for body in moved]
    points += [
        data.site_xpos[i] for i in range(model.nsite) if model.site_bodyid[i] in moved
    ]
    along = (np.array([*points, frames[-1][0]]) - frames[-2][0]) @ axis
    return axis if along[np.argmax(np.abs(along))] >= 0.0 else -axis


def _named(
    model: "mujoco.MjModel", data: "mujoco.MjData", moved: list[int]
) -> list[tuple[str, Vec3, Mat33]]:
    """Return the frames of usual names that move with the last joint, best first."""
    found = [
        (model.body(i).name, np.array(data.xpos[i]), data.xmat[i].reshape(3, 3).copy())
        for i in moved
    ]
    found += [
        (
            model.site(i).name,
            np.array(data.site_xpos[i]),
            data.site_xmat[i].reshape(3, 3).copy(),
        )
        for i in range(model.nsite)
        if model.site_bodyid[i] in moved
    ]
    return [
        frame
        for pattern in _NAMES
        for frame in found
        if re.search(pattern, frame[0], re.IGNORECASE)
    ]
