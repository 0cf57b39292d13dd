"""A control period on the command line: written 1ms or 2.5ms, a float [s] inside."""

from typing import Annotated, Any, TypeAlias

from tyro.constructors import PrimitiveConstructorSpec

from dovetail.control.period import format_period
from dovetail.durations import parse_duration
from dovetail.errors import ConfigError, DovetailError


def _read(words: list[str]) -> float:
    try:
        return parse_duration(words[0], "--period")
    except ConfigError as error:  # tyro would wrap a ValueError in a page of its own
        raise DovetailError(str(error)) from error


def _is_period(value: Any) -> bool:
    return isinstance(value, float)


Period: TypeAlias = Annotated[
    float,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="TIME",
        instance_from_str=_read,
        is_instance=_is_period,
        str_from_instance=lambda period: [format_period(period)],
    ),
]
"""Type of a setting that holds a control period [s]."""
