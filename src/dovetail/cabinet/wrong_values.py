"""The fault that real clients suffer from most: another number of joint values.

KUKA's client shifts every later message by one joint after one with six values, and
the codec refuses to write such a message; so a finished datagram is rewritten.
"""

import struct
import zlib
from collections.abc import Iterator

_MONITOR_DATA, _IPO_DATA = 3, 5
_VALUE_SIZE = 9  # a tag byte and a double
_TAG = 0x09


def with_joint_values(datagram: bytes, count: int, *, is_framed: bool) -> bytes:
    """Return a monitoring datagram with another number of values per joint array.

    Args:
        datagram: As the codec wrote it, with seven.
        count: How many it shall carry.
        is_framed: It has 2.7's length and checksum around it.
    """
    if not is_framed:
        return _resize_message(datagram, count)
    message = _resize_message(datagram[4:-4], count)
    size, checksum = struct.pack("<I", len(message)), zlib.crc32(message)
    return size + message + struct.pack("<I", checksum)


def _resize_message(message: bytes, count: int) -> bytes:
    parts = []
    for key, body, raw in _fields(message):
        if key >> 3 in (_MONITOR_DATA, _IPO_DATA) and body is not None:
            inner = b"".join(_resize_array(*field, count) for field in _fields(body))
            parts.append(_varint(key) + _varint(len(inner)) + inner)
        else:
            parts.append(raw)
    return b"".join(parts)


def _resize_array(key: int, body: bytes | None, raw: bytes, count: int) -> bytes:
    if body is None or len(body) != 7 * _VALUE_SIZE or body[0] != _TAG:
        return raw
    values = (body + body[-_VALUE_SIZE:] * count)[: count * _VALUE_SIZE]
    return _varint(key) + _varint(len(values)) + values


def _fields(message: bytes) -> Iterator[tuple[int, bytes | None, bytes]]:
    """Yield key, content where it has a length, and the bytes of each field."""
    at = 0
    while at < len(message):
        start = at
        key, at = _read_varint(message, at)
        body = None
        if key & 7 == 2:
            size, at = _read_varint(message, at)
            body, at = message[at : at + size], at + size
        elif key & 7 == 1:
            at += 8
        else:
            _, at = _read_varint(message, at)
        yield key, body, message[start:at]


def _read_varint(message: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value, at


def _varint(value: int) -> bytes:
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*encoded, value])
