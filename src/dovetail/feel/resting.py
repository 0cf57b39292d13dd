"""Noise or oscillation of an arm's torque while it is held."""

from typing import NamedTuple

import numpy as np

from dovetail.plants.plant import COLUMN
from dovetail.types import Array, Vec7

TORQUE_RMS = 2.0
"""Noise of a joint's torque that is allowed at rest [Nm RMS]."""
LINE_SHARE = 0.4
"""Share of a torque's variance in one line of its spectrum that is an oscillation."""
LINE_RMS = 1.0
"""Torque below which no oscillation is looked for [Nm RMS]."""
GROWTH = 2.0
"""Growth from the first to the last third that is one at any spectrum [1]."""
SLOWEST = 2.0
"""Slower changes of torque are drift [Hz]."""


class Resting(NamedTuple):
    """Torque and motion of a held arm, without their drift."""

    torque: Vec7
    """Noise of the commanded torque [Nm RMS]."""
    motion: Vec7
    """Noise of the measured position [rad RMS]."""
    joint: int
    """The joint whose torque is loudest."""
    frequency: float
    """Frequency at which its torque's spectrum is highest [Hz]."""
    share: float
    """Share of its variance in that line and its two neighbours [1]."""
    growth: float
    """Its torque in the last third of the log over the first third [1]."""

    @property
    def is_oscillating(self) -> bool:
        """True if this is more than noise."""
        if self.torque[self.joint] < LINE_RMS:
            return False
        return self.share > LINE_SHARE or self.growth > GROWTH


def measure_rest(log: Array, period: float) -> Resting:
    """Measure a log of an arm that was held.

    Args:
        log: Cycle log, at least 30 rows; what was before is settled.
        period: Control period [s].
    """
    q = _without_drift(log[:, COLUMN["q1"] : COLUMN["q7"] + 1])
    tau = _without_drift(log[:, COLUMN["tau1"] : COLUMN["tau7"] + 1])
    torque, motion = _rms(tau), _rms(q)
    joint = int(np.argmax(torque))
    loudest = tau[:, joint]
    power = np.abs(np.fft.rfft(loudest * np.hanning(len(loudest)))) ** 2
    frequencies = np.fft.rfftfreq(len(loudest), period)
    power[frequencies < SLOWEST] = 0.0
    peak = int(np.argmax(power))
    line = power[max(peak - 1, 0) : peak + 2].sum()
    third = len(loudest) // 3
    growth = _rms(loudest[-third:]) / max(float(_rms(loudest[:third])), 1e-9)
    return Resting(
        torque,
        motion,
        joint,
        float(frequencies[peak]),
        float(line / max(power.sum(), 1e-12)),
        float(growth),
    )


def _without_drift(values: Array) -> Array:
    """Take the straight line off each column."""
    rows = np.arange(len(values))
    line = np.polynomial.polynomial.polyfit(rows, values, 1)
    return values - (line[0] + np.outer(rows, line[1]))


def _rms(values: Array) -> Array:
    return np.sqrt(np.mean(values**2, axis=0))
