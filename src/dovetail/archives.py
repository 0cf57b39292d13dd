"""ZIP and NPZ files that others may have made: sizes are checked before they are used.

A ZIP file of a few megabytes can declare, or unpack to, any number of gigabytes. So the
members' declared sizes and an array's shape are held against a limit first, and no more
is unpacked than was declared.
"""

import math
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile

import numpy as np

from dovetail.reading import open_regular

_MEMBERS = 1000
"""Most members: Python takes a kilobyte for each, before anything is read."""
_ENTRY = b"PK\x01\x02"
"""Begins a member's entry in a ZIP file's directory."""
_PIECE = 1 << 20
_VERSIONS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


@contextmanager
def open_zip(path: str | Path, limit: int) -> Iterator[ZipFile]:
    """Open a ZIP file that has at most `limit` bytes, packed and unpacked.

    Raises:
        OSError: As `dovetail.reading.open_regular`.
        ValueError: It is not a ZIP file, has too many members or is larger unpacked.
    """
    with open_regular(path, limit) as file:
        _require_few_members(file)
        try:
            archive = ZipFile(file)
        except (BadZipFile, RuntimeError) as error:
            raise ValueError(f"it is not a ZIP file: {error}") from error
        size = sum(info.file_size for info in archive.infolist())
        if size > limit:
            raise ValueError(f"it unpacks to {size} bytes; allowed: up to {limit}")
        yield archive


def _require_few_members(file: IO[bytes]) -> None:
    count, tail = 0, b""
    while piece := file.read(_PIECE):
        count += (tail + piece).count(_ENTRY)
        tail = piece[1 - len(_ENTRY) :]
    if count > _MEMBERS:
        raise ValueError(f"it has {count} members; allowed: up to {_MEMBERS}")
    file.seek(0)


@contextmanager
def open_member(archive: ZipFile, name: str) -> Iterator[IO[bytes]]:
    """Open a member of a ZIP file for reading.

    Read it by sizes: `read()` of all unpacks more than was declared.

    Raises:
        ValueError: There is no such member, or it is packed in a way that needs any
            amount of memory, or encrypted.
    """
    names = archive.namelist()
    if names.count(name) != 1:
        found = ", ".join(names)[:200] or "nothing"
        raise ValueError(f"it has {names.count(name)} members {name}; it has {found}")
    info = archive.getinfo(name)
    if info.compress_type not in (ZIP_STORED, ZIP_DEFLATED) or info.flag_bits & 1:
        raise ValueError(
            f"{name} is encrypted or packed by another method than deflate"
        )
    try:
        with archive.open(info) as member:
            yield member
    except (BadZipFile, EOFError, RuntimeError, zlib.error) as error:
        raise ValueError(f"{name} is damaged: {error}") from error


def read_member(archive: ZipFile, name: str, limit: int) -> bytes:
    """Read a member of a ZIP file.

    Raises:
        ValueError: As `open_member`, or it has more than `limit` bytes.
    """
    with open_member(archive, name) as member:
        size = archive.getinfo(name).file_size
        if size > limit:
            raise ValueError(f"{name} has {size} bytes; allowed: up to {limit}")
        return member.read(size)


def read_array(
    archive: ZipFile, name: str, limit: int = sys.maxsize
) -> np.ndarray[Any, Any]:
    """Read an array of an NPZ file, of numbers or text.

    Args:
        archive: What `open_zip` gave, which has a limit for all arrays together.
        name: The array's name, without .npy.
        limit: Largest size [bytes].

    Raises:
        ValueError: As `open_member`; or it is no array of numbers or text, has another
            size than it declares, or is larger than the limit.
    """
    place = f"{name}.npy"
    with open_member(archive, place) as member:
        shape, kind, begin = read_array_header(member)
    size = archive.getinfo(place).file_size
    if size > limit:
        raise ValueError(f"the array {name} has {size} bytes; allowed: up to {limit}")
    if begin + math.prod(shape) * kind.itemsize != size:
        raise ValueError(
            f"the array {name} has shape {str(shape)[:80]} of {kind}, for which "
            f"{size} bytes are not right"
        )
    with open_member(archive, place) as member:
        return np.lib.format.read_array(member, allow_pickle=False)


def read_array_header(
    member: IO[bytes],
) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Return the shape and type that an NPY file declares, and where its numbers begin.

    Raises:
        ValueError: It is no NPY file, or not of plain numbers or text.
    """
    try:
        version = np.lib.format.read_magic(member)
        if version not in _VERSIONS:
            raise ValueError(f"it has NPY version {version}")
        shape, _, kind = _VERSIONS[version](member)
    except (SyntaxError, TypeError, RecursionError, MemoryError) as error:
        raise ValueError(f"its NPY header is damaged: {error}") from error
    if kind.kind not in "biufU" or kind.itemsize == 0 or kind.subdtype is not None:
        raise ValueError(
            f"it is an array of {str(kind)[:80]}; numbers or text are read"
        )
    if any(type(length) is not int or length < 0 for length in shape):
        raise ValueError(f"an array has the shape {str(shape)[:80]}")
    return shape, kind, member.tell()
