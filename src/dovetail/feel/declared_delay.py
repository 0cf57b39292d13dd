"""The delay that was measured beside the one that was declared."""

from typing import NamedTuple

from dovetail.control.proven import DECLARED, unproven
from dovetail.feel.feeling import Feeling

TOLERANCE = 5e-4
"""Accuracy of a measured delay [s]."""


class JudgedDelay(NamedTuple):
    """Comparison of a measured delay with the declared one."""

    is_within: bool
    """It was measured, and is no longer than declared."""
    text: str
    """Both values, and what to do where it is longer."""


def judge_delay(feeling: Feeling, declared: float) -> JudgedDelay:
    """Compare the measured delay with a declared one [s]."""
    delay = feeling.delay
    text = (
        f"{1e3 * delay.delay:.1f} ms from torque to motion (+-"
        f"{max(1e3 * delay.spread, 0.1):.1f} ms; joints turned by "
        f"{feeling.turned:.3f} rad)"
    )
    if not delay.is_bracketed:
        return JudgedDelay(
            False,
            f"{text}: outside what can be measured; something else than a delay is "
            "wrong: friction, brakes, or torques that do not arrive",
        )
    if delay.delay <= declared + TOLERANCE:
        return JudgedDelay(True, f"{text}; declared: {1e3 * declared:g} ms")
    (problem,) = unproven(delay=delay.delay, declared=DECLARED | {"delay": declared})
    if delay.delay <= DECLARED["delay"]:
        problem += (
            f", or declare at least {1e3 * delay.delay:.1f} ms (allowed: 0 to "
            f"{1e3 * DECLARED['delay']:g} ms)"
        )
    return JudgedDelay(False, f"{text}: {problem}")
