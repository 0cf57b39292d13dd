"""A plant around another one: what neither changes is said here once."""

from typing import TYPE_CHECKING, Generic, TypeVar

from dovetail.plants.plant import DynamicsConfig, Plant
from dovetail.poses import Pose
from dovetail.types import Vec3, Vec7

if TYPE_CHECKING:
    from dovetail import _core

Inner = TypeVar("Inner", bound=Plant)


class WrappedPlant(Generic[Inner]):
    """Hands everything on to the plant inside but how it is read and driven."""

    def __init__(self, plant: Inner) -> None:
        """Wrap a plant, which is closed with this one."""
        self.plant = plant
        self.cell = plant.cell
        self.robot = plant.robot

    @property
    def dynamics(self) -> DynamicsConfig:
        """Return the physics of the plant inside."""
        return self.plant.dynamics

    def configure(self, dynamics: DynamicsConfig) -> None:
        """Change the dynamics; delay and noise stay. Call `reset` before a torque."""
        self.plant.configure(dynamics)

    def attach_channel(self, channel: "_core.Channel") -> None:
        """Put another delay and noise between controller and joints."""
        self.plant.attach_channel(channel)

    def seed(self, seed: int) -> None:
        """Start the noise again."""
        self.plant.seed(seed)

    def reset(self, q: Vec7, fixture: Pose) -> None:
        """Put the arm at rest at q [rad], the fixture at its pose; time becomes 0."""
        self.plant.reset(q, fixture)

    def move_fixture(self, fixture: Pose) -> None:
        """Put the fixture at a pose at once, the arm's motion untouched."""
        self.plant.move_fixture(fixture)

    def push(self, force: Vec3) -> None:
        """Push the TCP with a force [N], world axes, until the next push or `reset`."""
        self.plant.push(force)

    def contact_force(self) -> Vec3:
        """Return the force on the tool in the last physics step [N], world."""
        return self.plant.contact_force()

    def contact_force_peak(self) -> Vec3:
        """Return the largest such force during the last `apply` [N], world."""
        return self.plant.contact_force_peak()

    def tool_pose(self) -> Pose:
        """Return the true pose of the TCP in the world."""
        return self.plant.tool_pose()

    def close(self) -> None:
        """Release the plant inside; harmless when repeated."""
        self.plant.close()
