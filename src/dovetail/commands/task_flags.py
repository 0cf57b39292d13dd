"""The options of a command line that are the chosen task's own."""

import argparse
from dataclasses import fields, is_dataclass, replace
from functools import partial
from typing import Any, get_args

import tyro
from tyro.conf import Fixed
from tyro.constructors import StructConstructorSpec, StructFieldSpec, StructTypeInfo

from dovetail.commands.box_titles import titled_by
from dovetail.commands.field_words import field_words
from dovetail.commands.help_page import is_switch
from dovetail.control.sections import settings_in
from dovetail.envs.registered import task_class
from dovetail.tasks.options import (
    TaskOptions,
    option_types,
    own_options,
    require_apart,
)
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.tasks.task import Task

_STANDS_FOR = {str: "NAME", float: "X", int: "N", bool: "True|False"}


def find_task(words: list[str], env: str | None = None) -> type[Task]:
    """Return the task that a command line chooses with `--env`.

    Args:
        words: The command line.
        env: The environment where none is said; None is the usual one.

    Raises:
        ConfigError: No such environment; lists the known ones.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--env", nargs="?")
    found, _ = parser.parse_known_args(words)
    return task_class(found.env or env or DEFAULT_ENV)


def parse(
    settings: Any,
    words: list[str],
    task: type[Task] | None = None,
    *,
    prog: str = "dovetail",
    default: Any = None,
) -> Any:
    """Read a command line whose settings have `task_options`.

    Args:
        settings: The command's dataclass, or a union of them.
        words: The command line.
        task: Whose options it may give; None is that of its `--env`.
        prog: The command's name.
        default: Settings that the command line changes.

    Raises:
        ConfigError: The task has an option that means something else to the command.
    """
    task = task or find_task(words)
    names = _names(settings)
    require_apart(task, names, "options of the command")
    switches = _switches(names)

    def options(info: StructTypeInfo) -> StructConstructorSpec | None:
        if info.type is TaskOptions:
            return StructConstructorSpec(_given, _fields(task, info.default))
        return _without_fixed(info)

    return tyro.cli(
        settings,
        args=[switches.get(word, word) for word in words],
        prog=prog,
        config=(tyro.conf.OmitArgPrefixes,),
        registry=titled_by(options),
        **({} if default is None else {"default": default}),
    )


def describe_options(task: type[Task]) -> dict[str, str]:
    """Return the options of a task as they are typed, and what each is."""
    said, own = field_words(task), own_options(task)
    return {
        f"--{name.replace('_', '-')} {_STANDS_FOR[kind]}": (
            f"{said.get(name, name)} ({own.get(name, 'to be given')})"
        )
        for name, kind in option_types(task).items()
    }


def _fields(task: type[Task], given: Any) -> tuple[StructFieldSpec, ...]:
    said, own = field_words(task), own_options(task)
    before = given if isinstance(given, TaskOptions) else {}
    kinds: dict[str, Any] = {n: kind | None for n, kind in option_types(task).items()}
    return tuple(
        StructFieldSpec(
            name,
            kinds[name],
            before.get(name),
            f"{said.get(name, name)}. The task's own is {own.get(name, 'missing')}.",
        )
        for name in kinds
    )


def _without_fixed(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Return the options of a section that has fields which are none.

    tyro alone would keep their names from others, and show them.
    """
    if not is_dataclass(kind := info.type):
        return None
    free = [f for f in fields(kind) if Fixed not in get_args(f.type)]
    if len(free) == len(fields(kind)):
        return None
    said, before = field_words(kind), info.default
    kinds: dict[str, Any] = {f.name: f.type for f in free}
    options = tuple(
        StructFieldSpec(name, kinds[name], vars(before)[name], f"{said[name]}.")
        for name in kinds
    )
    return StructConstructorSpec(partial(replace, before), options)


def _given(**values: Any) -> TaskOptions:
    return TaskOptions({k: v for k, v in values.items() if v is not None})


def _names(settings: Any) -> dict[str, Any]:
    """Return a command's own options and their types."""
    if isinstance(settings, type) and is_dataclass(settings):
        return {name: found.kind for name, found in settings_in(settings).items()}
    return {n: k for part in get_args(settings) for n, k in _names(part).items()}


def _switches(kinds: dict[str, Any]) -> dict[str, str]:
    """Return --NAME and --no-NAME as tyro reads a switch that may be left out."""
    found = {}
    for name, kind in kinds.items():
        if is_switch(kind):
            option = name.replace("_", "-")
            found |= {f"--{option}": f"--{option}=True"}
            found |= {f"--no-{option}": f"--{option}=False"}
    return found
