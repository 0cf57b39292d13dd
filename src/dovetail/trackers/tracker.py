"""Interface of a tracker: the fixture's pose, as far as the environment may know it."""

from typing import NamedTuple, Protocol, TypeGuard, runtime_checkable

from dovetail.arms.arm import ArmState
from dovetail.poses import Pose
from dovetail.types import Array


class Estimate(NamedTuple):
    """One estimate of the fixture's pose."""

    pose: Pose
    """Its frame [m] and rotation (wxyz, z out of the fixture), world axes."""
    age: float
    """Time since it was measured [s]."""
    covariance: Array | None = None
    """Of position [m] and rotation vector [rad], world axes, shape (6, 6); None is not
    known."""


class Tracker(Protocol):
    """Anything that can say where the fixture is.

    One that holds something is a `ClosableTracker`, too: the environment closes it.
    """

    def reset(self, fixture: Pose, seed: int) -> None:
        """Start an episode whose fixture really is at `fixture`.

        Args:
            fixture: Its true pose.
            seed: Of this episode's noise.
        """
        ...

    def update(self, fixture: Pose, state: ArmState) -> None:
        """Take in what has happened since the last call.

        Args:
            fixture: Where it really is; a tracker that looks for itself ignores it.
            state: What the arm has measured; `stamp` is the episode's time [s].
        """
        ...

    def estimate(self) -> Estimate:
        """Return the newest estimate; `reset` comes first."""
        ...


@runtime_checkable
class ClosableTracker(Protocol):
    """A tracker that holds something: a device, or OpenGL."""

    def close(self) -> None:
        """Give it back; harmless when repeated."""
        ...


@runtime_checkable
class ArmTracker(Tracker, Protocol):
    """A tracker that may look from the arm: from a camera on its flange."""

    @property
    def is_on_arm(self) -> bool:
        """True if it looks from the arm: that is then taken above the fixture first."""
        ...

    def rewind(self, fixture: Pose) -> None:
        """Go on in an episode whose time begins at 0 again, with what was seen.

        Args:
            fixture: Its true pose.
        """
        ...


def is_on_arm(tracker: Tracker) -> TypeGuard[ArmTracker]:
    """Say whether a tracker looks from the arm."""
    return isinstance(tracker, ArmTracker) and tracker.is_on_arm


def close_tracker(tracker: Tracker) -> None:
    """Close a tracker, if it can be closed."""
    if isinstance(tracker, ClosableTracker):
        tracker.close()
