"""The file of a part as one text that names no other file: what a policy carries."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dovetail.errors import ConfigError
from dovetail.reading import read_toml

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}
"""Units of a file's lengths [m]."""
BOTH = ("held", "fixture")
"""The two parts of a pair; a file may name a file for each."""
TEXT_MAX = 1_000_000
"""Longest definition [characters]."""
_NAME_MAX = 40
"""Longest name of a part [characters]."""
_COMMON = "part"
"""Stem of a file that lies in a folder of its own, which names it."""
_DEEPEST = 4
"""Most files that name one another."""


def is_whole(text: str) -> bool:
    """Say whether a text is a definition, and not the path of one."""
    return text.lstrip().startswith("{")


def whole_part(path: str | Path) -> str:
    """Return the definition in a file, and in the files that it names.

    Args:
        path: A TOML file, or a definition already, which is returned as it is.

    Raises:
        ConfigError: A file cannot be read, is not TOML, or names itself; it has a value
            that is no number, text, list or table.
    """
    if isinstance(path, str) and is_whole(path):
        return require_whole(path)
    file = Path(path).expanduser()
    table = _read(file, ())
    own = file.absolute().parent.name if file.stem == _COMMON else file.stem
    table.setdefault("name", own[:_NAME_MAX])
    try:
        text = json.dumps(table, allow_nan=False, separators=(", ", ": "))
    except ValueError as error:
        raise ConfigError(
            f"{file} has a number that is NaN or infinite; give finite numbers"
        ) from error
    except TypeError as error:
        raise ConfigError(
            f"{file} has a date or a time; give numbers, texts, lists and tables"
        ) from error
    return require_whole(text)


def read_name(table: Mapping[str, Any]) -> str:
    """Return the name of a part.

    Raises:
        ConfigError: It is no short text.
    """
    name = table.get("name", "part")
    if not isinstance(name, str) or not name.isprintable() or len(name) > _NAME_MAX:
        raise ConfigError(
            f"name is {str(name)[:60]!r}; give a text of up to {_NAME_MAX} characters"
        )
    return name


def require_whole(text: str) -> str:
    """Return a definition, or refuse a text that is none.

    Raises:
        ConfigError: It is a path, or too long.
    """
    if not is_whole(text):
        raise ConfigError(
            f"part is {text[:80]!r}, a path; needed: the part itself, as a training "
            "writes it into its policy"
        )
    if len(text) > TEXT_MAX:
        raise ConfigError(
            f"the part has {len(text)} characters; allowed: up to {TEXT_MAX}"
        )
    return text


def _read(path: Path, above: tuple[Path, ...]) -> dict[str, Any]:
    """Return a file's table, the files that it names in their places."""
    try:
        here = path.resolve(strict=True)
    except FileNotFoundError as error:
        raise ConfigError(
            f"there is no part {str(path)!r}; give the path of a TOML file, see "
            "docs/your-own-part.md",
            name="part",
            value=str(path),
        ) from error
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a NUL
        reason = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(f"cannot read the part {str(path)!r}: {reason}") from error
    if here in above or len(above) >= _DEEPEST:
        chain = " -> ".join(one.name for one in (*above, here))
        raise ConfigError(
            f"{above[0]} names itself: {chain}; a part file names files of single parts"
        )
    try:
        table = read_toml(path)
    except OSError as error:
        raise ConfigError(f"cannot read the part {path}: {error.strerror}") from error
    for key in BOTH:
        if isinstance(named := table.get(key), str):
            table[key] = _read(path.parent / named, (*above, here))
    return table
