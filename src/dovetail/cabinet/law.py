r"""Torques of the arm: impedance, position servo, and what the sensors would say.

.. math::
    \tau = K (q_{cmd} - q) - D \dot q + \tau_{FRI} + g(q) + C(q, \dot q) \dot q

with :math:`D_i = 2 d_i \sqrt{K_i M_{ii}(q)}`. Gravity is the plant's part; the Coriolis
term acts only together with the impedance, so that without one the client's torque
alone reaches the arm.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from dovetail.types import Vec3, Vec7

if TYPE_CHECKING:
    from dovetail.plants.plant import DynamicsConfig
    from dovetail.robots.robot import Robot

_SERVO_RATE = 100.0
"""Natural frequency of the position servo [rad/s]; critically damped."""
_ZERO = np.zeros(7)


class JointLaw:
    """The cabinet's own model of the arm, and the torques made with it."""

    def __init__(
        self,
        robot: "Robot",
        dynamics: "DynamicsConfig",
        stiffness: tuple[float, ...],
        damping: tuple[float, ...],
        *,
        coriolis: bool,
    ) -> None:
        """Take the nominal arm as the model.

        Args:
            robot: The nominal arm, tool included.
            dynamics: Rotor inertia and friction that the drives know of themselves.
            stiffness: K [Nm/rad].
            damping: Ratio d of critical damping [1].
            coriolis: Compensate Coriolis torques where the impedance acts.
        """
        self.chain = robot.chain()
        self.armature = np.array(dynamics.armature)
        """Rotor inertia at each joint [kg m2]."""
        self.friction = np.array(dynamics.damping)
        """Viscous friction of each joint [Nms/rad]."""
        self._K = np.array(stiffness)
        self._d = np.array(damping)
        self._coriolis = coriolis
        self.tau_max = robot.limits.tau_max
        """Torque limit of each joint, and what its brake holds [Nm]."""
        self.has_impedance = bool(self._K.any())

    def impedance(self, q_cmd: Vec7, q: Vec7, dq: Vec7) -> Vec7:
        """Return what the impedance adds to the client's torque [Nm]."""
        inertia = self.chain.inertia_matrix(q).diagonal() + self.armature
        D = 2.0 * self._d * np.sqrt(self._K * inertia)
        tau = self._K * (q_cmd - q) - D * dq
        return tau + self.chain.coriolis(q, dq) if self._coriolis else tau

    def servo(
        self, q_cmd: Vec7, dq_cmd: Vec7, q: Vec7, dq: Vec7, ddq_cmd: Vec7 = _ZERO
    ) -> Vec7:
        """Return the torque [Nm] that follows a moving position.

        Args:
            q_cmd: Position to be at [rad].
            dq_cmd: Its velocity [rad/s].
            q: Configuration [rad].
            dq: Velocity [rad/s].
            ddq_cmd: Acceleration of the position [rad/s2].
        """
        M = self.chain.inertia_matrix(q) + np.diag(self.armature)
        rate = _SERVO_RATE
        ddq = ddq_cmd + rate * rate * (q_cmd - q) + 2.0 * rate * (dq_cmd - dq)
        tau = M @ ddq + self.chain.coriolis(q, dq) + self.friction * dq_cmd
        room = self.tau_max - np.abs(self.chain.gravity(q))
        return np.clip(tau, -room, room)

    def wrench(self, q: Vec7, wrench: list[float]) -> Vec7:
        """Return the joint torque [Nm] of a client's wrench at the TCP [N, Nm].

        Axes are the world's, and the moments about KUKA's A, B and C are about z, y
        and x; which frame a real cabinet means is set in its program.
        """
        fx, fy, fz, about_a, about_b, about_c = wrench
        return self.chain.jacobian(q).T @ np.array(
            [fx, fy, fz, about_c, about_b, about_a]
        )

    def gravity(self, q: Vec7) -> Vec7:
        """Return the compensated gravity torque at q [Nm]."""
        return self.chain.gravity(q)

    def push(self, q: Vec7, force: Vec3) -> Vec7:
        """Return the joint torque [Nm] of a force on the TCP [N], world axes."""
        return self.chain.jacobian(q)[:3].T @ force


class TorqueSensors:
    """Simulated torque sensors, and the external torque estimated from them.

    They sit behind gear and rotor, so neither friction nor rotor inertia is in their
    reading. The external torque is what the model cannot explain, filtered.
    """

    def __init__(self, law: JointLaw, period: float, filter_time: float) -> None:
        """Start at rest.

        Args:
            law: The model.
            period: Time between readings [s].
            filter_time: Time constant of the external torque [s].
        """
        self._law = law
        self._period = period
        self._alpha = 1.0 - math.exp(-period / filter_time) if filter_time else 1.0
        self.joint = np.zeros(7)
        """Torque of the drive on the link [Nm]."""
        self.external = np.zeros(7)
        """Torque of the environment on the joint [Nm]."""

    def rest(self, gravity: Vec7, push: Vec7 | None) -> None:
        """Read behind closed brakes: gravity and what pushes."""
        self.external = np.zeros(7) if push is None else push
        self.joint = gravity - self.external

    def move(self, tau: Vec7, gravity: Vec7, q: Vec7, dq: Vec7, ddq: Vec7) -> None:
        """Read after a period of motion.

        Args:
            tau: Torque that the drives have added to gravity [Nm].
            gravity: Compensated gravity torque [Nm].
            q: Configuration [rad].
            dq: Velocity [rad/s].
            ddq: Mean acceleration of the period [rad/s2].
        """
        law = self._law
        link = tau - law.friction * dq - law.armature * ddq
        self.joint = link + gravity
        model = law.chain.inertia_matrix(q) @ ddq + law.chain.coriolis(q, dq)
        self.external = self.external + self._alpha * (model - link - self.external)
