"""A plant whose velocity is observed from its positions, as an FRI client has to do."""

from typing import TYPE_CHECKING

import numpy as np

from dovetail.control.observer import observer_gain
from dovetail.plants.cycle_loop import run_cycles
from dovetail.plants.plant import DynamicsConfig, Plant
from dovetail.poses import Pose
from dovetail.types import Array, Vec3, Vec6, Vec7

if TYPE_CHECKING:
    from dovetail import _core


class _Watched:
    """A controller whose last commanded acceleration can be read.

    What it does not believe the observer doubts, as behind FRI.
    """

    def __init__(
        self, controller: "_core.Controller", observer: "_core.VelocityObserver"
    ) -> None:
        self._controller = controller
        self._observer = observer
        self.a: Vec7 = np.zeros(7)

    def step(self, q: Vec7, dq: Vec7, target: "_core.Target") -> "_core.StepResult":
        result = self._controller.step(q, dq, target)
        if result.flags.implausible:
            self._observer.doubt()
        self.a = result.a
        return result

    @property
    def wrench(self) -> Vec6:
        return self._controller.wrench


class EncoderPlant:
    """Any plant without its velocity: what `read` gives is `VelocityObserver`'s.

    The observer is the class that the FRI servo loop uses, so that a `LocalArm` over an
    `EncoderPlant` moves as a `FriArm` on a cabinet over the same plant.
    """

    def __init__(self, plant: Plant, period: float, gain: float | None = None) -> None:
        """Wrap a plant.

        Args:
            plant: The plant; closed with this one.
            period: Control period [s]; the only one that `apply` then takes.
            gain: Gain of the observer, above 0 and at most 1; None is as behind FRI.
        """
        from dovetail import _core

        self.plant, self.cell, self.robot = plant, plant.cell, plant.robot
        gain = observer_gain(period) if gain is None else gain
        self._observer = _core.VelocityObserver(period, gain)
        self._q = np.zeros(7)
        self._a = np.zeros(7)
        self._time = 0.0

    def reset(self, q: Vec7, fixture: Pose) -> None:
        """Put the arm at rest at q [rad], the fixture at its pose; time becomes 0."""
        self.plant.reset(q, fixture)
        self._q, _ = self.plant.read()
        self._observer.reset(self._q)
        self._a = np.zeros(7)
        self._time = 0.0

    def read(self) -> tuple[Vec7, Vec7]:
        """Return the measured configuration [rad] and the observed velocity [rad/s]."""
        return self._q, self._observer.dq

    def apply(self, tau: Vec7, dt: float) -> None:
        """Hold the overlay torque tau [Nm] for dt [s].

        Raises:
            PlantError: The simulation diverged.
        """
        self.plant.apply(tau, dt)
        self._q, _ = self.plant.read()
        self._observer.update(self._q, self._a, dt)
        self._time += dt

    def run_cycles(
        self,
        controller: "_core.Controller",
        target: "_core.Target",
        cycles: int,
        period: float,
    ) -> tuple[Array, Vec7, Vec7]:
        """Run the controller against the plant; see `Plant.run_cycles`."""
        watched = _Watched(controller, self._observer)
        seen = _Seen(self, watched)
        return run_cycles(seen, watched, target, cycles, period, self._time)

    def apply_commanded(self, tau: Vec7, a: Vec7, dt: float) -> None:
        """Hold tau [Nm] for dt [s], the observer knowing which acceleration it is for.

        Args:
            tau: Overlay torque [Nm].
            a: What the controller meant by it [rad/s2].
            dt: Time [s].
        """
        self._a = a
        self.apply(tau, dt)

    # -- handed on to the plant inside -----------------------------------------

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

    def move_fixture(self, fixture: Pose) -> None:
        """Put the fixture at a pose at once, the arm's motion untouched."""
        self.plant.move_fixture(fixture)

    def grasp(self, offset: Pose) -> None:
        """Displace the held part in the fingers, from the next reset on."""
        self.plant.grasp(offset)

    def push(self, force: Vec3) -> None:
        """Push the TCP with a force [N], world axes, until the next push or `reset`."""
        self.plant.push(force)

    def contact_force(self) -> Vec3:
        """Return the force on the tool in the last physics step [N], world."""
        return self.plant.contact_force()

    def part_positions(self) -> Array:
        """Return the true positions of the parts' joints [rad, m]."""
        return self.plant.part_positions()

    def contact_force_peak(self) -> Vec3:
        """Return the largest such force during the last `apply` [N], world."""
        return self.plant.contact_force_peak()

    def tool_pose(self) -> Pose:
        """Return the true pose of the TCP in the world."""
        return self.plant.tool_pose()

    def close(self) -> None:
        """Release the plant inside; harmless when repeated."""
        self.plant.close()


class _Seen:
    """The plant as the cycle loop needs it, joined with the controller it runs."""

    def __init__(self, plant: EncoderPlant, controller: _Watched) -> None:
        self._plant = plant
        self._controller = controller
        self.robot = plant.robot
        self.read = plant.read
        self.contact_force_peak = plant.contact_force_peak

    def apply(self, tau: Vec7, dt: float) -> None:
        self._plant.apply_commanded(tau, self._controller.a, dt)
