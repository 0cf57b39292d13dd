"""Command lines: tyro reads a command's settings, and the options of the chosen task.

`--help` lists the options that most people need; `--help-all` lists every one, with
everything that its docstring says.
"""

import argparse
import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from typing import Annotated, Any, get_args

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from dovetail.settings import names_in
from dovetail.tasks.options import (
    option_types,
    own_options,
    require_apart,
)
from dovetail.tasks.shipped import DEFAULT_ENV, IMPLIED_ENVS
from dovetail.tasks.task import Task

HELP, HELP_ALL = ("-h", "--help"), "--help-all"


def find_task(words: list[str], env: str | None = None) -> type[Task]:
    """Return the task that a command line chooses with `--env`.

    Args:
        words: The command line.
        env: The environment where none is said; None is the usual one.

    Raises:
        ConfigError: No such environment; lists the known ones.
    """
    from dovetail.envs.registered import task_class  # not for commands without a task

    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--env", nargs="?")
    found, _ = parser.parse_known_args(words)
    return task_class(found.env or env or _implied_env(words) or DEFAULT_ENV)


def _implied_env(words: list[str]) -> str | None:
    """Return the environment that an option means where no `--env` is given."""
    given = {word.partition("=")[0] for word in words}
    if "--env" in given:
        return None
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--vary", nargs="?", default="")
    varied = parser.parse_known_args(words)[0].vary or ""
    given |= {f"--{text.partition('=')[0]}" for text in varied.split("&")}
    found = (env for name, env in IMPLIED_ENVS.items() if f"--{name}" in given)
    return next(found, None)


def parse(
    command: Any,
    words: list[str],
    task: type[Task] | None = None,
    *,
    prog: str = "dovetail",
    common: tuple[str, ...] = (),
    before: Mapping[str, Any] | None = None,
) -> Any:
    """Read a command line.

    Args:
        command: The command's record of settings, or a union of them.
        words: The command line.
        task: Task whose options it has; None is that of its `--env`.
        prog: The command's name.
        common: Settings that `--help` lists; empty lists all.
        before: Settings that the command line changes: those of a file, or of a run.

    Raises:
        ConfigError: The task has an option that means something else to the command; or
            settings that are wrong, or exclude each other.
    """
    commands = list(_commands(command))
    names = {name for one in commands for name in names_in(one)}
    if "task_options" in names:
        task = task or find_task(words)
        require_apart(task, names, "options of the command")
    if "env" in names and "env" not in (before or {}) and (env := _implied_env(words)):
        words = [*words, "--env", env]
    is_help = any(word in (*HELP, HELP_ALL) for word in words)
    is_short = is_help and HELP_ALL not in words
    page = _Page(commands, task, common if is_short else (), before or {})
    kind, given = tyro.cli(
        command,
        args=["--help" if word == HELP_ALL else word for word in words],
        prog=prog,
        description=page.description(command),
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.DisallowNone),
        registry=page.registry(),
    )
    if task and "task_options" in given:
        given |= {"task_options": task.whole(given["task_options"])}
    return kind(**given)  # not by tyro, which would put a frame around its errors


