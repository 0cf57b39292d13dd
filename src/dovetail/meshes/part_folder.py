"""A converted pair as a part.toml, with a file for each part beside it."""

import json
from pathlib import Path
from typing import Any

from dovetail.errors import ConfigError
from dovetail.files import write_atomic
from dovetail.meshes.conversion import Conversion
from dovetail.meshes.slabs import Slab
from dovetail.reading import TOML_BYTES
from dovetail.types import Array

FILES = {"held": "plug.toml", "fixture": "socket.toml"}
"""Files of the two parts, beside part.toml."""
_DIGITS = 4  # of a length in mm: 0.1 um


def write_part(conversion: Conversion, folder: str | Path) -> Path:
    """Write a pair that `dovetail train --part` and the other commands take.

    Each file is whole or absent, and part.toml, which names the others, is last.

    Args:
        conversion: The pair.
        folder: Where; it is made if it is not there. Files of these names are replaced.

    Returns:
        The part.toml.

    Raises:
        ConfigError: A file would be larger than is read.
        LogError: The folder is not writable.
    """
    place = Path(folder).expanduser()
    texts = part_texts(conversion)
    for name, text in texts.items():
        if len(text) > TOML_BYTES:
            raise ConfigError(
                f"{name} of this pair has {len(text)} bytes; allowed: up to "
                f"{TOML_BYTES}. Give meshes with fewer triangles, or leave out what is "
                "not near the way in"
            )
    place.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write_atomic(place / name, text)
    return place / "part.toml"


def part_table(conversion: Conversion) -> dict[str, Any]:
    """Return a pair as `read_pair` takes it, as JSON."""
    return {
        "name": conversion.name,
        "units": "mm",
        "gap": _mm(conversion.gap.median),
        "held": {
            "density": conversion.density,
            "shapes": [_shape(slab) for slab in conversion.held_slabs()],
        },
        "fixture": {"shapes": [_shape(slab) for slab in conversion.fixture]},
    }


def part_texts(conversion: Conversion) -> dict[str, str]:
    """Return the content of each file by its name, part.toml last."""
    table = part_table(conversion)
    texts = {file: _toml({"units": "mm"} | table[key]) for key, file in FILES.items()}
    table["held"], table["fixture"] = FILES["held"], FILES["fixture"]
    return texts | {"part.toml": _toml(table)}


def _toml(table: dict[str, Any]) -> str:
    """Return a table as TOML: strings, numbers, and a list of inline tables."""
    lines = []
    for key, value in table.items():
        if isinstance(value, list):
            shapes = "".join(f"  {_inline(one)},\n" for one in value)
            lines.append(f"{key} = [\n{shapes}]\n")
        else:
            lines.append(f"{key} = {json.dumps(value)}\n")
    return "".join(lines)


def _inline(table: dict[str, Any]) -> str:
    """Return a table in one line; JSON's strings and numbers are TOML's, too."""
    return "{ " + ", ".join(f"{k} = {json.dumps(v)}" for k, v in table.items()) + " }"


def _shape(slab: Slab) -> dict[str, Any]:
    """Return a slab as a shape of a part file: its outline is an SVG path."""
    path = " ".join(f"M {_numbers(line)}, Z" for line in (slab.outer, *slab.cutouts))
    shape: dict[str, Any] = {"outline": path, "z": [_mm(slab.low), _mm(slab.high)]}
    if slab.lean is not None:
        shape["lean"] = [[_mm(x), _mm(y)] for x, y in slab.lean.tolist()]
    return shape


def _numbers(line: Array) -> str:
    return ", ".join(repr(_mm(length)) for length in line.ravel().tolist())


def _mm(length: float) -> float:
    """Return a length in mm, as it is written."""
    return round(1e3 * length, _DIGITS) + 0.0
