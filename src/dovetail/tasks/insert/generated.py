"""Pairs of parts drawn at random, each a `part.toml`: to train one policy on many."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.errors import ConfigError
from dovetail.files import claim_output_folder, write_atomic
from dovetail.settings import in_count
from dovetail.tasks.insert.task import Insert
from dovetail.types import Array

KINDS = (
    *("round", "pin", "polygon", "d", "key", "plus", "oval", "convex", "step", "cap"),
)
"""Kinds of pairs, drawn in turn; a step is a wide section above a narrow one, a cap
goes over a post."""
PINS = "pins"
"""A further kind, a plug with two to four pins; the shipped policy never saw one."""
COUNT_MAX = 10_000
"""Most pairs of one folder."""
_STREAM = 0x9A125
_DRAWS = 200
"""Most draws of a pair until one can be built, held and inserted."""
_RADIUS, _PIN = (4.0, 12.0), (2.0, 4.0)  # [mm] around the outline
_DEPTH, _GAP, _CHAMFER = (6.0, 28.0), (0.2, 0.5), (0.3, 1.5)  # [mm]
_SLENDEREST = 7.0
"""Most depth per radius [1]."""
_ABOVE, _WALL = (
    (28.0, 45.0),
    (4.0, 40.0),
)  # [mm] of the plug above the socket, around it
_STEPS = ("circle", "square", "hexagon")
_PIN_COUNTS, _PIN_SHARE = (2, 5), (0.18, 0.3)
"""Pins of a plug, below the last; radius of each over that around all [1]."""
_ROUND = 32
"""Corners of a round opening."""
_ROOF = 1.0  # [mm] of a cap's bore over the post that is in it
_BASE = 8.0  # [mm] of the plate under a post
_ARC = math.radians(15.0)
"""Angle of a chord of an arc."""


def generate_parts(
    folder: Path, count: int, seed: int = 0, kinds: Sequence[str] = KINDS
) -> list[Path]:
    """Write pairs into a folder, each a file of its own.

    Args:
        folder: New or empty.
        count: How many, 1 and more.
        seed: Pair number i of a seed is the same for any count.
        kinds: Drawn in turn, of `KINDS` and `PINS`.

    Returns:
        The files, in order.

    Raises:
        ConfigError: A number out of range, an unknown kind, or the folder is there and
            not empty.
        LogError: The disk is full.
    """
    in_count("count", count, 1, COUNT_MAX, "pairs")
    in_count("seed", seed, 0, 2**31 - 1, "(2^31 - 1)")
    known, kinds = (*KINDS, PINS), [kind.strip() for kind in kinds]
    if not kinds or set(kinds) - set(known):
        raise ConfigError(
            f"kinds are {', '.join(kinds) or 'none'}; known: {', '.join(known)}",
            name="kinds",
        )
    folder = claim_output_folder(folder)
    files = []
    for index in range(count):
        kind = kinds[index % len(kinds)]
        text = draw_pair(seed, index, kind)
        files.append(write_atomic(folder / f"{index:03d}_{kind}.toml", text))
    return files


def draw_pair(seed: int, index: int, kind: str) -> str:
    """Return the text of a `part.toml` that `Insert` accepts."""
    rng = np.random.default_rng([_STREAM, seed, index])
    for _ in range(_DRAWS):
        table = {"name": f"{kind} {seed}-{index}", **_draw(rng, kind)}
        try:
            Insert(part=json.dumps(table))
        except ConfigError:  # a corner too sharp for its gap, an edge that vanishes
            continue
        return _toml(table)
    raise AssertionError(f"none of {_DRAWS} pairs of the kind {kind} can be built")


def _draw(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """Draw a pair of a kind [mm]."""
    radius = _between(rng, _PIN if kind == "pin" else _RADIUS)
    depth = min(_between(rng, _DEPTH), _SLENDEREST * radius)
    gap, above = _between(rng, _GAP), _between(rng, _ABOVE)
    is_through = bool(rng.random() < 0.5)
    block = 2.0 * (radius * math.sqrt(2.0) + _between(rng, _WALL))
    if kind == "step":
        return _step(rng, (radius, depth, gap, above, block), is_through=is_through)
    if kind == "cap":
        return _cap(rng, radius, depth, gap, above)
    if kind == PINS:
        return _pins(rng, radius, depth, gap, above)
    is_sharp = rng.random() < 0.3
    chamfer = 0.0 if is_sharp else min(_between(rng, _CHAMFER), depth / 3.0)
    return {
        "units": "mm",
        "outline": _outline(rng, kind, radius),
        "length": round(max(depth + above, 30.0), 2),
        "depth": round(depth, 2),
        "gap": round(gap, 3),
        "chamfer": round(chamfer, 2),
        "through": is_through,
        "block": round(block, 1),
    }


def _step(
    rng: np.random.Generator, sizes: tuple[float, ...], *, is_through: bool
) -> dict[str, Any]:
    """Draw a stepped shaft and its bore: radius, depth, gap, above, block [mm]."""
    radius, depth, gap, above, block = sizes
    word = _STEPS[int(rng.integers(len(_STEPS)))]
    wide = round(2.0 * radius, 2)
    narrow = round(wide * rng.uniform(0.4, 0.75), 2)
    step, low = round(-depth * rng.uniform(0.3, 0.7), 2), round(-depth, 2)
    side = f"square {block:.1f}"
    bores = (f"{word} {narrow + 2 * gap:.3f}", f"{word} {wide + 2 * gap:.3f}")
    fixture = [
        {"outline": side, "cutouts": [bores[0]], "z": [low, step]},
        {"outline": side, "cutouts": [bores[1]], "z": [step, 0.0]},
    ]
    if not is_through:
        fixture.append({"outline": side, "z": [low - 10.0, low]})
    top = round(max(above, 30.0), 2)
    held = [
        {"outline": f"{word} {narrow}", "z": [low, step]},
        {"outline": f"{word} {wide}", "z": [step, top]},
    ]
    return {
        "units": "mm",
        "gap": round(gap, 3),
        "held": {"shapes": held},
        "fixture": {"shapes": fixture},
    }


def _cap(
    rng: np.random.Generator, radius: float, depth: float, gap: float, above: float
) -> dict[str, Any]:
    """Draw a cap and its post on a plate, all in mm; `radius` is the cap's."""
    word = _STEPS[int(rng.integers(len(_STEPS)))]
    wide = round(2.0 * radius, 2)
    post = round(wide * rng.uniform(0.45, 0.75) - 2.0 * gap, 2)
    low, side = round(-depth, 2), round(2.0 * (radius + _between(rng, _WALL)), 1)
    bore = f"{word} {post + 2.0 * gap:.3f}"
    return {
        "units": "mm",
        "gap": round(gap, 3),
        "held": {
            "shapes": [
                {"outline": f"{word} {wide}", "cutouts": [bore], "z": [low, _ROOF]},
                {"outline": f"{word} {wide}", "z": [_ROOF, round(max(above, 30.0), 2)]},
            ]
        },
        "fixture": {
            "shapes": [
                {"outline": f"{word} {post}", "z": [low, 0.0]},
                {"outline": f"square {side}", "z": [low - _BASE, low]},
            ]
        },
    }