class _Page:
    """The options of a command, in groups: one for each record that it inherits."""

    def __init__(
        self,
        commands: list[type],
        task: type[Task] | None,
        common: tuple[str, ...],
        before: Mapping[str, Any],
    ) -> None:
        self._commands = commands
        self._task = task
        self._common = common
        self._before = before
        self._own = {record: set[str]() for c in commands for record in _records(c)}
        for command in commands:
            for name in names_in(command):
                owners = [k for k in command.__mro__ if name in _annotations(k)]
                self._own[owners[0]].add(name)

    def registry(self) -> ConstructorRegistry:
        registry = ConstructorRegistry()
        registry.struct_rule(self._read)
        return registry

    def description(self, command: Any) -> str | None:
        if not self._common:
            return None
        more = sum(1 for name in names_in(command) if name not in self._common)
        first = (inspect.getdoc(command) or "").partition("\n\n")[0]
        return f"{first}\n\n{more} more options: {HELP_ALL}."

    def _read(self, info: StructTypeInfo) -> StructConstructorSpec | None:
        """Return the options of a record: the rule that tyro asks of each type."""
        kind = info.type
        if kind in self._commands and self._common:
            listed = [o for r in _records(kind) for o in self._options(r)]
            listed.sort(key=lambda option: self._rank(option.name))
            return StructConstructorSpec(self._make(kind), tuple(listed))
        if kind in self._commands:
            groups = [g for g in _records(kind) if g is not kind and self._own[g]]
            options = [*self._options(kind)]
            options += [
                StructFieldSpec(_title(g), g, tyro.MISSING_NONPROP) for g in groups
            ]
            return StructConstructorSpec(self._make(kind), tuple(options))
        if kind in self._own:
            return StructConstructorSpec(dict, tuple(self._options(kind)))
        return None

    def _make(self, kind: type) -> Callable[..., Any]:
        """Return what gathers a command's settings from its groups of options."""
        of_task = option_types(self._task) if self._task else {}

        def make(**given: Any) -> Any:
            flat: dict[str, Any] = {}
            for name, value in given.items():
                flat |= value if isinstance(value, dict) else {name: value}
            own = {n: flat.pop(n) for n in of_task if n in flat}
            if own:
                own = {n: value for n, value in own.items() if value is not None}
                flat["task_options"] = own
            return kind, flat

        return make

    def _options(self, kind: type) -> Iterator[StructFieldSpec]:
        """Yield the options that a record itself adds."""
        said = field_words(kind)
        for f in fields(kind):
            if f.name not in self._own[kind]:
                continue
            given = self._before.get(f.name, _default(f))
            if f.name == "task_options":
                yield from self._of_task(given)
            else:
                yield self._option(f.name, f.type, given, said.get(f.name, ""))

    def _option(
        self, name: str, kind: Any, default: Any, words: str
    ) -> StructFieldSpec:
        kind = Annotated[kind, _HINT]
        if kind.__origin__ is bool and default is False:  # the help has no --no-NAME
            kind = Annotated[kind, tyro.conf.FlagCreatePairsOff]
        if self._common and name not in self._common:
            kind = Annotated[kind, tyro.conf.Suppress]
        if self._common:
            words = words.partition(". ")[0].rstrip(".")
        return StructFieldSpec(name, kind, default, words)

    def _rank(self, name: str) -> int:
        """Return the place of an option among those that `--help` lists."""
        own = option_types(self._task) if self._task else {}
        name = "task_options" if name in own else name
        return self._common.index(name) if name in self._common else len(self._common)

    def _of_task(self, given: dict[str, Any]) -> Iterator[StructFieldSpec]:
        """Yield the options that are the chosen task's own."""
        assert self._task is not None
        said, own = field_words(self._task), own_options(self._task)
        for name, kind in option_types(self._task).items():
            words = said.get(name, name).partition(". ")[0].rstrip(".")
            words += f" (default: {own.get(name, 'missing')})"
            hinted: Any = Annotated[kind | None, _HINT]
            yield StructFieldSpec(name, hinted, given.get(name), words)


def _hint(default: str) -> str:
    """Return the words for a default; none for what is left out or off."""
    return "" if default in ("", "None", "False") else f"(default: {default})"


_HINT = tyro.conf.arg(help_behavior_hint=_hint)


def _default(field: Field[Any]) -> Any:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return tyro.MISSING if field.default is MISSING else field.default


def _commands(command: Any) -> Iterator[type]:
    if isinstance(command, type) and is_dataclass(command):
        yield command
    for part in get_args(command):
        yield from _commands(part)


def _annotations(kind: type) -> Mapping[str, Any]:
    return vars(kind).get("__annotations__", {})


def _records(kind: type) -> list[type]:
    """Return the records that make up one, in the order in which they are named."""
    found = []
    for base in kind.__bases__:
        found += [one for one in _records(base) if one not in found]
    return [*found, kind] if is_dataclass(kind) else found


def _title(record: type) -> str:
    """Return the title of a record's options, such as "simulated dynamics"."""
    name = re.sub(r"(Config|Options|Settings)$", "", record.__name__)
    return re.sub(r"(?<!^)(?=[A-Z])", " ", name).lower()


@cache
def field_words(kind: type) -> Mapping[str, str]:
    """Return the docstring of each field of a dataclass, inherited ones too."""
    found = {}
    for base in reversed(kind.__mro__[:-1]):
        try:
            source = inspect.getsource(base)
        except (OSError, TypeError):  # made by a program or typed in: it has no words
            continue
        body = ast.parse(textwrap.dedent(source)).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                words = ast.literal_eval(text.value)
                found[ast.unparse(field.target)] = " ".join(words.split())
    return found
