"""The arm behind the cabinet: a plant, its drives and its brakes."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.late_path import LatePath
from dovetail.cabinet.law import JointLaw, TorqueSensors
from dovetail.cabinet.stops import Ramp, StopCategory
from dovetail.errors import ConfigError, PlantError
from dovetail.poses import Pose
from dovetail.types import Vec3, Vec7

if TYPE_CHECKING:
    from dovetail.plants.plant import DrivenPlant

_LAW_PERIOD = 0.001
"""Period of the drives' own laws [s], as on a real cabinet; FRI's may be longer."""
_REST_SPEED = 0.05
"""Measured speed, noise included, at which braked joints rest [rad/s]."""
_REST_TIMES = 0.02, 0.1
"""Shortest and longest time that the brakes take to bring the arm to rest [s]."""


class ArmBody:
    """A plant that a motion drives, drives or brakes stop, and the brakes hold.

    At rest behind closed brakes the plant is not stepped: the arm stays exactly where
    it is, even with a gravity error, and no time passes in contact.
    """

    def __init__(self, plant: "DrivenPlant", config: CabinetConfig) -> None:
        """Take the plant, which must have been reset.

        Args:
            plant: The arm and its scene.
            config: Law, period and filter.
        """
        self.plant = plant
        self.period = config.period
        self._steps = max(1, round(self.period / _LAW_PERIOD))
        self._step = self.period / self._steps
        self.law = JointLaw(
            plant.robot,
            plant.dynamics,
            config.stiffness,
            config.damping,
            coriolis=config.coriolis,
        )
        filter_time = config.external_filter
        self.sensors = TorqueSensors(self.law, self.period, filter_time)
        self._mode = config.mode
        self._is_torque = self._mode == "torque"
        self._path = LatePath(self.period, plant.command_delay)
        self.failure = ""
        """Reason why the plant cannot go on; empty while it can. `place` clears it."""
        self._push_force = np.zeros(3)
        self._push_left = 0.0
        self._fixture: Pose | None = None
        self._grasp: Pose | None = None  # for the next `place`
        self._fixture_velocity = np.zeros(3)
        self._settle()

    def _settle(self) -> None:
        """Begin at rest behind closed brakes, where the plant is."""
        self.q, self.dq = self.plant.read()
        self.gravity = self.law.gravity(self.q)
        self.time = 0.0
        """Simulated time since the arm was placed [s]."""
        self.is_braked = True
        """The arm rests behind closed brakes."""
        self.category: StopCategory | None = None
        """Category of the running stop; None while nothing stops the arm."""
        self._ramp: Ramp | None = None
        self._braking: float | None = None  # since the brakes closed [s]
        self._path.clear()
        self._peak = (0.0, 0.0, 0.0)
        self._peak_square = 0.0
        self.tau = np.zeros(7)
        """Torque that the drives add to gravity [Nm]."""
        self.overlay = np.zeros(7)
        """The client's part of it [Nm]."""
        self.sensors.rest(self.gravity, None)

    def place(self, q: Vec7, fixture: Pose) -> None:
        """Put the arm at rest at q [rad] and the fixture at its pose.

        Raises:
            ConfigError: The fixture is out of reach, or q is not seven finite numbers.
        """
        if self._grasp is not None:
            self.plant.grasp(self._grasp)
            self._grasp = None
        self.plant.reset(q, fixture)
        self.failure = ""
        self._push_left = 0.0
        self._fixture_velocity = np.zeros(3)
        self._settle()

    def move_fixture(self, fixture: Pose, velocity: Vec3 | None = None) -> None:
        """Move the fixture to a pose; the arm and its motion stay.

        Args:
            fixture: Where it is now.
            velocity: How it moves on while the arm is not held [m/s], world axes.

        Raises:
            ConfigError: The fixture is out of reach.
        """
        self.plant.move_fixture(fixture)
        self._fixture = fixture
        self._fixture_velocity = np.zeros(3) if velocity is None else velocity

    def grasp(self, offset: Pose) -> None:
        """Displace the held part in the fingers, from the next `place` on.

        Args:
            offset: The part's frame in the TCP's.
        """
        self._grasp = offset

    def push(self, force: Vec3, duration: float) -> None:
        """Push the TCP with a force [N], world axes, for a duration [s]."""
        self._push_force, self._push_left = np.array(force, dtype=float), duration

    def release(self) -> None:
        """Open the brakes; the arm is at rest."""
        self.is_braked = False
        self.category = self._ramp = self._braking = None
        self._path.clear()
        self.plant.open_brakes()

    def stop(self, category: StopCategory = StopCategory.RAMP) -> None:
        """Begin to stop, if the arm is not held; a stop at once overtakes a ramp."""
        if self.is_braked or self._braking is not None:
            return
        if category is StopCategory.BRAKES:
            self._close_brakes()
        elif self.category is not None:
            return
        self.category = category

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
        self._ramp = None
        overlay, target = np.array(tau), np.array(q_cmd)
        if self._is_torque and not self.law.has_impedance:
            self._apply(overlay, None, self.period)
            self._observe(overlay, overlay, *self.plant.read())
            return
        self._path.add(target)
        if self._mode == "position":
            self._pass_period(overlay, self._servo)
        elif self._mode == "wrench" and wrench is not None:
            overlay = overlay + self.law.wrench(self.q, wrench)
            self._pass_period(overlay, self._impedance)
        else:
            self._pass_period(overlay, self._impedance)

    def slow_down(self) -> None:
        """Stop the arm on its path for one period; `drive` may go on from there."""
        if self.failure:
            return
        if self._ramp is None:
            self.plant.drop_commands()
            self._ramp = Ramp(self.q, self.dq)
        self._pass_period(np.zeros(7), self._follow_ramp)

    def hold(self) -> None:
        """Pass one period outside a motion: stop, or stay behind closed brakes."""
        if self.is_braked or self.failure:
            self.sensors.rest(self.gravity, self._push_torque(self.period))
            return
        if self._braking is None:
            if self._ramp is None or not self._ramp.is_over:
                self.slow_down()
            else:
                self._close_brakes()
        if self._braking is not None:
            self._pass_period(np.zeros(7), lambda time, q, dq: np.zeros(7))
            self._braking += self.period
            self._end_braking(self._braking)

    def come_to_rest(self) -> None:
        """Stop the arm now, however long that takes it."""
        while not (self.is_braked or self.failure):
            self.hold()

    def _close_brakes(self) -> None:
        self._braking = 0.0
        self.plant.drop_commands()
        self.plant.close_brakes(self.law.tau_max)

    def _end_braking(self, time: float) -> None:
        """Hold the arm where it is, once it rests."""
        soonest, latest = _REST_TIMES
        is_slow = np.abs(self.dq).max() < _REST_SPEED and time > soonest - 1e-9
        if is_slow or time > latest - 1e-9:
            self.is_braked = True
            self.dq, self.tau = np.zeros(7), np.zeros(7)

    # -- laws of the drives: torque [Nm] at the end of a step in the period ----------

    def _servo(self, time: float, q: Vec7, dq: Vec7) -> Vec7:
        return self.law.servo(*self._path.passed(time), q, dq)

    def _impedance(self, time: float, q: Vec7, dq: Vec7) -> Vec7:
        return self.law.impedance(self._path.held(time), q, dq)

    def _follow_ramp(self, time: float, q: Vec7, dq: Vec7) -> Vec7:
        assert self._ramp is not None
        q_cmd, dq_cmd, ddq_cmd = self._ramp.advance(self._step)
        return self.law.servo(q_cmd, dq_cmd, q, dq, ddq_cmd)

    def _pass_period(
        self, overlay: Vec7, law: Callable[[float, Vec7, Vec7], Vec7]
    ) -> None:
        """Let a law of the drives act for a period, in steps of its own."""
        q, dq, drive = self.q, self.dq, np.zeros(7)
        for i in range(self._steps):
            drive = law((i + 1) * self._step, q, dq)
            self._apply(overlay, drive, self._step)
            if self.failure:
                return
            q, dq = self.plant.read()
        self._observe(overlay + drive, overlay, q, dq)

    def _apply(self, overlay: Vec7, drive: Vec7 | None, duration: float) -> None:
        push = self._push_torque(duration)
        self._slide_fixture(duration)
        if push is not None:
            drive = push if drive is None else drive + push
        try:
            self.plant.apply(overlay, duration, drive)
        except PlantError as error:
            self.failure = f"{error}; place the arm again"
            return
        x, y, z = self.plant.contact_force_peak().tolist()
        square = x * x + y * y + z * z
        if square > self._peak_square:
            self._peak, self._peak_square = (x, y, z), square

    def _slide_fixture(self, duration: float) -> None:
        if self._fixture is None or not self._fixture_velocity.any():
            return
        position = self._fixture.position + duration * self._fixture_velocity
        try:
            self.plant.move_fixture(self._fixture._replace(position=position))
        except ConfigError:  # the end of the table, or of the reach
            self._fixture_velocity = np.zeros(3)
            return
        self._fixture = self._fixture._replace(position=position)

    def _observe(self, tau: Vec7, overlay: Vec7, q: Vec7, dq: Vec7) -> None:
        self.time += self.period
        self.gravity = self.law.gravity(q)
        ddq = (dq - self.dq) / self.period
        self.sensors.move(tau, self.gravity, q, dq, ddq)
        self.q, self.dq, self.tau, self.overlay = q, dq, tau, overlay

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
