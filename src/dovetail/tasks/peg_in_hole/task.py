"""Peg in hole (Kaspar et al. 2020): push a peg into a hole whose pose is known."""

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from dovetail.poses import Pose, matrix_from_quat
from dovetail.tasks.facing import FacingName
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.opening import IntoOpening, widened_gap
from dovetail.tasks.peg_in_hole.geometry import (
    HoleBlock,
    Peg,
    PegShape,
    hole_outline,
)
from dovetail.tasks.peg_in_hole.starts import (
    HoleRangeConfig,
    RandomisationConfig,
    sample_hole,
    sample_start,
)
from dovetail.tasks.task import Outline
from dovetail.types import Vec3
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import Tool, wsg50


@dataclass(frozen=True, kw_only=True)
class PegInHole(IntoOpening):
    """The paper's task: XYZ as accelerations, the turn about the vertical as a pose.

    The goal is the peg's pose when inserted: its end in the middle of the hole's floor,
    its rotation the hole's. Done is `HoleBlock.success_depth` below the mouth and
    inside the hole. Starts below the block's surface, beside it, are included: see
    `RandomisationConfig`.
    """

    axes: str = "XYZ:force A:pose BC:hold"
    """Mode of each axis."""
    peg: PegShape = "square"
    """Shape of peg and hole: square, triangle or round."""
    clearance: float = 0.0005
    """Gap between peg and hole on each side [m]."""
    block: HoleBlock = field(default_factory=HoleBlock)
    """Block that the peg goes into."""
    randomisation: RandomisationConfig = field(default_factory=RandomisationConfig)
    """Ranges of starts and holes."""
    tilt: float = 0.0
    """Half range of the hole's tilt about its own x and y [rad]; up to 0.2. Above 0 B
    and C are commanded, and the policy sees tilt and mouth."""
    facing: FacingName = "up"
    """Way that the hole opens: up, or towards the robot, in a wall, with a level tool.
    Then B and C are commanded, too."""

    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("A", 0.56, -0.045, 0.085, -0.15),
        FixturePose("B", 0.60, 0.045, 0.10, 0.10),
        FixturePose("C", 0.64, -0.01, 0.115, 0.20),
    )
    """The three hole poses of the transfer table: x, y, z and theta all differ."""
    recording_pose: ClassVar[FixturePose] = FixturePose("aside", 0.60, 0.0, 0.09, 0.0)
    """In the middle of the walls, and low."""

    def __post_init__(self) -> None:
        """Refuse a peg or a clearance that cannot be built."""
        Peg(shape=self.peg)
        super().__post_init__()
        ranges, usual = self.randomisation, HoleRangeConfig()
        if (ranges.hole_centre, ranges.hole_range) == (
            usual.hole_centre,
            usual.hole_range,
        ):
            there = {
                "hole_centre": self._way.middle,
                "hole_range": self._way.half_range,
            }
            object.__setattr__(self, "randomisation", replace(ranges, **there))

    def held(self) -> Part:
        """Return the peg; its end face is the TCP."""
        return Peg(shape=self.peg).part()

    def tool(self) -> Tool:
        """Return the gripper about the peg."""
        peg = Peg(shape=self.peg)
        return wsg50(opening=peg.width, reach=peg.length)

    def fixture(self, widened: float) -> Part:
        """Return the hole's block in the hole's frame: its mouth's middle, z out.

        Raises:
            ConfigError: The clearance would be negative.
        """
        gap = widened_gap(self.clearance, widened)
        return self.block.part(Peg(shape=self.peg), gap)

    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw the true pose of the hole's mouth for an episode."""
        return self.turned_fixture(rng, sample_hole(rng, self.randomisation))

    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw the tool's start pose for an episode."""

        def draw(hole: Pose) -> Pose:
            yaw = 2.0 * math.atan2(hole.quat_wxyz[3], hole.quat_wxyz[0])
            return sample_start(rng, hole, yaw, self.randomisation)

        return self.turned_start(fixture, draw)

    def has_fixed_fixture(self) -> bool:
        """Return True if every hole that is drawn is the same."""
        return self.randomisation.is_hole_fixed and not self.tilt

    def depths(self) -> tuple[float, float]:
        """Return how deep the opening is, and which depth is done [m]."""
        return self.block.depth, self.block.success_depth

    def zero_offset(self) -> Vec3:
        """Return the mouth from the goal [m]: there millimetres decide."""
        out = matrix_from_quat(np.array(self._way.quat_wxyz))[:, 2]
        return self.block.depth * out

    @classmethod
    def low_starts(cls) -> dict[str, Any]:
        """Return the settings with which the peg starts beside the block."""
        low, _ = RandomisationConfig().start_z
        return {"randomisation": RandomisationConfig(start_z=(low, 0.0))}

    def describe(self) -> list[str]:
        """Return peg and clearance in words."""
        words = [f"{self.peg} peg", f"{1e3 * self.clearance:g} mm clearance per side"]
        return words if self.facing == "up" else [*words, f"facing {self.facing}"]

    def outline(self) -> Outline:
        """Return the hole from above, and the block around it."""
        return Outline(
            hole_outline(Peg(shape=self.peg), self.clearance),
            self.block.width / 2.0,
            self.block.depth,
            self.block.height,
        )
