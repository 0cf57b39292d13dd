"""Disturbance of a simulated arm by a user: a pull at the tool, a dragged fixture."""

import math

import numpy as np

from dovetail.arms.arm import SimulatedArm
from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z, quat_multiply, theta_about_vertical
from dovetail.types import Vec3

STIFFNESS = 400.0
"""Stiffness of the spring that pulls the tool [N/m]."""
PULL_MAX = 30.0
"""Largest force of the spring [N]: for pushes of that size the limits are made."""
DRAG_SPEED, DRAG_RATE = 0.1, 0.5
"""Speed at which the fixture follows the mouse [m/s, rad/s]."""


class UserDisturbance:
    """Acts on an arm slice by slice; the page sets the goals, from its threads.

    Each goal is one reference that is replaced as a whole, so that no thread waits.
    """

    def __init__(self) -> None:
        """Begin with nothing that disturbs."""
        self.pull_to: Vec3 | None = None
        """Position of the spring's other end, world axes [m]; None is no spring."""
        self.fixture_to: Pose | None = None
        """Pose to which the fixture is dragged; None leaves it."""
        self.force: Vec3 = np.zeros(3)
        """Force of the spring in the last slice, world axes [N]."""
        self._reached: Pose | None = None

    @property
    def is_active(self) -> bool:
        """True while it pulls the tool or drags the fixture."""
        wanted = self.fixture_to
        is_dragging = wanted is not None and wanted is not self._reached
        return self.pull_to is not None or is_dragging

    def let_go(self) -> None:
        """Stop to pull and to drag."""
        self.pull_to = self.fixture_to = None

    def act(
        self, arm: SimulatedArm, tool: Vec3, fixture: Pose, duration: float
    ) -> Pose:
        """Pull and drag during the next slice; return the fixture's pose after it.

        Args:
            arm: The arm, before its step.
            tool: Position of its TCP [m], world axes.
            fixture: Pose of the fixture now.
            duration: Duration of the slice [s].

        Raises:
            ArmError: The arm is elsewhere and cannot be disturbed from here.
        """
        pull_to, wanted = self.pull_to, self.fixture_to
        self.force = np.zeros(3)
        if pull_to is not None:
            self.force = spring_force(pull_to - tool)
            arm.push(self.force, duration)
        if wanted is None or wanted is self._reached:
            return fixture
        try:
            moved = _drag(arm, fixture, wanted, duration)
        except ConfigError:  # out of reach on the way there: it stays where it is
            moved = None
        if moved is None or moved is fixture:
            self._reached = wanted
        return moved or fixture


def spring_force(stretch: Vec3) -> Vec3:
    """Return the spring's force [N] at a stretch [m], `PULL_MAX` at most."""
    stretch = np.asarray(stretch, dtype=float)
    # Shortened along its direction first: of what a page may send, squares overflow.
    stretch = stretch / max(1.0, float(np.abs(stretch).max()))
    force = STIFFNESS * stretch
    size = float(np.linalg.norm(force))
    return force if size <= PULL_MAX else force * (PULL_MAX / size)


def _drag(arm: SimulatedArm, fixture: Pose, wanted: Pose, duration: float) -> Pose:
    """Move the fixture on towards a pose, no faster than a hand should."""
    way = wanted.position - fixture.position
    distance = float(np.linalg.norm(way))
    share = min(1.0, DRAG_SPEED * duration / distance) if distance > 0.0 else 0.0
    turn = theta_about_vertical(wanted.quat_wxyz, fixture.quat_wxyz)
    turn = math.copysign(min(abs(turn), DRAG_RATE * duration), turn)
    if share == 0.0 and turn == 0.0:
        arm.move_fixture(fixture, np.zeros(3))
        return fixture
    quat = quat_multiply(quat_about_z(turn), fixture.quat_wxyz)
    velocity = share * way / duration
    arm.move_fixture(Pose(fixture.position, quat), velocity)
    return Pose(fixture.position + share * way, quat)
