"""Closed lines of an SVG path: straight lines, Bezier curves and arcs of ellipses.

Reference:
    W3C, Scalable Vector Graphics 2, section 9.3 (path data) and appendix B.2.4 (centre
    of an arc).
"""

import math
import re
from collections.abc import Callable

import numpy as np

from dovetail.errors import ConfigError
from dovetail.types import Array

_TOKEN = re.compile(
    r"\s*,?\s*(?:([MmLlHhVvZzCcSsQqTtAa])|"
    r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?))"
)
_NUMBERS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}
"""Numbers that a command takes."""
_MOST = 1e6
_FLAGS = re.compile(r"\s*,?\s*([01])")


def is_path(text: str) -> bool:
    """Say whether a text is an SVG path: it begins with a move to a point."""
    return re.match(r"\s*[Mm]\s*[-+.\d]", text) is not None


def read_path(name: str, text: str, tolerance: float, most: int) -> list[Array]:
    """Return the lines of a path, each closed, shape (corners, 2).

    Args:
        name: Of the outline, for messages.
        text: The path, as the attribute `d` of an SVG file has it. Its axes are kept:
            y is not turned upside down.
        tolerance: Largest distance of a curve from the corners that stand for it.
        most: Corners that are allowed.

    Raises:
        ConfigError: It is no path, or has too many corners.
    """
    return _Path(name, text, tolerance, most).read()


class _Path:
    """A path that is being read."""

    def __init__(self, name: str, text: str, tolerance: float, most: int) -> None:
        self._name, self._text = name, text
        self._tolerance, self._most = tolerance, most
        self._at = 0
        self._lines: list[list[Array]] = []
        self._point = np.zeros(2)
        self._control = np.zeros(2)
        """Last control point, which a smooth curve mirrors."""
        self._count = 0

    def read(self) -> list[Array]:
        before = ""
        while self._text[self._at :].strip():
            command = self._command(before)
            if command.upper() == "Z":
                self._point = self._lines[-1][0]
            else:
                self._draw(command, self._numbers(command.upper()), before)
            before = command
        return [np.array(line) for line in self._lines]

    def _wrong(self, what: str) -> ConfigError:
        near = self._text[self._at : self._at + 20].strip()
        return ConfigError(
            f"the SVG path of {self._name} {what} at character {self._at} ({near!r})"
        )

    def _command(self, before: str) -> str:
        """Return the next command, or the one that numbers without one repeat."""
        match = _TOKEN.match(self._text, self._at)
        if match is None:
            raise self._wrong("cannot be read")
        if match[1] is None:
            if not before or before in "Zz":
                raise self._wrong("has a number without a command")
            return {"M": "L", "m": "l"}.get(before, before)
        self._at = match.end()
        if not self._lines and match[1] not in "Mm":
            raise self._wrong("does not begin with M")
        return match[1]

    def _numbers(self, kind: str) -> list[float]:
        found = []
        for index in range(_NUMBERS[kind]):
            is_flag = kind == "A" and index in (3, 4)
            match = (_FLAGS if is_flag else _TOKEN).match(self._text, self._at)
            number = match[1] if match and is_flag else match and match[2]
            if match is None or number is None:
                raise self._wrong(f"lacks a number for {kind}")
            found.append(float(number))
            if not abs(found[-1]) <= _MOST:
                raise self._wrong(f"has the number {number}; allowed: to {_MOST:g}")
            self._at = match.end()
        return found

    def _draw(self, command: str, numbers: list[float], before: str) -> None:
        kind = command.upper()
        here = self._point
        base = here if command.islower() else np.zeros(2)
        if kind in "HV":
            axis = "HV".index(kind)
            end = here.copy()
            end[axis] = base[axis] + numbers[0]
            points = [end]
        elif kind == "A":
            points = [base + numbers[5:]]
        else:
            points = [base + numbers[i : i + 2] for i in range(0, len(numbers), 2)]
        if kind == "M":
            self._lines.append([])
        if kind in "ST":
            family = "CS" if kind == "S" else "QT"
            is_smooth = before.upper() in family and before != ""
            points.insert(0, 2.0 * here - self._control if is_smooth else here)
        if kind in "CSQT":
            self._curve(np.array([here, *points]))
        elif kind == "A":
            self._arc(here, points[-1], numbers[:5])
        else:
            self._add(points[-1])
        self._control = points[-2] if kind in "CSQT" else points[-1]
        self._point = points[-1]

    def _add(self, *points: Array) -> None:
        self._count += len(points)
        if self._count > self._most:
            raise ConfigError(
                f"the SVG path of {self._name} has more than {self._most} corners; "
                "give a simpler one"
            )
        self._lines[-1].extend(points)

    def _sample(self, count: float, at: Callable[[float], Array], end: Array) -> None:
        """Add points of a curve at equal steps of its parameter, the exact end last."""
        if not count <= self._most:
            count = self._most + 1  # refused
        steps = max(math.ceil(count), 1)
        self._add(*(at(k / steps) for k in range(1, min(steps, self._most + 1))), end)

    def _curve(self, control: Array) -> None:
        """Add a Bezier curve; a chord is off by at most |B''| / (8 n^2)."""
        degree = len(control) - 1
        bend = np.linalg.norm(np.diff(control, n=2, axis=0), axis=1).max()
        bend *= degree * (degree - 1)
        weights = [math.comb(degree, k) for k in range(degree + 1)]

        def at(t: float) -> Array:
            shares = [
                w * t**k * (1.0 - t) ** (degree - k) for k, w in enumerate(weights)
            ]
            return np.array(shares) @ control

        count = math.sqrt(float(bend) / (8.0 * self._tolerance))
        self._sample(count, at, control[-1])

    def _arc(self, start: Array, end: Array, numbers: list[float]) -> None:
        rx, ry, tilt, is_large, is_sweep = numbers
        rx, ry = abs(rx), abs(ry)
        if not (rx and ry) or (start == end).all():
            self._add(end)
            return
        c, s = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
        turn = np.array([[c, -s], [s, c]])
        # In the ellipse's own axes, scaled so that it is a unit circle.
        half = (turn.T @ (start - end)) / 2.0 / [rx, ry]
        if (length := float(half @ half)) > 1.0:
            rx, ry = rx * math.sqrt(length), ry * math.sqrt(length)
            half, length = half / math.sqrt(length), 1.0
        side = 1.0 if is_large == is_sweep else -1.0
        aside = math.sqrt(max(1.0 / length - 1.0, 0.0)) * side
        centre = aside * np.array([-half[1], half[0]])
        first = math.atan2(*(half - centre)[::-1])
        span = math.atan2(*(-half - centre)[::-1]) - first
        span %= 2.0 * math.pi
        if not is_sweep:
            span -= 2.0 * math.pi
        middle = turn @ (centre * [rx, ry]) + (start + end) / 2.0

        def at(t: float) -> Array:
            angle = first + t * span
            return middle + turn @ [rx * math.cos(angle), ry * math.sin(angle)]

        share = min(self._tolerance / max(rx, ry), 0.5)
        self._sample(abs(span) / (2.0 * math.acos(1.0 - share)), at, end)
