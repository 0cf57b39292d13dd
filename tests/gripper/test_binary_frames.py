"""Frames of the binary protocol, by published vectors."""

import pytest

from dovetail.errors import ConfigError
from dovetail.gripper.binary_frames import (
    PREAMBLE,
    Frame,
    FrameReader,
    crc16,
    encode,
)

VECTORS = [
    ("AAAAAA010000", "E810"),
    ("AAAAAA0102001234", "6D66"),
    ("AAAAAA2002000000", "B3FD"),
    ("AAAAAA2102001A00", "67CB"),
    ("AAAAAA2102000000", "2804"),
    ("AAAAAA300600000000001643", "DCCB"),
]


def frame_of(body):
    data = bytes.fromhex(body)
    return Frame(data[3], data[6:])


def test_the_crc_of_the_preamble():
    assert crc16(PREAMBLE) == 0x50F5


@pytest.mark.parametrize(("body", "crc"), VECTORS)
def test_published_frames_both_ways(body, crc):
    data = bytes.fromhex(body + crc)
    assert encode(frame_of(body)) == data
    assert crc16(data) == 0
    assert list(FrameReader().feed(data)) == [frame_of(body)]


def test_frames_come_out_however_they_are_cut():
    frames = [frame_of(body) for body, _ in VECTORS]
    data = b"".join(map(encode, frames))
    for size in (1, 2, 5, len(data)):
        reader = FrameReader()
        found = []
        for start in range(0, len(data), size):
            found += reader.feed(data[start : start + size])
        assert found == frames
        assert reader.num_skipped == 0


def test_garbage_and_damaged_frames_are_skipped():
    good = encode(Frame(0x40, b"\x01\x02"))
    bad = bytearray(good)
    bad[7] ^= 0x10
    huge = PREAMBLE + b"\x40\xff\xff"
    reader = FrameReader()
    data = b"noise\xaa\xaa" + bytes(bad) + huge + b"\xaa" + good
    assert list(reader.feed(data)) == [Frame(0x40, b"\x01\x02")]
    assert reader.num_skipped == len(data) - len(good)


def test_random_bytes_never_raise(rng):
    reader = FrameReader()
    for _ in range(300):
        data = rng.integers(0, 256, 64, dtype="u1")
        data[rng.random(64) < 0.3] = 0xAA
        list(reader.feed(data.tobytes()))


@pytest.mark.parametrize(
    "frame", [Frame(256, b""), Frame(-1, b""), Frame(1, b"x" * 1025)]
)
def test_what_does_not_fit_a_frame_is_refused(frame):
    with pytest.raises(ConfigError, match="gripper frame"):
        encode(frame)
