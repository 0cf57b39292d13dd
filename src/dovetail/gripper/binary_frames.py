"""Frames of the gripper's binary protocol: preamble, id, size, payload, CRC.

For grippers whose text protocol is not to be had; the driver speaks text.
"""

from collections.abc import Iterator
from typing import NamedTuple

from dovetail.errors import ConfigError

PREAMBLE = b"\xaa\xaa\xaa"
PAYLOAD_MAX = 1024
"""Longest payload that is accepted [bytes]."""
_POLYNOMIAL = 0x1021
_HEAD, _TAIL = 6, 2


class Frame(NamedTuple):
    """One message."""

    id: int
    """Command, 0 to 255."""
    payload: bytes


def _table() -> tuple[int, ...]:
    entries = []
    for byte in range(256):
        value = byte << 8
        for _ in range(8):
            value = (value << 1) ^ (_POLYNOMIAL if value & 0x8000 else 0)
        entries.append(value & 0xFFFF)
    return tuple(entries)


_TABLE = _table()


def crc16(data: bytes) -> int:
    """Return the gripper's CRC: an MSB-first table, stepped the other way round.

    Over a whole frame, its CRC included, it is 0.
    """
    crc = 0xFFFF
    for byte in data:
        crc = _TABLE[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return crc


def encode(frame: Frame) -> bytes:
    """Return the bytes of a frame.

    Raises:
        ConfigError: The id or the payload's size is out of range.
    """
    if not 0 <= frame.id <= 0xFF or len(frame.payload) > PAYLOAD_MAX:
        raise ConfigError(
            f"gripper frame has id {frame.id} and {len(frame.payload)} bytes; allowed: "
            f"0 to 255, and up to {PAYLOAD_MAX} bytes"
        )
    size = len(frame.payload).to_bytes(2, "little")
    body = PREAMBLE + bytes([frame.id]) + size + frame.payload
    return body + crc16(body).to_bytes(2, "little")


class FrameReader:
    """Finds frames in bytes, however they are cut, and skips what is none."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.num_skipped = 0
        """Bytes that belonged to no frame."""

    def feed(self, data: bytes) -> Iterator[Frame]:
        """Take bytes; yield the frames that are whole."""
        self._buffer += data
        while (frame := self._next()) is not None:
            yield frame

    def _next(self) -> Frame | None:
        buffer = self._buffer
        while True:
            start = buffer.find(PREAMBLE)
            self._skip(start if start >= 0 else max(0, len(buffer) - 2))
            if start < 0 or len(buffer) < _HEAD:
                return None
            if buffer[3] == PREAMBLE[0]:  # no command has this id: a longer run of it
                self._skip(1)
                continue
            size = int.from_bytes(buffer[4:6], "little")
            end = _HEAD + size + _TAIL
            if size <= PAYLOAD_MAX and len(buffer) < end:
                return None
            if size > PAYLOAD_MAX or crc16(bytes(buffer[:end])) != 0:
                self._skip(1)
                continue
            frame = Frame(buffer[3], bytes(buffer[_HEAD : end - _TAIL]))
            del buffer[:end]
            return frame

    def _skip(self, count: int) -> None:
        self.num_skipped += count
        del self._buffer[:count]
