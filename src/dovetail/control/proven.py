"""For which arms the limits were shown to hold, and what is said of another one.

The figures behind it are in docs/safety.md: `benchmarks/adversary.py --contact` attacks
everything inside this table at once.
"""

from dovetail.control.period import PERIODS

DECLARED: dict[str, float] = {"delay": 0.010, "mass_error": 0.20, "payload_error": 1.0}
"""Largest delay [s], error of a link's mass [1] and of the payload [kg] for which
`LimitConfig.for_period` has margins: what it declares unless told otherwise."""

_WORDS = {
    "delay": ("the loop's delay", 1e3, "ms"),
    "mass_error": ("the error of a link's mass", 1e2, "%"),
    "payload_error": ("the payload's error", 1.0, "kg"),
}
_REMEDY = {
    "delay": "shorten it, or keep the arm away from people and expect stops",
    "mass_error": "identify the arm (dovetail identify)",
    "payload_error": "give the tool's true load data",
}


def unproven(
    *,
    period: float | None = None,
    delay: float | None = None,
    mass_error: float | None = None,
    payload_error: float | None = None,
    declared: dict[str, float] | None = None,
) -> list[str]:
    """Say what lies outside the table, each with value, allowed range and remedy.

    Args:
        period: Control period [s].
        delay: Of the loop, declared or measured [s].
        mass_error: Of a link, as a share [1].
        payload_error: Of the payload [kg].
        declared: Ranges to compare with; None is `DECLARED`.

    Returns:
        One sentence for each; empty where everything is inside.
    """
    ranges = DECLARED if declared is None else declared
    said = []
    if period is not None and not any(abs(period - p) < 1e-9 for p in PERIODS):
        known = ", ".join(f"{1e3 * p:g}" for p in PERIODS)
        said.append(
            f"the control period is {1e3 * period:g} ms, for which the limits are "
            f"unproven; shown to hold: {known} ms; choose one of these"
        )
    given = {"delay": delay, "mass_error": mass_error, "payload_error": payload_error}
    for name, value in given.items():
        if value is None or value <= ranges[name] * (1.0 + 1e-9):
            continue
        words, factor, unit = _WORDS[name]
        said.append(
            f"{words} is {factor * value:.3g} {unit}, for which the limits are "
            f"unproven; declared and shown to hold: 0 to {factor * ranges[name]:g} "
            f"{unit}; {_REMEDY[name]}"
        )
    return said
