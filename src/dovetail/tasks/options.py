"""Short options of a task: its fields that have one plain value.

A command takes them beside its own, files hold them beside their own: `--clearance` is
the field `clearance` of the task that is chosen, with the type and the words it has
there.
"""

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

from dovetail.errors import ConfigError
from dovetail.tasks.task import Task

_PLAIN = (str, float, int, bool)


def option_types(task: type[Task]) -> dict[str, type]:
    """Return the type of each option of a task: str, float, int or bool.

    Raises:
        ConfigError: The type of a field cannot be read; names the field.
    """
    try:
        kinds = get_type_hints(task)
    except (NameError, AttributeError, TypeError, SyntaxError) as error:
        raise ConfigError(
            f"the types of {task.__name__}'s fields cannot be told: {error}; import "
            "what they name outside of `if TYPE_CHECKING`"
        ) from error
    shared = {f.name for f in fields(Task)}
    own = [f.name for f in fields(task) if f.init and f.name not in shared]
    found = {name: _plain(f"{task.__name__}.{name}", kinds[name]) for name in own}
    return {name: kind for name, kind in found.items() if kind is not None}


def require_apart(task: type[Task], names: Iterable[str], whose: str) -> None:
    """Raise if a task option has the same name as another option.

    Args:
        task: Its options.
        names: Names of the other options.
        whose: Owner of the other options, in words.

    Raises:
        ConfigError: Says which options.
    """
    if taken := sorted(option_types(task).keys() & set(names)):
        raise ConfigError(
            f"the fields {', '.join(taken)} of {task.__name__} are also {whose}: give "
            "them other names"
        )


def own_options(task: type[Task]) -> dict[str, Any]:
    """Return what each option of a task is where nothing is given."""
    usual = {f.name: f.default for f in fields(task)}
    known = {name: usual[name] for name in option_types(task)}
    return {name: value for name, value in known.items() if value is not MISSING}


def require_types(options: Mapping[str, Any], task: type[Task]) -> None:
    """Refuse options of a task that are not of their types.

    Args:
        options: By name.
        task: Whose options they are.

    Raises:
        ConfigError: Names the option, its value and the type.
    """
    for name, kind in option_types(task).items():
        if name not in options:
            continue
        value = options[name]
        is_fine = isinstance(value, (int, float) if kind is float else kind)
        if not is_fine or isinstance(value, bool) != (kind is bool):
            raise ConfigError(
                f"{name} is {str(value)[:80]!r}; needed: {kind.__name__}",
                name=name,
                value=value,
            )


def gather_options(settings: Mapping[str, Any], task: type[Task]) -> dict[str, Any]:
    """Return flat settings with those of the task together, as `task_options`.

    Args:
        settings: By name; None is the task's own.
        task: Whose options are gathered.
    """
    names = option_types(task)
    own = {k: v for k, v in settings.items() if k in names and v is not None}
    rest = {k: v for k, v in settings.items() if k not in names}
    return rest | {"task_options": task.whole(own)}


def parse_values(text: str, task: type[Task]) -> tuple[str, tuple[Any, ...]]:
    """Return an option of a task and several values of it, from NAME=A,B.

    Raises:
        ConfigError: No such option, or a value that is not of its type.
    """
    name, _, values = text.partition("=")
    kinds = option_types(task)
    kind = kinds.get(name)
    if kind not in (str, float, int) or not values:
        known = ", ".join(n for n, k in kinds.items() if k is not bool)
        raise ConfigError(
            f"{text!r} does not vary an option of {task.__name__}; needed: NAME=A,B "
            f"with one of {known}"
        )
    listed = task.listed(name, values)
    try:
        return name, tuple(kind(value) for value in listed)
    except ValueError as error:
        raise ConfigError(f"{text!r}: {error}; needed: NAME=A,B") from error


def _plain(name: str, kind: Any) -> type | None:
    """Return the plain type that a field's value has, or None."""
    if get_origin(kind) is Literal:
        values = get_args(kind)
        kind, *others = {type(value) for value in values}
        if others:
            raise ConfigError(
                f"{name} is one of {', '.join(map(repr, values))}; allowed: values of "
                "one type, such as words only"
            )
    return kind if kind in _PLAIN else None