def _pins(
    rng: np.random.Generator, radius: float, depth: float, gap: float, above: float
) -> dict[str, Any]:
    """Draw a plug with several pins, all in mm; `radius` is around the pins."""
    count = int(rng.integers(*_PIN_COUNTS))
    own = radius * _between(rng, _PIN_SHARE)
    low = -round(min(depth, _SLENDEREST * own), 2)
    turn = rng.uniform(0.0, 2.0 * np.pi) + rng.uniform(-0.2, 0.2, count)
    angles = 2.0 * np.pi * np.arange(count) / count + turn
    out = (radius - own) * rng.uniform(0.8, 1.0, count)
    places = np.stack([out * np.cos(angles), out * np.sin(angles)], axis=1)
    if rng.random() < 0.5:
        word, sides = f"circle {2.0 * own:.2f}", _ROUND
    else:
        word, sides = f"square {2.0 * own / math.sqrt(2.0):.2f}", 4
    half = float(word.split()[1]) / 2.0 + gap  # from an opening's middle to its sides
    corner = np.pi * (2.0 * np.arange(sides) + 1.0) / sides
    around = np.stack([np.cos(corner), np.sin(corner)], axis=1)
    around *= half / math.cos(math.pi / sides)
    side = f"square {2.0 * (radius + _between(rng, _WALL)):.1f}"
    pins = [
        {"outline": word, "at": np.round(at, 3).tolist(), "z": [low, 1.0]}
        for at in places
    ]
    body = {
        "outline": f"circle {2.0 * radius + 2.0:.2f}",
        "z": [1.0, round(max(above, 30.0), 2)],
    }
    openings = [np.round(np.round(at, 3) + around, 3).tolist() for at in places]
    plate = {"outline": side, "cutouts": openings, "z": [low, 0.0]}
    floor = {"outline": side, "z": [low - _BASE, low]}
    return {
        "units": "mm",
        "gap": round(gap, 3),
        "held": {"shapes": [*pins, body]},
        "fixture": {"shapes": [plate, floor]},
    }


