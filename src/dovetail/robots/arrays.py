"""Facts of an arm that are arrays: of a known shape, finite and read-only."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dovetail.errors import ConfigError
from dovetail.types import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class ArrayFacts:
    """Some of a robot's arrays. They are copied, and are read-only."""

    shapes: ClassVar[Mapping[str, tuple[int, ...]]]
    """Shape of each array, by name; no two parts of a robot share one."""
    unbounded: ClassVar[frozenset[str]] = frozenset()
    """Names of the arrays that may be infinite."""

    def __post_init__(self) -> None:
        """Refuse what has another shape or is not finite."""
        for name, shape in self.shapes.items():
            value = frozen_array(
                vars(self)[name], shape, f"robot {name}", name not in self.unbounded
            )
            object.__setattr__(self, name, value)


def frozen_array(
    value: Any, shape: tuple[int, ...], name: str, is_finite: bool = True
) -> Array:
    """Copy to a read-only float array of this shape, or say what is wrong."""
    array = np.array(value, dtype=float, order="C")
    if array.shape != shape:
        raise ConfigError(f"{name} has shape {array.shape}; it must be {shape}")
    wrong = ~np.isfinite(array) if is_finite else np.isnan(array)
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0])
        allowed = "finite" if is_finite else "a number"
        raise ConfigError(
            f"{name}{list(index)} is {array[index]}: it must be {allowed}"
        )
    array.setflags(write=False)
    return array
