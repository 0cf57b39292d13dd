"""Allowed range, unit and element names of a setting, written beside its type."""

import operator
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np

from dovetail.errors import ConfigError


@dataclass(frozen=True)
class Range:
    """Annotation of a dataclass field: ``Annotated[float, Range(0, 1, "rad")]``."""

    low: float
    """Smallest allowed value."""
    high: float
    """Largest allowed value."""
    unit: str
    """Unit, ``1`` for a share or a count."""
    labels: tuple[str, ...] = ()
    """Names of the elements of an array; none for a single number."""


def check_ranges(config: Any, owner: str = "") -> None:
    """Convert, freeze and check the fields of a frozen dataclass.

    A field is checked where it is annotated with a `Range`, or is one of the words of a
    Literal. A single number given for an array fills it; a tuple stays a tuple; None
    is left alone where the type allows it.

    Args:
        config: The dataclass, in its `__post_init__`.
        owner: Whose setting it is, put before a name in messages.

    Raises:
        ConfigError: Not numbers, a wrong shape, an element out of its range, or an
            unknown word.
    """
    values = vars(config)
    for f in fields(config):
        name = f"{owner} {f.name}".strip()
        kind, *notes = get_args(f.type) if get_origin(f.type) is Annotated else [f.type]
        if get_origin(kind) is Literal and values[f.name] not in get_args(kind):
            known = ", ".join(str(word) for word in get_args(kind))
            raise ConfigError(f"{name} is {values[f.name]!r}; known: {known}")
        for allowed in notes:
            is_left_out = values[f.name] is None and type(None) in get_args(kind)
            if isinstance(allowed, Range) and not is_left_out:
                value = _in_field(name, values[f.name], kind, allowed)
                object.__setattr__(config, f.name, value)


def ranges_of(config: type) -> dict[str, Range]:
    """Return the range of each field of a dataclass that has one."""
    return {
        f.name: note
        for f in fields(config)
        if get_origin(f.type) is Annotated
        for note in get_args(f.type)[1:]
        if isinstance(note, Range)
    }


def _in_field(name: str, value: Any, kind: Any, allowed: Range) -> Any:
    """Return a field's value, checked, as its type has it."""
    if kind is int or int in get_args(kind):
        return in_count(name, value, int(allowed.low), int(allowed.high), allowed.unit)
    checked = in_range(name, value, allowed)
    return tuple(checked.tolist()) if get_origin(kind) is tuple else checked


def in_count(name: str, value: Any, low: int, high: int, unit: str) -> int:
    """Return a whole number in its range.

    Raises:
        ConfigError: Not a whole number, or out of range.
    """
    allowed = f"{low} to {high}" if unit == "1" else f"{low} to {high} {unit}"
    try:
        count = operator.index(value)
    except TypeError as error:
        raise ConfigError(
            f"{name} is {value!r}; give a whole number: {allowed}"
        ) from error
    if not low <= count <= high:
        raise ConfigError(f"{name} is {count}; allowed: {allowed}")
    return count


def in_range(name: str, value: Any, allowed: Range) -> Any:
    """Return a number in its range, or a read-only array where it has labels.

    Raises:
        ConfigError: Not numbers, a wrong shape, or an element out of its range.
    """
    labels, unit = allowed.labels, allowed.unit
    said = "" if unit == "1" else f" {unit}"
    elements = value if isinstance(value, (list, tuple)) else [value]
    for i, element in enumerate(elements):
        if isinstance(element, (str, bool)):
            part = f"{name}[{labels[i]}]" if i < len(labels) else name
            raise ConfigError(
                f"{part} is {element!r}, which is no number; allowed: {allowed.low:g} "
                f"to {allowed.high:g}{said}"
            )
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ConfigError(f"{name} must be numbers [{unit}]: {error}") from error
    if array.ndim == 0 and labels:
        array = np.full(len(labels), float(array))
    if array.shape != ((len(labels),) if labels else ()):
        wanted = f"{len(labels)} values ({' '.join(labels)})" if labels else "one value"
        raise ConfigError(f"{name} has shape {array.shape}; give {wanted} in {unit}")
    for i, x in enumerate(np.atleast_1d(array)):
        if not allowed.low <= x <= allowed.high:  # false for nan, too
            element = f"{name}[{labels[i]}]" if labels else name
            raise ConfigError(
                f"{element} is {x:g}{said}; "
                f"allowed: {allowed.low:g} to {allowed.high:g}{said}"
            )
    if not labels:
        return float(array)
    array.setflags(write=False)
    return array
