"""Output folders and files that are either whole or absent."""

import os
import stat
import tempfile
from datetime import datetime
from pathlib import Path
from typing import IO

from dovetail.errors import ConfigError, LogError


def require_empty(folder: Path, option: str = "--out") -> None:
    """Refuse a folder for results that holds something.

    Args:
        folder: To write into.
        option: That names it, for the message.

    Raises:
        ConfigError: It is a file, or not empty.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigError(
            f"the output folder {folder} is a file; choose another {option}"
        )
    if folder.is_dir() and (first := next(folder.iterdir(), None)) is not None:
        raise ConfigError(
            f"the output folder {folder} is not empty (it holds {first.name}); "
            f"choose another {option} or remove it"
        )


def require_writable(folder: Path, option: str) -> None:
    """Refuse a folder, which need not exist, into which nothing can be written.

    Args:
        folder: To write into, later.
        option: That names it, for the message.

    Raises:
        ConfigError: Says why.
    """
    there = folder.expanduser().absolute()
    while not there.exists():
        there = there.parent
    try:
        tempfile.TemporaryFile(dir=there).close()
    except OSError as error:
        raise ConfigError(
            f"nothing can be written into {folder}: {error.strerror}; choose another "
            f"{option}"
        ) from error


def claim_output_folder(path: str | Path) -> Path:
    """Create the folder for a run's results, refusing one that holds something.

    Args:
        path: Folder to write into; parents are created.

    Returns:
        The folder, absolute, existing and empty.

    Raises:
        ConfigError: the path is a file, or a folder that is not empty.
    """
    folder = Path(path).expanduser().absolute()
    require_empty(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f"cannot create the output folder {folder}: {error.strerror}"
        ) from error
    return folder


def dated_folder(parent: str, name: str = "") -> Path:
    """Return the path of a new folder by the time, for who does not name one."""
    now = datetime.now().astimezone()
    return Path(parent) / f"{name}{now:%Y-%m-%d_%H%M%S}"


def write_atomic(path: Path, data: bytes | str) -> Path:
    """Write a file beside its place and rename it there.

    A reader, or a crash at any moment, sees the old file or the new one, never
    a part of one.

    Args:
        path: File to write; its folder exists.
        data: Content; text is written as UTF-8.

    Returns:
        `path`.

    Raises:
        LogError: The disk is full or the folder is not writable.
    """
    content = data.encode() if isinstance(data, str) else data
    beside = None
    try:
        with tempfile.NamedTemporaryFile(
            dir=path.parent, prefix=f".{path.name}.", delete=False
        ) as file:
            beside = Path(file.name)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.chmod(0o644)
        beside.replace(path)
    except OSError as error:
        if beside is not None:
            beside.unlink(missing_ok=True)
        raise LogError(
            f"cannot write {path} ({len(content)} bytes): {error.strerror}; "
            "free some space or choose another --out"
        ) from error
    return path


def open_lock(path: Path) -> IO[str]:
    """Open a file to lock it; its content stays as it is.

    In a folder that a stranger has made it may be a link, which would lead to another
    file, or a pipe, which would wait: these are refused.

    Raises:
        ConfigError: It is no regular file, or cannot be opened; says which.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        file = os.fdopen(os.open(path, flags, 0o644), "r+")
    except OSError as error:
        raise ConfigError(f"cannot lock {path}: {error.strerror}") from error
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise ConfigError(f"cannot lock {path}: it is not a regular file; remove it")
    return file


def require_new(path: str | Path) -> Path:
    """Return the path of a file that is to be written and is not there yet.

    Raises:
        ConfigError: It is there, or its folder is not.
    """
    file = Path(path).expanduser()
    if file.exists():
        raise ConfigError(f"{file} is there and stays; choose another --out")
    if not file.absolute().parent.is_dir():
        raise ConfigError(f"the folder of {file} does not exist; make it first")
    return file
