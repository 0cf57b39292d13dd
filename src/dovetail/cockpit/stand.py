"""Pose of the fixture at the beginning of an episode."""

from collections.abc import Sequence

from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.workspace import require_inside
from dovetail.errors import ConfigError
from dovetail.poses import Pose
from dovetail.tasks.fixture_pose import FixturePose


class Stand:
    """Place of one cell's fixture: where it was left, as given, or the task's own."""

    def __init__(
        self, core: ContactEnv, given: Sequence[float] | None, left: Pose | None
    ) -> None:
        """Note the places.

        Args:
            core: The environment.
            given: x y z [m] and yaw [rad], world axes; None is the task's own.
            left: Where it stood in the cell before; forgotten where this task cannot be
                done there.
        """
        self.first = core.task.trial_poses[0]
        """The task's own first place."""
        self._given, self._left = given, left
        if left is not None:
            try:
                require_inside(core.task, core.cell, core.arm, left)
            except ConfigError:
                self._left = None

    def pose(self, core: ContactEnv, is_there: bool) -> Pose:
        """Return the fixture's pose for a reset.

        Args:
            core: The environment.
            is_there: Whether it stands somewhere already; there it stays.
        """
        if is_there:
            return core.fixture
        if self._left is not None:
            return self._left
        if self._given is not None:
            return FixturePose.given(self._given, self.first.facing).pose()
        return self.first.pose()
