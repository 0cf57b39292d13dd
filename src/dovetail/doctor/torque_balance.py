r"""One joint's torque balance, fitted to a log of its motion.

.. math:: \tau(t - d) = \alpha M_i \ddot q + b \dot q + c\, \mathrm{sgn}\, \dot q
    + k (q_i - q_{i,0}) - k_s \Delta q_{i,s}(t - d) + g_e

Every term is averaged over 20 ms by the same window, which takes the encoders' noise
off and leaves the delay where it is. M is the model's inertia with rotors at the mean
configuration. The position that an FRI client sends follows the measured one, so that
a spring to it shows as friction, unless the client leans it by a known
:math:`\Delta q_s`, which arrives as late as the torque.
"""

from typing import NamedTuple

import numpy as np

from dovetail.arms.arm import Arm
from dovetail.doctor.held_torque import held_torque
from dovetail.plants.plant import COLUMN
from dovetail.types import Array, Vec7

WINDOW = 0.02
"""Length of the averaging window [s]: what is faster than about 50 Hz is left out."""
SPEED_WINDOW = 0.012
"""The same for the sign of the speed [s]."""
SLOW = 0.005
"""Speed at which dry friction is about full [rad/s]: stiction is softer than a sign."""


class JointFit(NamedTuple):
    """Properties of a joint by its torque balance; a spread is a standard deviation."""

    inertia: float
    """Inertia over the model's [1]."""
    damping: float
    """Viscous friction, and what the cabinet adds [Nms/rad]."""
    coulomb: float
    """Dry friction [Nm]."""
    stiffness: float
    """Spring to a fixed position [Nm/rad]; gravity's own is a few Nm/rad."""
    sent_spring: float
    """Spring to the position that the client sends, 0 without a lean [Nm/rad]."""
    offset: float
    """Torque that compensated gravity misses [Nm]."""
    spread: Array
    """Of each of these, in their order."""
    rms: float
    """Residual of the balance [Nm RMS]."""

    def spread_of(self, name: str) -> float:
        """Return one standard deviation of a field."""
        return float(self.spread[self._fields.index(name)])


_LEAN = JointFit._fields.index("sent_spring")


class TorqueBalance:
    """The balance of one joint over one log without gaps."""

    def __init__(
        self,
        q: Array,
        tau: Array,
        joint: int,
        inertia: Array,
        period: float,
        lean: Array | None = None,
    ) -> None:
        """Prepare the fit.

        Args:
            q: Measured configurations [rad], shape (n, 7).
            tau: Commanded torques [Nm], shape (n, 7).
            joint: Index of the joint.
            inertia: The model's inertia with rotors [kg m2], shape (7, 7).
            period: Control period [s].
            lean: Offset of the sent position, held as the torque is [rad], shape (n,).
        """
        self._period = period
        self._tau = tau[:, joint]
        self._lean = lean
        self._width = _odd(WINDOW / period)
        own = q[:, joint]
        width = _odd(SPEED_WINDOW / period)
        smooth = _average(np.pad(own, width // 2, "edge"), width)
        speed = (smooth[2:] - smooth[:-2]) / (2.0 * period)
        acceleration = (q[2:] - 2.0 * q[1:-1] + q[:-2]) / period**2
        terms = (
            acceleration @ inertia[joint],
            speed,
            np.tanh(speed / SLOW),
            own[1:-1] - own.mean(),
            np.zeros_like(speed),  # of the lean, see `solve`
            np.ones_like(speed),
        )
        self._terms = np.stack([self._filter(term) for term in terms], axis=1)
        self.independent = max(len(speed) / self._width, 1.0)
        """Number of independent samples that the log is worth."""

    def left_over(self, delays: Array) -> Array:
        """Return the mean square that each delay [s] leaves [Nm2]."""
        skip = self._skip(float(np.max(delays)))
        Q, _ = np.linalg.qr(_scaled(self._terms[skip:])[0])
        left = np.empty(len(delays))
        for i, delay in enumerate(delays):
            y = self._delayed(self._tau, float(delay))[skip:]
            left[i] = (y @ y - np.sum((Q.T @ y) ** 2)) / len(y)
        return np.maximum(left, 1e-12)

    def solve(self, delay: float) -> JointFit:
        """Return the terms' factors with a delay [s] known."""
        skip = self._skip(delay)
        terms = self._terms.copy()
        if self._lean is not None:
            terms[:, _LEAN] = -self._delayed(self._lean, delay)
        X, scale = _scaled(terms[skip:])
        y = self._delayed(self._tau, delay)[skip:]
        factors = np.linalg.lstsq(X, y, rcond=None)[0]
        left = y - X @ factors
        # Averaged noise repeats itself over the window's length.
        independent = max(len(y) / self._width - X.shape[1], 1.0)
        square = float(left @ left) / len(y)
        covariance = np.linalg.pinv(X.T @ X / len(y)) * square / independent
        spread = np.sqrt(np.diag(covariance)) / scale
        inertia, damping, coulomb, stiffness, sent_spring, offset = (
            float(value) for value in factors / scale
        )
        return JointFit(
            inertia,
            damping,
            coulomb,
            stiffness,
            sent_spring,
            offset,
            spread,
            float(np.sqrt(square)),
        )

    def _skip(self, delay: float) -> int:
        """Return how many rows depend on torques of before the log."""
        return int(np.ceil(max(delay, 0.0) / self._period)) + 1

    def _delayed(self, sent: Array, delay: float) -> Array:
        return self._filter(held_torque(sent, self._period, delay))

    def _filter(self, values: Array) -> Array:
        return _average(values, self._width)


def _scaled(terms: Array) -> tuple[Array, Array]:
    """Return the terms, each of unit size, and their sizes."""
    scale = np.maximum(np.sqrt(np.mean(terms**2, axis=0)), 1e-9)
    return terms / scale, scale


def inertia_with_rotors(arm: Arm, q: Vec7) -> Array:
    """Return the model's inertia at q with the assumed rotors [kg m2], shape (7, 7)."""
    rotors = np.diag(arm.facts.limits.armature)
    return np.asarray(arm.facts.robot.chain().inertia_matrix(q)) + rotors


def balance_of(
    log: Array,
    joint: int,
    inertia: Array,
    period: float,
    lean: Array | None = None,
) -> TorqueBalance:
    """Return the torque balance of a cycle log without gaps."""
    q = log[:, COLUMN["q1"] : COLUMN["q7"] + 1]
    tau = log[:, COLUMN["tau1"] : COLUMN["tau7"] + 1]
    return TorqueBalance(q, tau, joint, inertia, period, lean)


def _odd(length: float) -> int:
    return max(3, 2 * round((length - 1.0) / 2.0) + 1)


def _average(values: Array, width: int) -> Array:
    window = np.hanning(width + 2)[1:-1]
    return np.asarray(np.convolve(values, window / window.sum(), "valid"), dtype=float)
