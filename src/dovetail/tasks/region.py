"""The region of the world in which a task's fixtures stand."""

from typing import NamedTuple, Self

import numpy as np

from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.types import Vec3
from dovetail.workcell.workcell import Workcell


class Region(NamedTuple):
    """A box of the fixture frame's origin, and a range of its turn."""

    low: tuple[float, ...]
    """Lower corner, x y z [m], world axes."""
    high: tuple[float, ...]
    """Upper corner [m]."""
    yaw: tuple[float, ...]
    """Smallest and largest turn about the vertical [rad]."""

    @classmethod
    def about(
        cls, middle: tuple[float, ...], half: tuple[float, ...], half_yaw: float
    ) -> Self:
        """Return the region about a middle [m], with half ranges [m, rad]."""
        low, high = np.subtract(middle, half), np.add(middle, half)
        return cls(tuple(low.tolist()), tuple(high.tolist()), (-half_yaw, half_yaw))

    @classmethod
    def around(cls, places: tuple[FixturePose, ...]) -> Self:
        """Return the smallest region that holds these places."""
        numbers = np.array([place[1:5] for place in places])
        low, high = numbers.min(axis=0).tolist(), numbers.max(axis=0).tolist()
        return cls(tuple(low[:3]), tuple(high[:3]), (low[3], high[3]))

    @classmethod
    def of(cls, cell: Workcell) -> Self | None:
        """Return the region of a cell's fixtures; None is the task's own."""
        return None if cell.fixtures is None else cls(*cell.fixtures)

    @property
    def middle(self) -> Vec3:
        """Middle of the box [m]."""
        return (np.array(self.low) + self.high) / 2.0

    @property
    def half(self) -> Vec3:
        """Half extent of the box [m]."""
        return (np.array(self.high) - self.low) / 2.0

    @property
    def middle_yaw(self) -> float:
        """Middle of the turn [rad]."""
        return (self.yaw[0] + self.yaw[1]) / 2.0

    @property
    def half_yaw(self) -> float:
        """Half range of the turn [rad]."""
        return (self.yaw[1] - self.yaw[0]) / 2.0

    @property
    def is_one_place(self) -> bool:
        """True if every fixture that is drawn is the same."""
        return self.low == self.high and self.yaw[0] == self.yaw[1]

    def draw(self, rng: np.random.Generator, facing: tuple[float, ...]) -> Pose:
        """Draw a fixture's pose, uniform.

        Args:
            rng: Where the draws come from.
            facing: Rotation (wxyz) of the fixture's frame at turn 0.
        """
        x, y, z = (self.middle + rng.uniform(-self.half, self.half)).tolist()
        yaw = self.middle_yaw + rng.uniform(-self.half_yaw, self.half_yaw)
        return FixturePose("drawn", x, y, z, yaw, facing).pose()

    def turned(self, pose: Pose) -> Pose:
        """Return a pose that was drawn about turn 0, turned by the middle turn."""
        turn = quat_about_z(self.middle_yaw)
        return pose._replace(quat_wxyz=quat_multiply(turn, pose.quat_wxyz))

    def carry(self, place: FixturePose, usual: "Region") -> FixturePose:
        """Return a place that lies in this region as the given one in the usual one."""
        spots = []
        middles = (*usual.middle, usual.middle_yaw), (*self.middle, self.middle_yaw)
        halves = (*usual.half, usual.half_yaw), (*self.half, self.half_yaw)
        for at, old, new, was, now in zip(place[1:5], *middles, *halves, strict=True):
            share = 0.0 if was < 1e-12 else (at - old) / was
            spots.append(float(new + np.clip(share, -1.0, 1.0) * now))
        x, y, z, theta = spots
        return place._replace(x=x, y=y, z=z, theta=theta)

    def corners(self, facing: tuple[float, ...]) -> list[Pose]:
        """Return the poses at its corners, at both ends of the turn."""
        axes = [
            sorted({low, high}) for low, high in zip(self.low, self.high, strict=True)
        ]
        return [
            FixturePose("corner", x, y, z, yaw, facing).pose()
            for x in axes[0]
            for y in axes[1]
            for z in axes[2]
            for yaw in sorted(set(self.yaw))
        ]
