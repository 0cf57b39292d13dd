"""Options of a command line: times with their units, and lists of paths."""

from collections.abc import Callable
from typing import Annotated, Any, TypeAlias

import tyro
from tyro.constructors import PrimitiveConstructorSpec

from dovetail.durations import format_ms, parse_duration
from dovetail.errors import ConfigError, DovetailError

TIMES = ("period", "delay")
"""Options whose value has its unit, as 5ms."""


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
        is_instance=lambda value: isinstance(value, float),
        str_from_instance=lambda time: [format_ms(time)],
    )


Period: TypeAlias = Annotated[float, _time("--period")]
"""Type of a setting that holds a control period [s]: 5ms on a command line."""
Delay: TypeAlias = Annotated[float, _time("--delay")]
"""Type of a setting that holds a loop's delay [s]: 10ms on a command line."""
Placement: TypeAlias = Annotated[
    tuple[float, float, float, float]
    | tuple[float, float, float, float, float, float]
    | None,
    tyro.conf.arg(metavar="X Y Z YAW [B C]"),
]
"""Type of a setting that holds the place of a fixture: x y z [m] and yaw [rad], then,
where it is tilted, B and C about y and x [rad]."""


def some_paths(
    name: str, kind: Callable[[str], Any] = str
) -> PrimitiveConstructorSpec[Any]:
    """Return how an option reads its paths; without one it is refused.

    Args:
        name: Of the option, for the message.
        kind: What a path becomes: str or Path.
    """

    def read(words: list[str]) -> tuple[Any, ...]:
        if not words:  # tyro would wrap a ValueError in a page of its own
            raise DovetailError(f"{name} needs at least one file or folder")
        return tuple(kind(word) for word in words)

    return PrimitiveConstructorSpec(
        nargs="*",
        metavar="PATH..",
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda paths: [str(path) for path in paths],
    )


def option_words(name: str, value: Any) -> list[str]:
    """Return a setting as the words of a command line that give it."""
    option = name.replace("_", "-")
    if isinstance(value, bool):
        return [f"--{option}" if value else f"--no-{option}"]
    if name in TIMES:
        value = format_ms(value)
    values = value if isinstance(value, list | tuple) else [value]
    return [f"--{option}", *map(str, values)]
