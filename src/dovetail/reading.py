"""Files that others may have made: read if regular, and bounded in size and depth."""

import errno
import json
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from dovetail.errors import ConfigError

TEXT_BYTES = 16_000_000
"""Largest settings or table file that is read [bytes]."""
DEPTH = 32
"""Deepest nesting of tables and lists in a settings file."""
_PARTS = re.compile(r"[=,{}\[\]\n]")
"""Characters that end a key of TOML."""


def read_bytes(path: str | Path, limit: int) -> bytes:
    """Read a regular file of at most `limit` bytes.

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
    with os.fdopen(handle, "rb") as file:
        status = os.fstat(file.fileno())
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file", str(path))
        content = file.read(limit + 1) if status.st_size <= limit else b""
        size = max(status.st_size, len(content))
    if size > limit:
        raise OSError(
            errno.EFBIG, f"it has {size} bytes; allowed: up to {limit}", str(path)
        )
    return content


def read_text(path: str | Path, limit: int = TEXT_BYTES) -> str:
    """Read a regular UTF-8 file of at most `limit` bytes.

    Raises:
        OSError: As `read_bytes`.
        UnicodeDecodeError: The content is not UTF-8.
    """
    return read_bytes(path, limit).decode("utf-8")


def read_toml(path: str | Path, limit: int = 1_000_000) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        OSError: As `read_bytes`.
        ConfigError: The content is not TOML, or is nested deeper than `DEPTH`.
    """
    try:
        text = read_text(path, limit)
        # tomllib takes time that grows with the square of a dotted key's length
        if any(part.split("#")[0].count(".") > DEPTH for part in _PARTS.split(text)):
            raise ValueError(f"a dotted key has more than {DEPTH} parts")
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a long integer is a ValueError
        raise ConfigError(f"{path} is not TOML: {error}") from error
    _require_shallow(table, path)
    return table


def read_json(path: str | Path, limit: int = TEXT_BYTES) -> Any:
    """Read a JSON file.

    Raises:
        OSError: As `read_bytes`.
        ConfigError: The content is not JSON, or is nested deeper than `DEPTH`.
    """
    try:
        value = json.loads(read_bytes(path, limit))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path} is not JSON: {error}") from error
    _require_shallow(value, path)
    return value


def _require_shallow(value: Any, path: str | Path) -> None:
    level, depth = [value], 0
    while level:
        if depth > DEPTH:
            raise ConfigError(f"{path} is nested deeper than {DEPTH} levels")
        level = [
            item
            for holder in level
            if isinstance(holder, dict | list)
            for item in (holder.values() if isinstance(holder, dict) else holder)
            if isinstance(item, dict | list)
        ]
        depth += 1
