"""The arm behind the cabinet: a plant, its drives and its brakes."""

from typing import TYPE_CHECKING

import numpy as np

from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.law import JointLaw, TorqueSensors
from dovetail.errors import ConfigError, PlantError
from dovetail.poses import Pose
from dovetail.types import Vec3, Vec7

if TYPE_CHECKING:
    from dovetail.plants.plant import Plant

_LAW_PERIOD = 0.001
"""Period of the impedance law [s], as on a real cabinet; FRI's may be longer."""
_REST_SPEED = 0.005
"""Speed below which the brakes close [rad/s]."""
_BRAKE_TIME = 1.0
"""Time after which the brakes close at any speed [s]."""


class Body:
    """A plant that a motion drives, the brakes stop, and then hold.

    Behind closed brakes the plant is not stepped: the arm stays exactly where it is,
    and time in contact does not pass.
    """

    def __init__(self, plant: "Plant", config: CabinetConfig) -> None:
        """Take the plant, which must have been reset.

        Args:
            plant: The arm and its scene.
            config: Law, period and filter.
        """
        self.plant = plant
        self.period = config.period
        self.law = JointLaw(
            plant.robot,
            plant.dynamics,
            config.stiffness,
            config.damping,
            coriolis=config.coriolis,
        )
        self.sensors = TorqueSensors(self.law, config.period, config.external_filter)
        self._mode = config.mode
        self._is_torque = config.mode == "torque"
        self.failure = ""
        """Why the plant cannot go on; empty while it can. `place` mends it."""
        self._push_force = np.zeros(3)
        self._push_left = 0.0
        self._hole: Pose | None = None
        self._hole_velocity = np.zeros(3)
        self._settle()

    def _settle(self) -> None:
        """Begin at rest behind closed brakes, where the plant is."""
        self.q, self.dq = self.plant.read()
        self.gravity = self.law.gravity(self.q)
        self.time = 0.0
        """Simulated time since the arm was placed [s]."""
        self.is_braked = True
        """The brakes are closed: the arm does not move."""
        self._braking = 0.0
        self._q_cmd: Vec7 | None = None  # last position in a motion
        self._peak = (0.0, 0.0, 0.0)
        self._peak_square = 0.0
        self.tau = np.zeros(7)
        """Torque that the drives add to gravity [Nm]."""
        self.sensors.rest(self.gravity, None)

    def place(self, q: Vec7, hole: Pose) -> None:
        """Put the arm at rest at q [rad] and the hole at its pose.

        Raises:
            ConfigError: The hole is out of reach, or q is not seven finite numbers.
        """
        self.plant.reset(q, hole)
        self.failure = ""
        self._push_left = 0.0
        self._hole_velocity = np.zeros(3)
        self._settle()

    def move_hole(self, hole: Pose, velocity: Vec3 | None = None) -> None:
        """Move the hole to a pose; the arm and its motion stay.

        Args:
            hole: Where it is now.
            velocity: How it moves on while the arm is not held [m/s], world axes.

        Raises:
            ConfigError: The hole is out of reach.
        """
        self.plant.move_hole(hole)
        self._hole = hole
        self._hole_velocity = np.zeros(3) if velocity is None else velocity

    def push(self, force: Vec3, duration: float) -> None:
        """Push the TCP with a force [N], world axes, for a duration [s]."""
        self._push_force, self._push_left = np.array(force, dtype=float), duration

    def release(self) -> None:
        """Open the brakes."""
        self.is_braked = False
        self._q_cmd = None

    def stop(self) -> None:
        """Begin to brake, if the arm is not held."""
        self._braking = 0.0

    def drive(
        self, q_cmd: list[float], tau: list[float], wrench: list[float] | None = None
    ) -> None:
        """Let a command act for one period.

        Args:
            q_cmd: Position [rad].
            tau: Torque overlay [Nm].
            wrench: Wrench overlay at the TCP [N, Nm], in wrench mode.
        """
        if self.failure:
            return
        overlay, target = np.array(tau), np.array(q_cmd)
        if self._is_torque and not self.law.has_impedance:
            self._step(overlay, self.period)
            return
        # The cabinet's own law is faster than FRI may be.
        steps = max(1, round(self.period / _LAW_PERIOD))
        h = self.period / steps
        start = target if self._q_cmd is None else self._q_cmd
        dq_cmd = (target - start) / self.period
        q, dq, tau_now = self.q, self.dq, overlay
        for i in range(steps):
            if self._mode == "position":
                point = start + (i + 1) * h * dq_cmd
                tau_now = self.law.servo(point, dq_cmd, q, dq)
            else:
                tau_now = overlay + self.law.impedance(target, q, dq)
                if self._mode == "wrench" and wrench is not None:
                    tau_now = tau_now + self.law.wrench(q, wrench)
            self._apply(tau_now, h)
            q, dq = self.plant.read()
        self._q_cmd = target
        self._observe(tau_now, q, dq)

    def hold(self) -> None:
        """Pass one period outside a motion: brake, or stay behind closed brakes."""
        if self.is_braked or self.failure:
            self.sensors.rest(self.gravity, self._push_torque(self.period))
            return
        self._step(self.law.brake(self.q, self.dq), self.period)
        self._braking += self.period
        if np.abs(self.dq).max() < _REST_SPEED or self._braking >= _BRAKE_TIME:
            self.is_braked = True
            self.tau = np.zeros(7)

    def _step(self, tau: Vec7, duration: float) -> None:
        self._apply(tau, duration)
        self._observe(tau, *self.plant.read())

    def _apply(self, tau: Vec7, duration: float) -> None:
        push = self._push_torque(duration)
        self._slide_hole(duration)
        try:
            self.plant.apply(tau if push is None else tau + push, duration)
        except PlantError as error:
            self.failure = f"{error}; place the arm again"
            return
        x, y, z = self.plant.contact_force_peak().tolist()
        square = x * x + y * y + z * z
        if square > self._peak_square:
            self._peak, self._peak_square = (x, y, z), square

    def _slide_hole(self, duration: float) -> None:
        if self._hole is None or not self._hole_velocity.any():
            return
        position = self._hole.position + duration * self._hole_velocity
        try:
            self.plant.move_hole(self._hole._replace(position=position))
        except ConfigError:  # the end of the table, or of the reach
            self._hole_velocity = np.zeros(3)
            return
        self._hole = self._hole._replace(position=position)

    def _observe(self, tau: Vec7, q: Vec7, dq: Vec7) -> None:
        self.time += self.period
        self.gravity = self.law.gravity(q)
        ddq = (dq - self.dq) / self.period
        self.sensors.move(tau, self.gravity, q, dq, ddq)
        self.q, self.dq, self.tau = q, dq, tau

    def _push_torque(self, duration: float) -> Vec7 | None:
        if self._push_left <= 1e-9:
            return None
        self._push_left -= duration
        return self.law.push(self.q, self._push_force)

    def take_contact_peak(self) -> tuple[float, float, float]:
        """Return the largest contact force since the last call [N], world axes."""
        peak = self._peak
        self._peak, self._peak_square = (0.0, 0.0, 0.0), 0.0
        return peak