def _outline(rng: np.random.Generator, kind: str, radius: float) -> Any:
    """Draw an outline inside a circle of this radius [mm]."""
    if kind in ("round", "pin"):
        return f"circle {2.0 * radius:.2f}"
    if kind == "polygon":
        sides = int(rng.integers(3, 9))
        across = 2.0 * radius * math.cos(math.pi / sides)
        return f"polygon {sides} {across:.2f}"
    make = {"d": _d, "key": _key, "plus": _plus, "oval": _oval, "convex": _convex}
    return np.round(make[kind](rng, radius), 3).tolist()


def _d(rng: np.random.Generator, radius: float) -> Array:
    """Return a circle with a flat side."""
    half = math.acos(rng.uniform(0.3, 0.8))
    return radius * _arc(half, 2.0 * math.pi - half)


def _key(rng: np.random.Generator, radius: float) -> Array:
    """Return a circle with a key on it."""
    inner = radius / rng.uniform(1.15, 1.35)
    half = inner * rng.uniform(0.2, 0.45)
    angle = math.asin(half / inner)
    key = [[radius, -half], [radius, half]]
    return np.vstack([key, inner * _arc(angle, 2.0 * math.pi - angle)])


def _plus(rng: np.random.Generator, radius: float) -> Array:
    """Return a cross."""
    half = radius * rng.uniform(0.25, 0.45)
    out = math.sqrt(radius**2 - half**2)
    arm = np.array([[out, -half], [out, half], [half, half]])
    turns = [np.array([[c, s], [-s, c]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    return np.vstack([arm @ turn for turn in turns])


def _oval(rng: np.random.Generator, radius: float) -> Array:
    """Return two half circles and two straight sides."""
    end = radius * rng.uniform(0.3, 0.8)
    right = end * _arc(-math.pi / 2.0, math.pi / 2.0) + [radius - end, 0.0]
    return np.vstack([right, -right])


def _convex(rng: np.random.Generator, radius: float) -> Array:
    """Return a convex outline with its corners on an ellipse, turned."""
    count = int(rng.integers(4, 8))
    share = np.cumsum(rng.uniform(0.6, 1.4, count))
    angles = 2.0 * np.pi * share / share[-1]
    flat, turn = rng.uniform(0.5, 1.0), rng.uniform(0.0, 2.0 * np.pi)
    points = radius * np.stack([np.cos(angles), flat * np.sin(angles)], axis=1)
    c, s = math.cos(turn), math.sin(turn)
    return points @ np.array([[c, s], [-s, c]])


def _arc(first: float, last: float) -> Array:
    """Return points on the unit circle, from one angle to another [rad]."""
    angles = np.linspace(first, last, math.ceil((last - first) / _ARC) + 1)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _between(rng: np.random.Generator, span: tuple[float, float]) -> float:
    return float(rng.uniform(*span))


def _toml(table: Mapping[str, Any]) -> str:
    """Return a table as TOML, each key on a line."""
    return "".join(f"{key} = {_value(value)}\n" for key, value in table.items())


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key} = {_value(one)}" for key, one in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value)
