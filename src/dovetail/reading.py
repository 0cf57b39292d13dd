"""Files that others may have made: read if regular, and bounded in size and depth."""

import errno
import json
import os
import re
import stat
import tomllib
from io import BufferedReader
from pathlib import Path
from typing import Any

from dovetail.errors import ConfigError

TEXT_BYTES = 8_000_000
"""Largest JSON or table file that is read [bytes]: 2 s and 300 MB at worst."""
TOML_BYTES = 300_000
"""Largest TOML file that is read [bytes]: a second of tomllib at worst."""
DEPTH = 32
"""Deepest nesting of tables and lists in a settings file."""
_DOTS = 100
"""Most dots in a line of TOML, those of an array's numbers not counted."""
_ARRAY_NUMBER = re.compile(r"(?<=[\[,\s])[-+]?\d+\.\d+(?:[eE][-+]?\d+)?(?=\s*[,\]}])")
"""A number in a TOML array; in a dotted key only text between quotes looks like it."""


def open_regular(path: str | Path, limit: int) -> BufferedReader:
    """Open a regular file of at most `limit` bytes.

    Devices, pipes and sockets are refused without reading from them, so a link to
    /dev/zero or a named pipe where a file is expected cannot block or fill memory.

    Args:
        path: File to read; links are followed.
        limit: Largest size [bytes].

    Raises:
        OSError: The file cannot be opened, is not a regular file, or is larger than
            `limit`; `strerror` says which.
    """
    # O_NONBLOCK: opening a named pipe that has no writer would wait for one
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    file = os.fdopen(handle, "rb")
    try:
        status = os.fstat(file.fileno())
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file", str(path))
        _require_size(status.st_size, limit, path)
    except BaseException:
        file.close()
        raise
    return file


def read_bytes(path: str | Path, limit: int) -> bytes:
    """Read a regular file of at most `limit` bytes; see `open_regular`.

    Raises:
        OSError: As `open_regular`.
    """
    with open_regular(path, limit) as file:
        content = file.read(limit + 1)
    _require_size(len(content), limit, path)  # it may have grown meanwhile
    return content


def _require_size(size: int, limit: int, path: str | Path) -> None:
    if size > limit:
        raise OSError(
            errno.EFBIG, f"it has {size} bytes; allowed: up to {limit}", str(path)
        )


def read_text(path: str | Path, limit: int = TEXT_BYTES) -> str:
    """Read a regular UTF-8 file of at most `limit` bytes.

    Raises:
        OSError: As `open_regular`.
        UnicodeDecodeError: The content is not UTF-8.
    """
    return read_bytes(path, limit).decode("utf-8")


def read_toml(path: str | Path, limit: int = TOML_BYTES) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        OSError: As `open_regular`.
        ConfigError: The content is not TOML, is nested deeper than `DEPTH`, or has an
            integer of more than 64 bits.
    """
    try:
        text = read_text(path, limit)
        # tomllib takes time and memory that grow with the square of a dotted key
        for number, line in enumerate(text.split("\n"), 1):
            if line.count(".") > _DOTS < _ARRAY_NUMBER.sub("", line).count("."):
                raise ValueError(f"line {number} has more than {_DOTS} dots")
        table = tomllib.loads(text)
        _require_plain(table)
    except (ValueError, RecursionError) as error:  # a long integer is a ValueError
        raise ConfigError(f"{path} is not TOML: {error}") from error
    return table


def read_json(path: str | Path, limit: int = TEXT_BYTES) -> Any:
    """Read a JSON file.

    Raises:
        OSError: As `open_regular`.
        ConfigError: As `parse_json`, or the content is not UTF-8.
    """
    content = read_bytes(path, limit)
    return parse_json(content, str(path))


def parse_json(content: str | bytes, name: str, *, is_finite: bool = False) -> Any:
    """Read JSON text.

    Args:
        content: Text, or UTF-8.
        name: Where it comes from, for the message.
        is_finite: Whether NaN and Infinity are refused, which JSON does not have.

    Raises:
        ConfigError: It is not JSON, is nested deeper than `DEPTH`, or has an integer
            of more than 64 bits, or text that is not Unicode.
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8")
        value = json.loads(text, parse_constant=_refuse if is_finite else float)
        _require_plain(value)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{name} is not JSON: {error}") from error
    return value


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _require_plain(value: Any) -> None:
    """Refuse what JSON and TOML readers let pass and later code cannot handle.

    Deep nesting ends in a RecursionError, a long integer cannot be printed or become a
    float, and half of a surrogate pair cannot be written.
    """
    level, depth = [value], 0
    while level:
        below: list[Any] = []
        for item in level:
            if isinstance(item, dict | list):
                if depth > DEPTH:
                    raise ValueError(f"it is nested deeper than {DEPTH} levels")
                if isinstance(item, dict):
                    below.extend(item)
                    below.extend(item.values())
                else:
                    below.extend(item)
            elif isinstance(item, str):
                item.encode()
            elif isinstance(item, int) and not -(2**63) <= item < 2**64:
                raise ValueError("an integer has more than 64 bits")
        level = below
        depth += 1
