"""Durations as they are written: 5ms, 0.2s, 2 min."""

import math
import re

from dovetail.errors import ConfigError

_UNITS = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0}
_DURATION = re.compile(r"([0-9.eE+-]+)\s*(us|ms|s|min)")


def parse_duration(text: str, name: str) -> float:
    """Read a duration with its unit, as 5ms or 0.2s, in seconds.

    Args:
        text: The number and us, ms, s or min.
        name: What it is, for messages.

    Raises:
        ConfigError: It is not a number with its unit.
    """
    match = _DURATION.fullmatch(text.strip())
    try:
        value = float(match[1]) * _UNITS[match[2]] if match else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(
            f"{name} is {text!r}; give a number and its unit, us, ms, s or min, as in "
            "5ms"
        )
    return value


def format_ms(duration: float) -> str:
    """Return a duration [s] as it is given on a command line, such as 2.5ms."""
    return f"{1e3 * duration:g}ms"


def parse_time(text: str, name: str) -> float:
    """Read a duration above 0, see `parse_duration`."""
    try:
        value = parse_duration(text, name)
    except ConfigError:
        value = 0.0
    if value <= 0.0:
        raise ConfigError(
            f"{name} is {text!r}; give a number above 0 with its unit, ms or s, such "
            "as 5ms or 0.005s"
        )
    return value
