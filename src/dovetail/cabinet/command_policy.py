"""Effect of a client's command, or of its absence, on the running motion."""

from collections.abc import Sequence
from typing import Protocol

from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.protocol import CommandMode
from dovetail.robots.robot import Robot
from dovetail.types import JOINTS

_TORQUE_SLACK = 1e-6
"""Torque over the limit that is rounding [Nm]."""


class CommandFields(Protocol):
    """Fields of a client's command that the policy reads; None where absent."""

    q: Sequence[float] | None
    tau: Sequence[float] | None
    wrench: Sequence[float] | None


class CommandPolicy:
    """Checks commands of one motion and keeps the one that acts.

    The lists in `q`, `tau` and `wrench` are what acts on the arm now.
    """

    def __init__(self, config: CabinetConfig, robot: Robot) -> None:
        """Take limits from the settings and the arm.

        Args:
            config: Tolerances and the number of missed commands.
            robot: The arm whose limits stop the motion.
        """
        self._config, limits = config, robot.limits
        self._q_min = limits.q_min.tolist()
        self._q_max = limits.q_max.tolist()
        self._dq_max = (config.speed_factor * limits.dq_max).tolist()
        self._tau_max = (limits.tau_max + _TORQUE_SLACK).tolist()
        factor, slot = config.command_speed_factor, config.slot
        self._step_max = (factor * limits.dq_max * slot).tolist()
        self.mode = CommandMode[config.mode.upper()]
        self.begin([0.0] * 7)

    def begin(self, q_ipo: list[float]) -> None:
        """Start a motion that holds q_ipo [rad]."""
        self.q_ipo = q_ipo
        self.q = list(q_ipo)
        self._drop()
        self.mirrored = 0
        """Commands in a row that mirrored the interpolator."""
        self.missed = 0
        """Commands missed in a row while active."""
        self.waits_for = "the client's first command"
        """Condition that COMMANDING_WAIT waits for; empty when synchronised."""

    def _drop(self) -> None:
        self.tau = [0.0] * 7
        self.wrench = [0.0] * 6

    def _missing(self, command: CommandFields) -> str:
        if command.q is None:
            return "command without joint position"
        if self.mode is CommandMode.TORQUE and command.tau is None:
            return "command without joint torque, which torque mode needs every time"
        if self.mode is CommandMode.WRENCH and command.wrench is None:
            return "command without wrench, which wrench mode needs every time"
        return ""

    def mirror(self, command: CommandFields | None) -> None:
        """Judge a command in COMMANDING_WAIT; its torque's content does not matter."""
        reason = "no command in time" if command is None else self._missing(command)
        if command is not None and command.q is not None and not reason:
            for joint, q, q_ipo in zip(JOINTS, command.q, self.q_ipo, strict=True):
                if not abs(q - q_ipo) <= self._config.mirror_tolerance:
                    reason = (
                        f"{joint} commanded {q - q_ipo:+.4f} rad from the interpolator,"
                        f" tolerance is {self._config.mirror_tolerance:g} rad"
                    )
                    break
        self.mirrored = 0 if reason else self.mirrored + 1
        if not reason and command is not None and command.q is not None:
            self.q = list(command.q)
        left = self._config.sync_slots - self.mirrored
        if not reason and left > 0:
            reason = f"{left} more mirrored commands"
        self.waits_for = reason

    @property
    def is_synchronised(self) -> bool:
        """True once the client has mirrored the interpolator for long enough."""
        return self.mirrored >= self._config.sync_slots

    def act(
        self,
        command: CommandFields | None,
        q: Sequence[float],
        gravity: Sequence[float],
    ) -> str:
        """Judge a command, or its absence, in COMMANDING_ACTIVE.

        Args:
            command: The command of this receive slot; None where none came in time.
            q: Measured configuration [rad].
            gravity: Torque that the cabinet adds [Nm].

        Returns:
            Why the motion must stop; empty where it goes on.
        """
        if command is None:
            return self._miss()
        reason = self._missing(command)
        q_cmd = command.q
        if reason or q_cmd is None:
            return reason
        tau, wrench = [0.0] * 7, [0.0] * 6
        if self.mode is CommandMode.TORQUE and command.tau is not None:
            tau = list(command.tau)
        if self.mode is CommandMode.WRENCH and command.wrench is not None:
            wrench = list(command.wrench)
        reason = self._illegal(q_cmd, q) or self._too_strong(tau, gravity)
        self.missed = 0
        if not reason:
            self.q, self.tau, self.wrench = list(q_cmd), tau, wrench
        return reason

    def _illegal(self, q_cmd: Sequence[float], q: Sequence[float]) -> str:
        """Return what is wrong with a commanded position [rad], or ""."""
        delta_max = self._config.axis_delta_max
        steps = 1 + self.missed
        for i in range(7):
            # Negated so that nan stops the motion, too.
            if not abs(q_cmd[i] - q[i]) <= delta_max:
                return (
                    f"illegal axis delta: {JOINTS[i]} commanded {q_cmd[i]:.4f} rad, "
                    f"measured {q[i]:.4f} rad, allowed is {delta_max:.4f} rad apart"
                )
            step, step_max = q_cmd[i] - self.q[i], steps * self._step_max[i]
            if not abs(step) <= step_max:
                return (
                    f"commanded speed: {JOINTS[i]} commanded {step:+.4f} rad in one "
                    f"step, allowed is {step_max:.4f} rad"
                )
        return ""

    def _too_strong(self, tau: Sequence[float], gravity: Sequence[float]) -> str:
        for i in range(7):
            if not abs(tau[i] + gravity[i]) <= self._tau_max[i]:
                return (
                    f"torque limit: {JOINTS[i]} commanded {tau[i]:.2f} Nm over "
                    f"{gravity[i]:.2f} Nm of gravity, limit is {self._tau_max[i]:.0f} "
                    "Nm"
                )
        return ""

    def _miss(self) -> str:
        self.missed += 1
        if self.missed >= self._config.stop_misses:
            return f"{self.missed} commands missed in a row"
        if self.missed > self._config.held_misses:
            self._drop()
        return ""

    @property
    def is_silent(self) -> bool:
        """True while the drives stop the arm on its path, for want of commands.

        In position mode the last position stops it already.
        """
        is_late = self.missed > self._config.held_misses
        return is_late and self.mode is not CommandMode.POSITION

    def check_joints(self, q: Sequence[float], dq: Sequence[float]) -> str:
        """Return why the measured state [rad, rad/s] must stop the motion, or ""."""
        for i in range(7):
            if not self._q_min[i] <= q[i] <= self._q_max[i]:
                return (
                    f"joint limit: {JOINTS[i]} at {q[i]:.4f} rad, allowed is "
                    f"{self._q_min[i]:.4f} to {self._q_max[i]:.4f} rad"
                )
            if not abs(dq[i]) <= self._dq_max[i]:
                return (
                    f"joint speed: {JOINTS[i]} at {dq[i]:.3f} rad/s, allowed is "
                    f"{self._dq_max[i]:.3f} rad/s"
                )
        return ""
