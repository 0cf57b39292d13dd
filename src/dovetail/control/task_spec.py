"""Mode of each task axis, written as text: ``XYZ:force A:pose BC:hold``."""

from dataclasses import dataclass
from typing import Self

from dovetail.errors import ConfigError

AXES = "XYZCBA"
"""Task axes in twist order: translations, then rotations about x (C), y (B), z (A)."""

MODES = ("free", "force", "pose", "hold")
"""Modes by number: dropped; f* from the action; to the target; to the reset pose."""

FREE, FORCE, POSE, HOLD = range(4)
_SPELLING = "XYZABC"


@dataclass(frozen=True)
class TaskSpec:
    """One mode per task axis."""

    modes: tuple[int, ...]
    """Mode number of each axis, in the order of `AXES`, see `MODES`."""

    def __post_init__(self) -> None:
        if len(self.modes) != len(AXES):
            raise ConfigError(
                f"a task needs {len(AXES)} modes (axes {' '.join(AXES)}), "
                f"got {len(self.modes)}"
            )
        for axis, mode in zip(AXES, self.modes, strict=True):
            if mode not in range(len(MODES)):
                known = ", ".join(f"{i} {name}" for i, name in enumerate(MODES))
                raise ConfigError(f"task axis {axis} has mode {mode}; known: {known}")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a task from text such as ``XYZ:force A:pose BC:hold``.

        Args:
            text: Groups ``AXES:mode`` separated by blanks. X Y Z are translations, A B
                C rotations about the world's z, y, x. An axis not named is ``free``.

        Raises:
            ConfigError: Unknown axis or mode, an axis named twice, or no group at all.
        """
        modes = [FREE] * len(AXES)
        seen: set[str] = set()
        groups = text.split()
        if not groups:
            raise ConfigError(
                f"task {text!r} names no axis: write groups such as 'XYZ:force BC:hold'"
            )
        for group in groups:
            axes, colon, mode = group.partition(":")
            if not axes or not colon:
                raise ConfigError(
                    f"task group {group!r} in {text!r} is not of the form AXES:mode, "
                    "for example 'XYZ:force'"
                )
            if mode not in MODES:
                raise ConfigError(
                    f"unknown mode {mode!r} in task group {group!r}; "
                    f"known modes: {', '.join(MODES)}"
                )
            for axis in axes:
                if axis not in AXES:
                    raise ConfigError(
                        f"unknown task axis {axis!r} in task group {group!r}; "
                        f"known axes: {' '.join(_SPELLING)}"
                    )
                if axis in seen:
                    raise ConfigError(
                        f"task axis {axis} is named twice in {text!r}: "
                        "an axis has one mode"
                    )
                seen.add(axis)
                modes[AXES.index(axis)] = MODES.index(mode)
        return cls(tuple(modes))

    def axes(self, mode: int) -> tuple[int, ...]:
        """Return the indices, in twist order, of the axes that have this mode."""
        return tuple(i for i, m in enumerate(self.modes) if m == mode)

    def __str__(self) -> str:
        """Write the task so that `parse` reads it back; free axes are left out."""
        groups = []
        for mode in (FORCE, POSE, HOLD):
            axes = "".join(a for a in _SPELLING if self.modes[AXES.index(a)] == mode)
            if axes:
                groups.append(f"{axes}:{MODES[mode]}")
        return " ".join(groups) if groups else f"{_SPELLING}:free"
