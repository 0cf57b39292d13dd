"""Search for a fixture that was moved while the camera was covered.

The policy is not changed: it is told of a fixture that wanders. While nothing newer
is known, the believed fixture moves from where it was seen last along a spiral, a
little below the surface, so that the policy drags the part over the block until it
drops in.
Everything is decided by the part's height, as measured: no force is needed.
"""

import math
from dataclasses import dataclass

import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.poses import (
    TOOL_DOWN,
    Pose,
    matrix_from_quat,
    quat_about_z,
    quat_multiply,
    theta_about_vertical,
)
from dovetail.trackers.tracker import Estimate, Tracker
from dovetail.types import Vec3

_DEEP = 0.002
"""Depth from which the part can only be in the fixture [m]."""


@dataclass(frozen=True, kw_only=True)
class SearchConfig:
    """How the believed fixture wanders; speed and pitch are for 0.5 mm clearance."""

    speed: float = 0.0045
    """Speed along the spiral [m/s]: the part fell in at the first pass over a
    fixture 20 mm off in 21 of 21 tries begun 1.5 mm before it, at 6 mm/s in 20; at 10
    mm/s it mostly slides over."""
    pitch: float = 0.0007
    """Distance between two turns [m]: the part falls in within 0.5 mm of the middle."""
    reach: float = 0.032
    """Radius at which the search begins again, between the first one's turns [m]."""
    press: float = 0.001
    """How far below the surface the fixture is believed [m]: at 0 the policy hovers,
    at 2 mm friction holds the part back."""
    gain: float = 0.3
    """Share of the distance to the spiral's point that the policy is told of [1]: at 1
    it hunts by a millimetre per step, from one side to the other."""
    surface: float = 0.0008
    """Largest height of the part's end above the surface while it is on it [m]."""
    lead: float = 0.002
    """Largest distance of the spiral's point from the part while it moves on [m]."""
    patience: float = 0.5
    """Time after which it moves on although the part does not follow [s]."""
    drop: float = 0.00015
    """Depth below the surface at which the part may have found the fixture [m]."""
    hold: float = 1.0
    """How long it may then go no deeper than 2 mm before the search goes on [s]."""
    turn_rate: float = 1.0
    """How fast the believed rotation takes back what the part is turned by [1/s]:
    sliding leaves 0.02 rad, which closes half of 0.5 mm clearance at the corners."""
    turn_max: float = 0.05
    """Largest correction of the believed rotation [rad]."""

    @classmethod
    def for_clearance(cls, clearance: float) -> "SearchConfig":
        """Return the search for a clearance per side [m]: finer for less."""
        share = clearance / 0.0005
        return cls(speed=0.0045 * share, pitch=0.0007 * share)


class SpiralSearch:
    """A tracker that searches while the one inside sees nothing."""

    def __init__(self, tracker: Tracker, config: SearchConfig | None = None) -> None:
        """Take the tracker that would see the fixture, were it not covered."""
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
        self._turn = 0.0  # of the believed fixture about its axis [rad]

    def reset(self, fixture: Pose, seed: int) -> None:
        """Start an episode whose fixture really is at `fixture`."""
        self.tracker.reset(fixture, seed)
        self._begin()
        self._stamp = 0.0

    def update(self, fixture: Pose, state: ArmState) -> None:
        """Move the believed fixture on, by what the arm has measured."""
        self.tracker.update(fixture, state)
        seen, age, _ = self.tracker.estimate()
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
        """Turn the believed fixture against what friction turns the part by."""
        goal = quat_multiply(seen.quat_wxyz, TOOL_DOWN)
        theta = theta_about_vertical(state.quat_wxyz, goal)
        turn = self._turn - self.config.turn_rate * theta * dt
        self._turn = min(max(turn, -self.config.turn_max), self.config.turn_max)

    def estimate(self) -> Estimate:
        """Return where the fixture is believed, and how old the last sight of it is."""
        seen, age, _ = self.tracker.estimate()
        quat = quat_multiply(seen.quat_wxyz, quat_about_z(self._turn))
        return Estimate(Pose(seen.position + self._offset, quat), age)

    def _is_found(self, tip: Vec3, dt: float) -> bool:
        """Say whether the part is in the fixture, or may be: then it is to go down.

        Args:
            tip: The part's end in the frame of the fixture as it was seen [m].
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
        """Return where to tell the fixture is [m], in the frame as it was seen."""
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
        """Return the spiral's point [m], in the frame of the fixture as it was seen."""
        r = self._radius()
        angle = 2.0 * math.pi * r / self.config.pitch + self._phase
        return np.array([r * math.cos(angle), r * math.sin(angle), -self.config.press])
