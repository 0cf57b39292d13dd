"""The delay of the loop, from the torque balances of all joints: it is one for all."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dovetail.control.proven import DECLARED, unproven
from dovetail.doctor.check import Check
from dovetail.doctor.torque_balance import TorqueBalance

EARLIEST, LATEST = -0.003, 0.04
"""Range of delays that are tried [s]; below zero the noise's share can be seen."""
TOLERANCE = 5e-4
"""Accuracy of a measured delay [s]."""
_GRID = 2.5e-4


class LoopDelay(NamedTuple):
    """Time from a torque command to the motion that it causes."""

    delay: float
    """Delay [s]."""
    spread: float
    """Its standard deviation [s], where the balance leaves nothing but noise."""
    is_bracketed: bool
    """It is inside the range that was tried."""


def estimate_delay(
    balances: Sequence[TorqueBalance], integration_step: float = 0.0
) -> LoopDelay:
    """Find the delay with which the balances leave least.

    Every joint counts by what a wrong delay costs it, over what its best one leaves: a
    joint that friction holds says nothing.

    Args:
        balances: One of each joint that was moved.
        integration_step: Step of the simulation behind the arm [s], 0 for a real one.
            Semi-implicit steps move a body half a step too early.
    """
    delays = np.arange(EARLIEST, LATEST + 0.5 * _GRID, _GRID)
    total = np.zeros(len(delays))
    for balance in balances:
        left = balance.left_over(delays)
        total += balance.independent * left / left.min()
    best = int(np.argmin(total))
    is_bracketed = 0 < best < len(delays) - 1
    delay, spread = float(delays[best]), _GRID
    if is_bracketed:
        before, here, after = total[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        delay += 0.5 * _GRID * (before - after) / bend
        spread = _GRID * float(np.sqrt(2.0 / bend))
    return LoopDelay(delay + 0.5 * integration_step, spread, is_bracketed)


def check_delay(delay: LoopDelay, turned: float, declared: float) -> Check:
    """Compare the measured delay with a declared one.

    Args:
        delay: The measured delay.
        turned: Largest turn of a joint that it was measured by [rad].
        declared: Largest declared delay [s].
    """
    name = "delay"
    text = (
        f"{1e3 * delay.delay:.1f} ms from torque to motion (+-"
        f"{max(1e3 * delay.spread, 0.1):.1f} ms; joints turned by "
        f"{turned:.3f} rad)"
    )
    if not delay.is_bracketed:
        return Check(
            name,
            "broken",
            f"{text}: outside what can be measured; something else than a delay is "
            "wrong: friction, brakes, or torques that do not arrive",
        )
    if delay.delay <= declared + TOLERANCE:
        return Check(name, "ok", f"{text}; declared: {1e3 * declared:g} ms")
    (problem,) = unproven(delay=delay.delay, declared=DECLARED | {"delay": declared})
    if delay.delay <= DECLARED["delay"]:
        problem += (
            f", or declare at least {1e3 * delay.delay:.1f} ms (allowed: 0 to "
            f"{1e3 * DECLARED['delay']:g} ms)"
        )
    return Check(name, "broken", f"{text}: {problem}")
