"""Reading a request's fields: what is wrong is collected and named, all of it."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dovetail.control.task_spec import AXES
from dovetail.rpc.problems import Field, FieldError
from dovetail.types import Array

TASK_AXES = tuple(AXES)
XYZ = ("X", "Y", "Z")
PLANE = ("nx", "ny", "nz", "offset")
WXYZ = ("w", "x", "y", "z")
FINITE = (-math.inf, math.inf)
LENGTH_TOLERANCE = 2e-3
"""Largest difference from 1 of the squared length of a unit quaternion or normal."""


class FieldReader:
    """Reads numbers out of messages; `finish` raises if any was wrong."""

    def __init__(self) -> None:
        self.wrong: list[Field] = []

    def refuse(self, path: str, value: str, allowed: str) -> None:
        """Note a wrong field."""
        self.wrong.append(Field(path, value, allowed))

    def finish(self) -> None:
        """Raise FieldError if any field was wrong."""
        if self.wrong:
            raise FieldError(self.wrong)

    def vector(
        self,
        path: str,
        values: Sequence[float],
        labels: tuple[str, ...],
        unit: str,
        allowed: tuple[Any, Any] = FINITE,
    ) -> Array:
        """Read an array, one element for each label.

        Args:
            path: Where it is in the request.
            values: As sent.
            labels: Names of the elements.
            unit: Their unit.
            allowed: Lowest and highest value; numbers, or one for each element. An
                infinite value is right only where the highest alone is infinite.
        """
        if len(values) != len(labels):
            given = f"{len(values)} value{'' if len(values) == 1 else 's'}"
            wanted = f"{len(labels)} ({' '.join(labels)})" if any(labels) else "1 value"
            self.refuse(path, given if values else "missing", f"{wanted} in {unit}")
            return np.full(len(labels), np.nan)
        array = np.array(values[:])  # a list is read far quicker than the field itself
        low, high = allowed
        is_right = (array >= low) & (array <= high)
        is_right &= np.isfinite(array) | np.isfinite(low)
        for i in np.flatnonzero(~is_right):
            element = f"{path}[{labels[i]}]" if labels[i] else path
            lowest, highest = (np.broadcast_to(x, array.shape)[i] for x in allowed)
            self._check(element, array[i], unit, lowest, highest)
        return array

    def number(
        self,
        path: str,
        message: Any,
        name: str,
        unit: str,
        allowed: tuple[float, float] = FINITE,
    ) -> float:
        """Read an optional field that must be there."""
        if not message.HasField(name):
            self.refuse(path, "missing", _range(unit, *allowed))
            return math.nan
        value = getattr(message, name)  # HasField knows it by this name, too
        return self.scalar(path, value, unit, allowed)

    def scalar(
        self, path: str, value: float, unit: str, allowed: tuple[float, float]
    ) -> float:
        """Read a number that is always there."""
        self._check(path, value, unit, *allowed)
        return value

    def rotation(self, path: str, values: Sequence[float]) -> Array:
        """Read a unit quaternion."""
        quat = self.vector(path, values, WXYZ, "1")
        length = sum(x * x for x in values[:]) if len(values) == 4 else math.nan
        if math.isfinite(length) and abs(length - 1.0) > LENGTH_TOLERANCE:
            self.refuse(path, f"of length {math.sqrt(length):.6g}", "length 1")
        return quat

    def _check(
        self, path: str, value: float, unit: str, low: float, high: float
    ) -> None:
        is_number = math.isfinite(value) or math.isfinite(low)
        if not (is_number and low <= value <= high):
            self.refuse(path, f"{value:g} {unit}", _range(unit, low, high))


def _range(unit: str, low: float, high: float) -> str:
    if math.isinf(low):
        return f"finite numbers in {unit}"
    return f"{low:g} to {high:g} {unit}"
