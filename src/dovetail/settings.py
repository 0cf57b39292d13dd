"""Settings: flat frozen records of documented fields, checked when they are made.

A record inherits the fields of smaller ones, each on one subject. A setting has one
name: in Python, in a TOML file, on the command line and in messages.
"""

import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import (
    Annotated,
    Any,
    Literal,
    TypeVar,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
)

import numpy as np
from pydantic import ConfigDict, GetCoreSchemaHandler, ValidationError, ValidationInfo
from pydantic.dataclasses import dataclass as checked_dataclass
from pydantic_core import CoreSchema, core_schema

from dovetail.errors import ConfigError, DovetailError, did_you_mean

T = TypeVar("T")

_CHECKS = ConfigDict(
    strict=True,
    extra="forbid",
    arbitrary_types_allowed=True,
    validate_default=True,
    allow_inf_nan=False,
)


_OWNERS: dict[type, str] = {}
"""Owner of the settings of each record."""


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(field,)
)
def settings(*, eq: bool = True, owner: str = "") -> Callable[[type[T]], type[T]]:
    """Make a class a frozen, keyword-only dataclass whose fields pydantic checks.

    Args:
        eq: Compare by value; False for a record with arrays.
        owner: Owner of the settings, put before their names in messages; empty is that
            of the records that it inherits.
    """

    def make(kind: type[T]) -> type[T]:
        made: Any = checked_dataclass(frozen=True, kw_only=True, eq=eq, config=_CHECKS)(
            kind
        )
        check: Any = made.__init__
        paths = {f.name for f in fields(made) if _is_path(f.type)}

        @wraps(check)
        def init(self: Any, **given: Any) -> None:
            read = {n: _as_written(v, is_path=n in paths) for n, v in given.items()}
            try:
                check(self, **read)
            except ValidationError as error:
                raise _as_config_error(error, made, _OWNERS[made]) from None

        made.__init__ = init
        inherited = (_OWNERS[base] for base in kind.__mro__ if base in _OWNERS)
        _OWNERS[made] = owner or next(inherited, "")
        if not eq:  # not the comparison that a base makes of its own fields
            made.__eq__, made.__hash__ = object.__eq__, object.__hash__
        return cast(type[T], made)  # pydantic names a type of its own

    return make


