"""Search for a hole that was moved while the camera was covered.

The policy is not changed: it is told of a hole that wanders. While nothing newer is
known, the believed hole moves from where it was seen last along a spiral, and a little
below the surface, so that the policy drags the peg over the block until it drops in.
Everything is decided by the peg's height, as measured: no force is needed.
"""

import math
from dataclasses import dataclass

import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.envs.hole_tracker import HoleEstimate, HoleTracker
from dovetail.envs.observation import theta_about_vertical
from dovetail.envs.randomisation import TOOL_DOWN
from dovetail.poses import Pose, matrix_from_quat, quat_about_z, quat_multiply
from dovetail.types import Vec3

_DEEP = 0.002
"""Depth from which the peg can only be in the hole [m]."""


@dataclass(frozen=True, kw_only=True)
class SearchConfig:
    """How the believed hole wanders; speed and pitch are for 0.5 mm clearance."""

    speed: float = 0.0045
    """Speed along the spiral [m/s]: the peg fell in at the first pass over a hole 20 mm
    off in 21 of 21 tries begun 1.5 mm before it, at 6 mm/s in 20; at 10 mm/s it mostly
    slides over."""
    pitch: float = 0.0007
    """Distance between two turns [m]: the peg falls in within 0.5 mm of the middle."""
    reach: float = 0.032
    """Radius at which the search begins again, between the first one's turns [m]."""
    press: float = 0.001
    """How far below the surface the hole is believed [m]: at 0 the policy hovers, at 2
    mm friction holds the peg back."""
    gain: float = 0.3
    """Share of the distance to the spiral's point that the policy is told of [1]: at 1
    it hunts by a millimetre per step, from one side to the other."""
    surface: float = 0.0008
    """Largest height of the peg's end above the surface while it is on it [m]."""
    lead: float = 0.002
    """Largest distance of the spiral's point from the peg while it moves on [m]."""
    patience: float = 0.5
    """Time after which it moves on although the peg does not follow [s]."""
    drop: float = 0.00015
    """Depth below the surface at which the peg may have found the hole [m]."""
    hold: float = 1.0
    """How long it may then go no deeper than 2 mm before the search goes on [s]."""
    turn_rate: float = 1.0
    """How fast the believed rotation takes back what the peg is turned by [1/s]:
    sliding leaves 0.02 rad, which closes half of 0.5 mm clearance at the corners."""
    turn_max: float = 0.05
    """Largest correction of the believed rotation [rad]."""

    @classmethod
    def for_clearance(cls, clearance: float) -> "SearchConfig":
        """Return the search for a clearance per side [m]: finer for less."""
        share = clearance / 0.0005
        return cls(speed=0.0045 * share, pitch=0.0007 * share)


class SpiralSearch:
    """A hole tracker that searches while the one inside sees nothing."""

    def __init__(
        self, tracker: HoleTracker, config: SearchConfig | None = None
    ) -> None:
        """Take the tracker that would see the hole, were it not covered."""
        self.tracker = tracker
        self.config = config or SearchConfig()
        self._begin()
        self._stamp = 0.0

    def _begin(self) -> None:
        self._is_begun = False
        self._length = 0.0  # of the spiral, so far [m]
        self._phase = 0.0
        self._held = self._waited = 0.0
        self._offset: Vec3 = np.zeros(3)
        self._turn = 0.0  # of the believed hole about its axis [rad]

    def reset(self, hole: Pose) -> None:
        """Start an episode whose hole really is at `hole`."""
        self.tracker.reset(hole)
        self._begin()
        self._stamp = 0.0

    def update(self, hole: Pose, state: ArmState) -> None:
        """Move the believed hole on, by what the arm has measured."""
        self.tracker.update(hole, state)
        seen, age = self.tracker.estimate()
        dt, self._stamp = state.stamp - self._stamp, state.stamp
        if age <= 0.0:
            self._begin()
            return
        R = matrix_from_quat(seen.quat_wxyz)
        tip = R.T @ (state.position - seen.position)
        if self._is_found(tip, dt):
            told = np.array([tip[0], tip[1], -self.config.press])
        else:
            told = self._lead(tip, dt)
        self._offset = R @ told
        if self._is_begun:
            self._align(seen, state, dt)

    def _align(self, seen: Pose, state: ArmState, dt: float) -> None:
        """Turn the believed hole against what friction turns the peg by."""
        goal = quat_multiply(seen.quat_wxyz, TOOL_DOWN)
        theta = theta_about_vertical(state.quat_wxyz, goal)
        turn = self._turn - self.config.turn_rate * theta * dt
        self._turn = min(max(turn, -self.config.turn_max), self.config.turn_max)

    def estimate(self) -> HoleEstimate:
        """Return where the hole is believed, and how old the last sight of it is."""
        seen, age = self.tracker.estimate()
        quat = quat_multiply(seen.quat_wxyz, quat_about_z(self._turn))
        return HoleEstimate(Pose(seen.position + self._offset, quat), age)

    def _is_found(self, tip: Vec3, dt: float) -> bool:
        """Say whether the peg is in the hole, or may be: then it is to go down.

        Args:
            tip: The peg's end in the frame of the hole as it was seen [m].
            dt: Time since the last call [s].
        """
        c = self.config
        is_down = tip[2] < -c.drop and math.hypot(tip[0], tip[1]) < c.reach + 0.001
        if not (self._is_begun and is_down):
            self._held = 0.0
            return False
        self._held = 0.0 if tip[2] < -_DEEP else self._held + dt
        return self._held <= c.hold

    def _lead(self, tip: Vec3, dt: float) -> Vec3:
        """Return where to tell the hole is [m], in the frame as it was seen."""
        c = self.config
        point = self.point()
        distance = math.hypot(tip[0] - point[0], tip[1] - point[1])
        is_there = abs(tip[2]) < c.surface and distance < c.lead
        self._is_begun = self._is_begun or is_there
        if not self._is_begun:
            return point
        self._waited = 0.0 if is_there else self._waited + dt
        if is_there or self._waited > c.patience:
            self._advance(c.speed * dt)
        point = self.point()
        point[:2] = tip[:2] + c.gain * (point[:2] - tip[:2])
        return point

    def _advance(self, way: float) -> None:
        self._length += way
        if self._radius() > self.config.reach:
            self._length = 0.0
            self._phase += math.pi

    def _radius(self) -> float:
        return math.sqrt(self.config.pitch * self._length / math.pi)

    def point(self) -> Vec3:
        """Return the spiral's point [m], in the frame of the hole as it was seen."""
        r = self._radius()
        angle = 2.0 * math.pi * r / self.config.pitch + self._phase
        return np.array([r * math.cos(angle), r * math.sin(angle), -self.config.press])
