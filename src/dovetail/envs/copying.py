"""Copies of an environment that has not begun: the same arguments, built once more.

An environment holds a controller and a simulation, which have no copy; vector
environments, and programs that keep one in a configuration, need copies.
"""

from collections.abc import Callable
from typing import Any, Self

from dovetail.errors import ConfigError


class RebuiltOnCopy:
    """Gives a class `copy.deepcopy` and `pickle`: a copy is built from its arguments.

    Once an episode has begun (`state` is there), or where an arm is an object in place
    of an address, there is no copy, and the error says so.
    """

    def __new__(cls, *arguments: Any, **options: Any) -> Self:
        """Keep what the object is built from."""
        made = super().__new__(cls)
        made._built_from = (arguments, options)
        return made

    _built_from: tuple[tuple[Any, ...], dict[str, Any]]

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Return how to build it once more.

        Raises:
            ConfigError: An episode has begun, or the arm is an object.
        """
        arguments, options = self._built_from
        if "state" in vars(self):
            raise ConfigError(
                "an environment whose first episode has begun cannot be copied or "
                "pickled: copy it before reset, or make another by gymnasium.make"
            )
        arm = options.get("arm", arguments[1] if len(arguments) > 1 else None)
        if arm is not None and not isinstance(arm, str):
            raise ConfigError(
                f"an environment that was given a {type(arm).__name__} cannot be "
                "copied or pickled: give the arm's address in place of the object"
            )
        return _rebuild, (type(self), arguments, options)


def _rebuild(
    kind: type[Any], arguments: tuple[Any, ...], options: dict[str, Any]
) -> Any:
    return kind(*arguments, **options)
