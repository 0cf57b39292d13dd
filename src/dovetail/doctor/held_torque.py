r"""A torque that is sent once a period, as second differences of a position see it.

With a rigid body behind it, and any delay d between command and drive,

.. math:: q_{n+1} - 2 q_n + q_{n-1} = \frac{1}{M} \left(I(t_n + T - d) - 2 I(t_n - d)
    + I(t_n - T - d)\right)

holds exactly, I being the torque integrated twice. So a delay need not be a whole
number of periods to be found.
"""

import numpy as np

from dovetail.types import Array


def held_torque(tau: Array, period: float, delay: float) -> Array:
    """Return the torque [Nm] that second differences of the position show.

    Args:
        tau: One joint's torque, sent at the beginning of every period and held [Nm],
            shape (n,).
        period: Control period [s].
        delay: Time from a command to its effect [s]; a negative one is allowed.

    Returns:
        Shape (n - 2,), at the cycles 1 to n - 2. Where it would need torques of before
        the log, the first one stands for them.
    """
    mean = float(tau.mean())
    steps = tau - mean  # what is integrated twice must not run away
    once = np.concatenate([[0.0], np.cumsum(steps)]) * period
    twice = np.concatenate(
        [[0.0], np.cumsum(once[:-1] * period + 0.5 * steps * period**2)]
    )

    def integral(times: Array) -> Array:
        index = np.clip(np.floor(times / period + 1e-9).astype(int), 0, len(tau) - 1)
        rest = times - index * period
        return twice[index] + once[index] * rest + 0.5 * steps[index] * rest**2

    times = period * np.arange(1.0, len(tau) - 1.0) - delay
    ahead, here, behind = (integral(times + k * period) for k in (1, 0, -1))
    return (ahead - 2.0 * here + behind) / period**2 + mean
