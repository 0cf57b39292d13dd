"""Connector: push a plug, which the fingers hold a little wrong, into its port."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.settings import settings
from dovetail.tasks.connector.geometry import (
    DEPTH,
    LENGTH,
    SECTIONS,
    SUCCESS_DEPTH,
    Kind,
    plug,
    port,
)
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.grasp import Grasp
from dovetail.tasks.opening import IntoOpening, widened_gap
from dovetail.types import Vec3
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import Tool, wsg50


@settings()
class ConnectorStarts:
    """Ranges of the port and of the plug's start (uniform)."""

    middle: tuple[float, float, float] = (0.60, 0.0, 0.10)
    """Middle of the positions of the port's mouth [m], world axes."""
    half_range: tuple[float, float, float] = (0.05, 0.05, 0.02)
    """Half range about it [m]."""
    yaw: float = 0.3
    """Half range of the port's turn about the vertical [rad]."""
    aside: float = 0.06
    """Half range of the plug's start beside the port, along world x and y [m]."""
    height: tuple[float, float] = (0.02, 0.08)
    """Range of its height over the mouth [m]."""
    turn: float = 0.2
    """Half range of its turn against the port [rad]."""


@dataclass(frozen=True, kw_only=True)
class Connector(IntoOpening):
    """Push a plug into its port; where it is in the fingers nobody has measured.

    It may be displaced by 2 mm along each axis and turned by 0.04 rad about each, more
    than the port forgives. So it is found by touch, and turned upright in the port.
    """

    axes: str = "XYZ:force ABC:pose"
    """Mode of each axis: a plug that is held askew has to be turned upright."""
    connector: Kind = "sfp"
    """Connector: sfp or sc."""
    randomisation: ConnectorStarts = field(default_factory=ConnectorStarts)
    """Ranges of starts and ports."""
    clearance: float = field(init=False, default=0.0)
    """Gap on the narrower sides [m], of the connector."""

    done_word: ClassVar[str] = "plugged in"
    """The plug is in the port, deep enough."""
    grasp: ClassVar[Grasp] = Grasp(0.002, 0.04)
    """As the grasp of the AI for Industry Challenge."""
    columns: ClassVar[tuple[str, ...]] = (
        *("joints", "position", "theta", "tilt", "velocity"),
    )
    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("A", 0.56, -0.045, 0.085, -0.15),
        FixturePose("B", 0.60, 0.045, 0.10, 0.10),
        FixturePose("C", 0.64, -0.01, 0.115, 0.20),
    )
    """Poses of the port when a policy is tried."""
    recording_pose: ClassVar[FixturePose] = FixturePose("aside", 0.60, 0.0, 0.09, 0.0)
    """In the middle of the walls, and low."""

    def __post_init__(self) -> None:
        """Refuse a connector that is not known."""
        if self.connector not in SECTIONS:
            raise ConfigError(
                f"connector {self.connector!r} is unknown; known: {', '.join(SECTIONS)}"
            )
        section = SECTIONS[self.connector]
        gaps = [(o - i) / 2.0 for i, o in zip(section.plug, section.port, strict=True)]
        object.__setattr__(self, "clearance", min(gaps))
        super().__post_init__()

    def held(self) -> Part:
        """Return the plug; the middle of its end face is the TCP."""
        return plug(self.connector)

    def tool(self) -> Tool:
        """Return the gripper about the plug's wide side."""
        return wsg50(opening=SECTIONS[self.connector].plug[0], reach=LENGTH)

    def fixture(self, widened: float) -> Part:
        """Return the board with the port, in the port's frame.

        Raises:
            ConfigError: A gap would be negative.
        """
        widened_gap(self.clearance, widened)
        return port(self.connector, widened)

    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw the pose of the port's mouth."""
        ranges = self.randomisation
        half = np.asarray(ranges.half_range)
        position = np.asarray(ranges.middle) + rng.uniform(-half, half)
        return Pose(position, quat_about_z(rng.uniform(-ranges.yaw, ranges.yaw)))

    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw the tool's start over the port and beside it."""
        ranges = self.randomisation
        yaw = 2.0 * math.atan2(fixture.quat_wxyz[3], fixture.quat_wxyz[0])
        low = np.array([-ranges.aside, -ranges.aside, ranges.height[0]])
        high = np.array([ranges.aside, ranges.aside, ranges.height[1]])
        offset = rng.uniform(low, high)
        turn = rng.uniform(-ranges.turn, ranges.turn)
        return Pose(fixture.position + offset, tool_down(yaw + turn))

    def has_fixed_fixture(self) -> bool:
        """Return True if every port that is drawn is the same."""
        ranges = self.randomisation
        return not any((*ranges.half_range, ranges.yaw))

    def depths(self) -> tuple[float, float]:
        """Return how deep the port is, and which depth is done [m]."""
        return DEPTH, SUCCESS_DEPTH

    def zero_offset(self) -> Vec3:
        """Return the mouth from the goal [m]: there millimetres decide."""
        return DEPTH * np.array([0.0, 0.0, 1.0])

    def describe(self) -> list[str]:
        """Return the connector in words."""
        return [f"{self.connector} connector"]
