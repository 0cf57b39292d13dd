"""Disturbances of a simulated arm in a step: push at the TCP, motion of the fixture."""

import math
from typing import TYPE_CHECKING

import numpy as np

from dovetail.poses import Pose
from dovetail.types import Vec3

if TYPE_CHECKING:
    from dovetail.plants.plant import Plant


class Disturbance:
    """Acts on a plant between control cycles, so that none of it comes in jumps."""

    def __init__(self) -> None:
        """Begin with nothing that disturbs."""
        self.clear()

    def clear(self) -> None:
        """Forget everything; the plant's own reset takes the force away."""
        self._force = np.zeros(3)
        self._cycles_left = 0
        self._fixture: Pose | None = None
        self._velocity = np.zeros(3)
        self._is_sliding = False
        self.is_active = False  # whether anything is to be done between cycles

    def push(self, force: Vec3, duration: float, period: float) -> None:
        """Push with a force [N], world axes, for a duration [s], in whole periods."""
        self._force = np.array(force, dtype=float)
        self._cycles_left = math.ceil(duration / period - 1e-9)
        self.is_active = self._cycles_left > 0 or self._is_sliding

    def slide(self, fixture: Pose, velocity: Vec3) -> None:
        """Move the fixture on from a pose with a velocity [m/s], world axes."""
        self._fixture, self._velocity = fixture, np.array(velocity, dtype=float)
        self._is_sliding = bool(self._velocity.any())
        self.is_active = self._cycles_left > 0 or self._is_sliding

    def before_cycle(self, plant: "Plant", period: float) -> None:
        """Let one control cycle's share act on the plant."""
        if self._cycles_left > 0:
            plant.push(self._force)
        if self._fixture is not None and self._is_sliding:
            position = self._fixture.position + period * self._velocity
            self._fixture = self._fixture._replace(position=position)
            plant.move_fixture(self._fixture)

    def after_cycle(self, plant: "Plant") -> None:
        """Take a push away whose time is over."""
        if self._cycles_left > 0:
            self._cycles_left -= 1
            if self._cycles_left == 0:
                plant.push(np.zeros(3))
                self.is_active = self._is_sliding
