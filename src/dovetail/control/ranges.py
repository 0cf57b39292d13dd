"""Allowed range, unit and element names of a setting, written beside its type."""

import operator
from dataclasses import dataclass, fields
from typing import Any

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


def check_ranges(config: Any) -> None:
    """Convert, freeze and check every annotated field of a frozen dataclass.

    A single number given for an array fills it.

    Raises:
        ConfigError: Not numbers, a wrong shape, or an element out of its range.
    """
    for f in fields(config):
        for allowed in getattr(f.type, "__metadata__", ()):
            value = in_range(f.name, getattr(config, f.name), allowed)
            object.__setattr__(config, f.name, value)


def in_count(name: str, value: Any, low: int, high: int, unit: str) -> int:
    """Return a whole number in its range.

    Raises:
        ConfigError: Not a whole number, or out of range.
    """
    try:
        count = operator.index(value)
    except TypeError as error:
        raise ConfigError(
            f"{name} is {value!r}; give a whole number: {low} to {high} {unit}"
        ) from error
    if not low <= count <= high:
        raise ConfigError(f"{name} is {count}; allowed: {low} to {high} {unit}")
    return count


def in_range(name: str, value: Any, allowed: Range) -> Any:
    """Return a number in its range, or a read-only array where it has labels.

    Raises:
        ConfigError: Not numbers, a wrong shape, or an element out of its range.
    """
    labels, unit = allowed.labels, allowed.unit
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
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
                f"{element} is {x:g} {unit}; "
                f"allowed: {allowed.low:g} to {allowed.high:g} {unit}"
            )
    if not labels:
        return float(array)
    array.setflags(write=False)
    return array
