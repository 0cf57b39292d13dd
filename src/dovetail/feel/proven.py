"""What was declared of an arm, and where its limits were shown to hold."""

from dataclasses import dataclass

from dovetail.errors import ConfigError

PERIODS = (0.001, 0.002, 0.0025, 0.005)
"""Control periods [s] of the table in docs/safety.md."""
DELAY_MAX = 0.010
"""Longest delay of the loop in that table [s]."""
TOLERANCE = 5e-4
"""How exactly a delay is measured [s]."""


@dataclass(frozen=True, kw_only=True)
class Declared:
    """What the owner of an arm says of it."""

    delay: float = DELAY_MAX
    """Largest delay of the loop [s]."""
    payload_error: float = 0.5
    """Largest mass at the flange that the load data miss [kg]."""

    def __post_init__(self) -> None:
        """Refuse what the table does not have, by name."""
        if not 0.0 <= self.delay <= DELAY_MAX:
            raise ConfigError(
                f"declared delay is {1e3 * self.delay:g} ms; the limits were shown to "
                f"hold for 0 to {1e3 * DELAY_MAX:g} ms: make the loop quicker"
            )
        if not 0.0 <= self.payload_error <= 10.0:
            raise ConfigError(
                f"declared payload_error is {self.payload_error:g} kg; allowed: 0 to "
                "10 kg"
            )


def period_problem(period: float) -> str:
    """Return what is wrong with a control period [s], or nothing."""
    if any(abs(period - proven) < 1e-9 for proven in PERIODS):
        return ""
    known = ", ".join(f"{1e3 * p:g}" for p in PERIODS)
    return (
        f"the limits were not shown to hold at a control period of {1e3 * period:g} "
        f"ms; they were at {known} ms: choose one of these on both sides"
    )


def delay_problem(delay: float, declared: Declared) -> str:
    """Return what a measured delay [s] means for the declared one, or nothing."""
    if delay > DELAY_MAX + TOLERANCE:
        return (
            f"the limits were shown to hold up to {1e3 * DELAY_MAX:g} ms: find what is "
            "late (receive multiplier, a switch, processor load), and do not run tasks "
            "on this arm before"
        )
    if delay > declared.delay + TOLERANCE:
        return (
            f"declared are {1e3 * declared.delay:g} ms: declare at least "
            f"{1e3 * delay:.1f} ms (allowed: 0 to {1e3 * DELAY_MAX:g} ms)"
        )
    return ""


def payload_problem(mass: float, declared: Declared) -> str:
    """Return what a mass that the load data miss [kg] means, or nothing."""
    if abs(mass) <= declared.payload_error:
        return ""
    return (
        f"declared is an error of at most {declared.payload_error:g} kg: correct the "
        "load data in Sunrise, or declare a larger one and read docs/safety.md"
    )