def check_values(kind: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings of a record, each checked alone, none beside another.

    Args:
        kind: The record.
        values: Some of its settings.

    Raises:
        ConfigError: A value of another type, or out of range.
    """
    types = {f.name: f.type for f in fields(kind) if f.name in values}
    alone = settings()(type(kind.__name__, (), {"__annotations__": types}))
    return values_of(alone(**values))


def values_of(config: Any) -> dict[str, Any]:
    """Return every setting of a record by its name."""
    return {name: vars(config)[name] for name in names_in(type(config))}


def defaults_of(kind: type) -> dict[str, Any]:
    """Return the default of every setting of a record that has one."""
    found = {}
    by_name = {f.name: f for f in fields(kind)}
    for field_ in (by_name[name] for name in names_in(kind)):
        if field_.default_factory is not MISSING:
            found[field_.name] = field_.default_factory()
        elif field_.default is not MISSING:
            found[field_.name] = field_.default
    return found


def names_in(kind: type) -> list[str]:
    """Return the names of a record's settings, those that it inherits first."""
    inherited = [n for b in kind.__bases__ if is_dataclass(b) for n in names_in(b)]
    return list(dict.fromkeys([*inherited, *(f.name for f in fields(kind))]))


def fill_in(config: Any, **values: Any) -> None:
    """Set settings of a record that is being made, where others decide them."""
    for name, value in values.items():
        object.__setattr__(config, name, value)


@dataclass(frozen=True)
class Range:
    """Allowed range of a number: ``Annotated[float, Range(0, 1, "rad")]``."""

    low: float
    """Smallest allowed value."""
    high: float
    """Largest allowed value."""
    unit: str
    """Unit, ``1`` for a share or a count."""
    labels: tuple[str, ...] = ()
    """Names of the elements of an array; none for a single number."""

    def __get_pydantic_core_schema__(
        self, kind: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the check of a field of this type, for pydantic."""
        parts = get_args(kind)
        is_union = type(None) in parts
        own = [part for part in parts if part is not type(None)] if is_union else [kind]
        is_tuple = all(get_origin(part) is tuple for part in own)

        def check(value: Any, info: ValidationInfo) -> Any:
            name = info.field_name or "value"
            if value is None and type(None) in parts:
                return None
            if kind is int or int in parts:
                low, high = int(self.low), int(self.high)
                return in_count(name, value, low, high, self.unit)
            checked = in_range(name, value, self)
            return tuple(checked.tolist()) if is_tuple else checked

        return core_schema.with_info_plain_validator_function(check)


def ranges_of(kind: type) -> dict[str, Range]:
    """Return the range of each setting of a record that has one."""
    return {
        f.name: note
        for f in fields(kind)
        if get_origin(f.type) is Annotated
        for note in get_args(f.type)[1:]
        if isinstance(note, Range)
    }


def in_count(name: str, value: Any, low: int, high: int, unit: str) -> int:
    """Return a whole number in its range.

    Raises:
        ConfigError: Not a whole number, or out of range.
    """
    allowed = f"{low} to {high}" if unit == "1" else f"{low} to {high} {unit}"
    facts: dict[str, Any] = {
        "name": name,
        "value": value,
        "unit": unit,
        "allowed": (low, high),
    }
    try:
        count = operator.index(value)
    except TypeError as error:
        raise ConfigError(
            f"{name} is {value!r}; give a whole number: {allowed}", **facts
        ) from error
    if isinstance(value, bool) or not low <= count <= high:
        raise ConfigError(f"{name} is {value}; allowed: {allowed}", **facts)
    return count


def in_range(name: str, value: Any, allowed: Range) -> Any:
    """Return a number in its range, or a read-only array where it has labels.

    Raises:
        ConfigError: Not numbers, a wrong shape, or an element out of its range.
    """
    labels, unit = allowed.labels, allowed.unit
    said = "" if unit == "1" else f" {unit}"
    span = f"{allowed.low:g} to {allowed.high:g}{said}"

    def wrong(message: str, element: str = name, value: Any = value) -> ConfigError:
        bounds = (allowed.low, allowed.high)
        return ConfigError(
            message, name=element, value=value, unit=unit, allowed=bounds
        )

    elements = value if isinstance(value, (list, tuple)) else [value]
    for i, element in enumerate(elements):
        if isinstance(element, (str, bool)):
            part = f"{name}[{labels[i]}]" if i < len(labels) else name
            text = f"{part} is {element!r}, which is no number; allowed: {span}"
            raise wrong(text, part, element)
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise wrong(f"{name} must be numbers [{unit}]: {error}") from error
    if array.ndim == 0 and labels:
        array = np.full(len(labels), float(array))
    if array.shape != ((len(labels),) if labels else ()):
        wanted = f"{len(labels)} values ({' '.join(labels)})" if labels else "one value"
        raise wrong(f"{name} has shape {array.shape}; give {wanted} in {unit}")
    for i, x in enumerate(np.atleast_1d(array)):
        if not allowed.low <= x <= allowed.high:  # false for nan, too
            element = f"{name}[{labels[i]}]" if labels else name
            raise wrong(f"{element} is {x:g}{said}; allowed: {span}", element, float(x))
    if not labels:
        return float(array)
    array.setflags(write=False)
    return array


def _is_path(kind: Any) -> bool:
    """Say whether a setting holds a path, and no plain text."""
    parts = get_args(kind)
    return kind is Path or (str not in parts and any(map(_is_path, parts)))


def _as_written(value: Any, *, is_path: bool) -> Any:
    """Return a value as its setting has it: a list as a tuple, a path's text as one."""
    if isinstance(value, list):
        return tuple(_as_written(part, is_path=is_path) for part in value)
    return Path(value) if is_path and isinstance(value, str) else value


def unknown_settings(
    unknown: Iterable[str], known: Iterable[str], whose: str
) -> ConfigError:
    """Return the error that names unknown settings and the nearest known ones."""
    known, unknown = list(known), sorted(unknown)
    names = ", ".join(name + did_you_mean(name, known) for name in unknown)
    return ConfigError(
        f"unknown settings of {whose}: {names}; known: {', '.join(known)}",
        name=unknown[0],
        allowed=tuple(known),
    )


def _as_config_error(
    error: ValidationError, kind: type, owner: str
) -> ConfigError | Exception:
    """Return what pydantic found as dovetail's own error."""
    found = error.errors(include_url=False)
    first = found[0]
    raised = first.get("ctx", {}).get("error")
    if isinstance(raised, DovetailError):  # of a range or of the record's own check
        if owner and isinstance(raised, ConfigError) and raised.name:
            raised.args = (f"{owner} {raised}",)
        return raised
    kind_of_unknown = "unexpected_keyword_argument"
    unknown = [str(e["loc"][0]) for e in found if e["type"] == kind_of_unknown]
    if unknown:
        return unknown_settings(unknown, names_in(kind), owner or kind.__name__)
    name = str(first["loc"][0]) if first["loc"] else kind.__name__
    if first["type"].startswith("missing"):
        return ConfigError(f"{owner} {name} is missing".strip(), name=name)
    said, value = f"{owner} {name}".strip(), first["input"]
    if first["type"] == "literal_error":
        known = _words(next(f.type for f in fields(kind) if f.name == name))
        text = f"{said} is {value!r}; known: {', '.join(map(str, known))}"
        return ConfigError(text, name=name, value=value, allowed=known)
    return ConfigError(_describe(found, said), name=name, value=value)


def _words(kind: Any) -> tuple[Any, ...]:
    """Return the words of a Literal, however it is annotated."""
    if get_origin(kind) is Literal:
        return get_args(kind)
    return tuple(word for part in get_args(kind) for word in _words(part))


def _describe(found: list[Any], name: str) -> str:
    """Return what is wrong with a value that has another type than its setting."""
    first = found[0]
    same = [e for e in found if e["loc"][:1] == first["loc"][:1]]
    wanted = dict.fromkeys(map(_wanted, same))
    return f"{name} is {first['input']!r}; needed: {' or '.join(wanted)}"


def _wanted(error: Any) -> str:
    """Return the value that pydantic wanted, in words."""
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])
    if error["type"] in ("path_type", "is_instance_of") and "Path" in error["msg"]:
        return "a path"
    return error["msg"].partition(",")[0].removeprefix("Input should be ")
