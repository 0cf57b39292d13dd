"""Going into an opening that an episode draws, with the tool's start about it."""

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from dovetail.control.task_spec import AXES, HOLD, POSE, TaskSpec
from dovetail.poses import Pose, matrix_from_quat, quat_multiply
from dovetail.settings import Range, in_range
from dovetail.tasks.facing import Facing, FacingName, find_facing
from dovetail.tasks.fixture_pose import UPRIGHT, FixturePose, turned
from dovetail.tasks.opening import IntoOpening
from dovetail.tasks.region import Region
from dovetail.tasks.starts import (
    FixtureRangeConfig,
    RandomisationConfig,
    sample_fixture,
    sample_start,
)
from dovetail.types import Vec3

TILT = Range(0.0, 0.2, "rad")
"""Half range of a fixture's tilt about each of its axes x and y; 0.2 is tested."""
_USUAL = RandomisationConfig()
TRIED_TILTS = (1.0, 0.0), (0.0, 1.0), (-0.7, -0.7)
"""Tilts about its own x and y of the places where a policy is tried, as shares."""


def with_tilt(axes: str) -> str:
    """Return the mode of each axis with B and C to the goal where they were held.

    What is held stays as the episode began, and would not follow a fixture's tilt.
    """
    task = TaskSpec.parse(axes)
    tilting = [AXES.index("B"), AXES.index("C")]
    modes = (
        POSE if i in tilting and mode == HOLD else mode
        for i, mode in enumerate(task.modes)
    )
    return str(TaskSpec(tuple(modes)))


@dataclass(frozen=True, kw_only=True)
class DrawnOpening(IntoOpening):
    """Places of the fixture, starts and tries, for tasks that say the parts alone."""

    axes: str = "XYZ:force A:pose BC:hold"
    """Mode of each axis."""
    randomisation: RandomisationConfig = field(default_factory=RandomisationConfig)
    """Ranges of starts and fixtures."""
    tilt: float = 0.0
    """Largest tilt of the fixture [rad], to 0.2.
    It is about its own x and y. Above 0 B and C are commanded, and the policy sees tilt
    and mouth."""
    facing: FacingName = "up"
    """Way that it opens: up, or robot.
    Robot is towards it, in a wall, with a level tool. Then B and C are commanded."""

    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("A", 0.56, -0.045, 0.085, -0.15),
        FixturePose("B", 0.60, 0.045, 0.10, 0.10),
        FixturePose("C", 0.64, -0.01, 0.115, 0.20),
    )
    """Poses of the fixture when a policy is tried: x, y, z and theta all differ."""
    trial_region: ClassVar[Region | None] = Region.about(
        _USUAL.middle, _USUAL.half_range, _USUAL.yaw
    )
    """The region from which a training draws fixtures on a table."""
    recording_pose: ClassVar[FixturePose | None] = FixturePose(
        "aside", 0.60, 0.0, 0.09, 0.0
    )
    """In the middle of the walls, and low."""

    @property
    def _way(self) -> Facing:
        return find_facing(self.facing)

    def __post_init__(self) -> None:
        """Refuse what cannot be built, and go to where such fixtures stand."""
        super().__post_init__()
        tilt = float(in_range("tilt", self.tilt, TILT))
        object.__setattr__(self, "tilt", tilt)
        if tilt > 0.0 or self.facing != "up":
            self._let_turn(self._way)
        ranges, usual = self.randomisation, FixtureRangeConfig()
        there = {"middle": self._way.middle, "half_range": self._way.half_range}
        if all(vars(ranges)[name] == vars(usual)[name] for name in there):
            object.__setattr__(self, "randomisation", replace(ranges, **there))

    def _let_turn(self, way: Facing) -> None:
        """Let the tool turn to such fixtures, show the turn, and try them."""
        shown = [name for name in ("tilt", "mouth") if name not in self.columns]
        tilts = self.tilt * np.array(TRIED_TILTS)
        poses = tuple(
            way.place(pose, *map(float, tilts[i % len(tilts)]))
            for i, pose in enumerate(self.trial_poses)
        )
        made = {"axes": with_tilt(self.axes), "columns": (*self.columns, *shown)}
        made |= {"trial_poses": poses, "recording_pose": None}
        if self.facing != "up":
            made |= {"posture": way.posture, "walls": way.walls, "trial_region": None}
        for name, value in made.items():
            object.__setattr__(self, name, value)

    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw the true pose of the mouth for an episode, tilted and as it faces."""
        return self._draw_fixture(rng, self.randomisation)

    def draw_in(self, rng: np.random.Generator, region: Region) -> Pose:
        """Draw the true pose of the mouth in the region of a cell file."""
        x, y, z = region.half.tolist()
        ranges = replace(
            self.randomisation,
            middle=tuple(region.middle.tolist()),
            half_range=(x, y, z),
            yaw=region.half_yaw,
        )
        return region.turned(self._draw_fixture(rng, ranges))

    def _draw_fixture(
        self, rng: np.random.Generator, ranges: RandomisationConfig
    ) -> Pose:
        upright = sample_fixture(rng, ranges)
        if self.tilt > 0.0:
            tilt = turned(UPRIGHT, 0.0, *rng.uniform(-self.tilt, self.tilt, 2))
            upright = upright._replace(quat_wxyz=quat_multiply(upright.quat_wxyz, tilt))
        if self.facing == "up":
            return upright
        return self._way.turned_out(upright, upright.position)

    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw the tool's start pose for an episode, as if the fixture opened upwards.

        The tool does not know of a tilt: it has to turn.
        """
        is_up = self.facing == "up"
        upright = fixture if is_up else self._way.turned_back(fixture)
        yaw = 2.0 * math.atan2(upright.quat_wxyz[3], upright.quat_wxyz[0])
        start = sample_start(rng, upright, yaw, self.randomisation)
        return start if is_up else self._way.turned_out(start, fixture.position)

    def has_fixed_fixture(self) -> bool:
        """Return True if every fixture that is drawn is the same."""
        return self.randomisation.is_fixed and not self.tilt

    def zero_offset(self) -> Vec3:
        """Return the mouth from the goal [m]: there millimetres decide."""
        out = matrix_from_quat(np.array(self._way.quat_wxyz))[:, 2]
        depth, _ = self.depths()
        return depth * out
