"""Ways that a fixture opens: upwards on a table, or towards the robot in a wall."""

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from dovetail.errors import ConfigError, did_you_mean
from dovetail.poses import (
    Pose,
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
)
from dovetail.tasks.fixture_pose import UPRIGHT, FixturePose
from dovetail.types import Vec3
from dovetail.workcell.workcell import WALLS, Walls

FacingName = Literal["up", "robot"]
"""Type of a field that names a facing."""
Numbers = tuple[float, float, float]


class Facing(NamedTuple):
    """A way that a fixture opens, and what the robot needs for it."""

    quat_wxyz: tuple[float, ...]
    """Rotation of a fixture that is neither turned nor tilted."""
    posture: str
    """The robot's posture in which inverse kinematics starts."""
    walls: Walls
    """Lower and upper walls of the TCP [m], world axes."""
    middle: Numbers
    """Middle of the fixture's places [m], world axes."""
    half_range: Numbers
    """Half range of them [m]: all that the robot's joints allow."""

    def place(self, usual: FixturePose, about_y: float, about_x: float) -> FixturePose:
        """Return a place of a fixture on the table, as this facing has it.

        Args:
            usual: On the table, not tilted.
            about_y: Tilt about the fixture's own y [rad].
            about_x: Tilt about its own x [rad].
        """
        if self.quat_wxyz == UPRIGHT:
            return usual._replace(b=about_y, c=about_x)
        up = FACINGS["up"]
        beside = np.array(usual[1:4]) - up.middle
        at = self.middle + beside / up.half_range * self.half_range
        x, y, z = at.tolist()
        # Its own x, y and z point along the world's z, y and -x.
        return FixturePose(
            usual.name, x, y, z, about_x, self.quat_wxyz, about_y, -usual.theta
        )

    def turned_back(self, fixture: Pose) -> Pose:
        """Return a fixture turned about its origin as if it opened upwards."""
        back = quat_conjugate(np.array(self.quat_wxyz))
        return fixture._replace(quat_wxyz=quat_multiply(back, fixture.quat_wxyz))

    def turned_out(self, pose: Pose, about: Vec3) -> Pose:
        """Return a pose beside a fixture that was turned back, as the fixture faces.

        Args:
            pose: Of the tool.
            about: The fixture's origin [m].
        """
        quat = np.array(self.quat_wxyz)
        position = about + matrix_from_quat(quat) @ (pose.position - about)
        return Pose(position, quat_multiply(quat, pose.quat_wxyz))


_HALF = math.sqrt(0.5)
FACINGS: Mapping[str, Facing] = {
    "up": Facing(UPRIGHT, "down", WALLS, (0.60, 0.0, 0.10), (0.05, 0.05, 0.02)),
    "robot": Facing(
        (_HALF, 0.0, -_HALF, 0.0),
        "forward",
        ((0.60, -0.15, 0.30), (0.95, 0.15, 0.50)),
        (0.87, 0.0, 0.40),
        (0.02, 0.03, 0.03),
    ),
}
"""By the side to which the fixture's z points; that of `robot` is the world's -x, and
the tool is level."""


def find_facing(name: str) -> Facing:
    """Return a way that a fixture opens.

    Raises:
        ConfigError: Unknown; lists those that there are.
    """
    if name not in FACINGS:
        raise ConfigError(
            f"facing {name!r} is unknown{did_you_mean(name, list(FACINGS))}; known: "
            f"{', '.join(FACINGS)}"
        )
    return FACINGS[name]
