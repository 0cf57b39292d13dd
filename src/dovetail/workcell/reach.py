"""Reach of a robot: distances of its wrist from its shoulder."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dovetail.robots.robot import Robot
from dovetail.types import Vec3

_SHARE = 0.99  # of the longest distance: stretched out an arm cannot move on
_ANGLES = 181


class Reach(NamedTuple):
    """Of the tool at work, measured at the wrist."""

    shoulder: Vec3
    """Position of the second joint, world axes [m]."""
    nearest: float
    """Smallest distance of the wrist from it [m]: the elbow's limit."""
    farthest: float
    """Largest one [m]."""
    above: float
    """Wrist to TCP along the tool [m]."""
    aside: float
    """Distance of the wrist from the tool's axis [m]."""

    def excess(self, distance: float) -> float:
        """Return by how much a wrist so far from the shoulder is out of reach [m]."""
        return max(distance - self.farthest, self.nearest - distance) - self.aside


@lru_cache(maxsize=64)
def reach_of(robot: Robot) -> Reach:
    """Return what a robot with its tool reaches, by its chain: origin 2, 4 and 6."""
    position, rotation = np.zeros(3), np.eye(3)
    origins, frames, at = [], [], robot.geometry
    for p, R in zip(at.origin_position, at.origin_rotation, strict=True):
        position, rotation = position + rotation @ p, rotation @ R
        origins.append(position)
        frames.append(rotation)
    shoulder, elbow, wrist = origins[1], origins[3], origins[5]
    forearm = frames[3].T @ (wrist - elbow)
    angles = np.linspace(robot.limits.q_min[3], robot.limits.q_max[3], _ANGLES)
    c, s = np.cos(angles), np.sin(angles)
    x, y, z = forearm
    ends = np.stack([c * x - s * y, s * x + c * y, np.full(_ANGLES, z)], axis=1)
    distances = np.linalg.norm(elbow + ends @ frames[3].T - shoulder, axis=1)
    flange = position + rotation @ at.flange_position
    turn = rotation @ at.flange_rotation
    axis = (turn @ at.tool_rotation)[:, 2]
    offset = flange + turn @ at.tool_position - wrist
    above = float(offset @ axis)
    return Reach(
        shoulder,
        float(distances.min()),
        _SHARE * float(distances.max()),
        above,
        float(np.linalg.norm(offset - above * axis)),
    )
