"""A time on the command line: written 1ms or 2.5ms, a float [s] inside."""

from typing import Annotated, Any, TypeAlias

from tyro.constructors import PrimitiveConstructorSpec

from dovetail.control.period import format_period
from dovetail.durations import parse_duration
from dovetail.errors import ConfigError, DovetailError


def _is_time(value: Any) -> bool:
    return isinstance(value, float)


def _time(option: str) -> PrimitiveConstructorSpec[float]:
    def read(words: list[str]) -> float:
        try:
            return parse_duration(words[0], option)
        except ConfigError as error:  # tyro would wrap a ValueError in its own page
            raise DovetailError(str(error)) from error

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="TIME",
        instance_from_str=read,
        is_instance=_is_time,
        str_from_instance=lambda time: [format_period(time)],
    )


Period: TypeAlias = Annotated[float, _time("--period")]
"""Type of a setting that holds a control period [s]."""
Delay: TypeAlias = Annotated[float, _time("--delay")]
"""Type of a setting that holds a loop's delay [s]."""
