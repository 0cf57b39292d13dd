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

    def __post_init__(self) -> None:
        """Refuse what has another shape or is not finite."""
        for name, shape in self.shapes.items():
            value = frozen_array(vars(self)[name], shape, f"robot {name}")
            object.__setattr__(self, name, value)


def frozen_array(value: Any, shape: tuple[int, ...], name: str) -> Array:
    """Copy to a read-only float array of this shape, or say what is wrong."""
    array = np.array(value, dtype=float, order="C")
    if array.shape != shape:
        raise ConfigError(f"{name} has shape {array.shape}; it must be {shape}")
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ConfigError(f"{name}{list(index)} is {array[index]}: it must be finite")
    array.setflags(write=False)
    return array
