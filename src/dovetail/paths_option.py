"""An option of the command line that takes paths: at least one, if it is given."""

from collections.abc import Callable
from typing import Any

from tyro.constructors import PrimitiveConstructorSpec

from dovetail.errors import DovetailError


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
