"""Arms for which the limits were shown to hold, and the warning for any other.

The figures behind it are in docs/safety.md: `benchmarks/adversary.py --contact` attacks
everything inside this table at once.
"""

from dovetail.control.period import PERIODS

DECLARED: dict[str, float] = {"delay": 0.010, "mass_error": 0.20, "payload_error": 1.0}
"""The table: largest delay [s], error of a link's mass [1] and of the payload [kg] for
which the margins of `LimitConfig.for_period` were attacked. They are also declared for
an arm when no others are given."""

_UNPROVEN = "for which the limits are unproven"

GRAVITY_ERROR = 1.0
"""Error of gravity along each axis, size and direction, that the attacks behind the
table include [m/s2]: 0.1 rad of an inclined mounting."""

_WORDS = {
    "delay": ("the loop's delay", 1e3, "ms"),
    "mass_error": ("the error of a link's mass", 1e2, "%"),
    "payload_error": ("the payload's error", 1.0, "kg"),
}
_REMEDY = {
    "delay": "shorten it, or keep the arm away from people and expect stops",
    "mass_error": "give a robot with its true masses (docs/your-own-robot.md)",
    "payload_error": "give the tool's true load data",
}


def describe(name: str, value: float) -> str:
    """Return a value of `DECLARED` with the unit in which it is said."""
    _, factor, unit = _WORDS[name]
    return f"{factor * value:.3g} {unit}"


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
        declared: What was said of the arm, to compare with; None is `DECLARED`.

    Returns:
        One sentence for each; empty where everything is inside.
    """
    ranges = DECLARED if declared is None else declared
    said = []
    if period is not None and not any(abs(period - p) < 1e-9 for p in PERIODS):
        known = ", ".join(f"{1e3 * p:g}" for p in PERIODS)
        said.append(
            f"the control period is {1e3 * period:g} ms, {_UNPROVEN}; shown to hold: "
            f"{known} ms; choose one of these"
        )
    given = {"delay": delay, "mass_error": mass_error, "payload_error": payload_error}
    for name, value in given.items():
        if value is None or value <= ranges[name] * (1.0 + 1e-9):
            continue
        is_proven = value <= DECLARED[name] * (1.0 + 1e-9)
        what = "more than was declared" if is_proven else _UNPROVEN
        known = "shown to hold"  # of the table alone; another range is only declared
        if declared is not None:
            is_table = ranges[name] == DECLARED[name]
            known = "declared and shown to hold" if is_table else "declared"
        said.append(
            f"{_WORDS[name][0]} is {describe(name, value)}, {what}; {known}: 0 to "
            f"{describe(name, ranges[name])}; {_REMEDY[name]}"
        )
    return said
