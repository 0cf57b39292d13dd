"""A picture file is read as the sensor wrote it, or refused in a sentence."""

import io
import os
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from dovetail.errors import ConfigError
from dovetail.perceive.picture import PIXELS_MAX, read_picture

ORIENTATION = 0x0112
GREY = np.zeros((48, 80), dtype=np.uint8)
GREY[8:24, 8:32] = 255  # in one corner: turned or mirrored it is elsewhere
GREY[:8, 64:] = 128


def png(width, height, depth=8, colour=0, data=b""):
    def chunk(kind, content):
        whole = kind + content
        return (
            struct.pack(">I", len(content))
            + whole
            + struct.pack(">I", zlib.crc32(whole))
        )

    header = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(data))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts) + chunk(b"IEND", b"")


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif"])
def test_an_orientation_in_the_header_turns_nothing(tmp_path, name, orientation):
    header = Image.Exif()
    header[ORIENTATION] = orientation
    path = tmp_path / name
    Image.fromarray(GREY).save(path, exif=header)
    found = read_picture(path)
    assert found.shape == GREY.shape
    assert np.abs(found.astype(int) - GREY).max() <= 20  # JPEG rounds


@pytest.mark.parametrize("mode", ["1", "P", "LA", "RGB", "RGBA"])
def test_every_usual_kind_of_pixel_becomes_grey(tmp_path, mode):
    Image.fromarray(GREY).convert("RGB").convert(mode).save(tmp_path / "a.png")
    found = read_picture(tmp_path / "a.png")
    assert found.dtype == np.uint8
    bright = found[8:24, 8:32]
    assert (bright.min(), found[40:, 40:].max()) == (255, 0)


def test_a_picture_for_print_becomes_grey(tmp_path):
    Image.fromarray(GREY).convert("CMYK").save(tmp_path / "a.jpg", quality=95)
    assert np.abs(read_picture(tmp_path / "a.jpg").astype(int) - GREY).max() <= 30


def test_of_16_bits_the_upper_8_stay(tmp_path):
    Image.fromarray(GREY.astype(np.uint16) << 8).save(tmp_path / "a.png")
    assert (read_picture(tmp_path / "a.png") == GREY).all()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("large.png", png(60_000, 60_000)),
        ("just_too_large.png", png(PIXELS_MAX // 1000 + 1, 1000)),
        ("negative.png", png(0xFFFFFFFF, 0xFFFFFFFF)),
        ("empty.png", png(0, 0)),
        ("no_pixels.png", png(80, 48)),
        ("odd_depth.png", png(80, 48, depth=7)),
        ("nothing.png", b""),
        ("text.jpg", b"no picture"),
        ("large.pgm", b"P5 60000 60000 255\n"),
        ("large.bmp", b"BM" + struct.pack("<IIIIiiHHI", 0, 0, 54, 40, 60000, 60000, 1,
                                          8, 0) + bytes(20)),
    ],
)  # fmt: skip
def test_what_is_no_picture_or_too_large_is_refused(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        read_picture(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF", "BMP"])
def test_a_file_that_was_cut_short_is_refused(tmp_path, kind):
    content = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 256, (200, 300), dtype=np.uint8)
    Image.fromarray(noise).save(content, kind)
    path = tmp_path / "a.png"
    for share in (0.01, 0.3, 0.7):
        path.write_bytes(content.getvalue()[: int(share * content.tell())])
        with pytest.raises(ConfigError):
            read_picture(path)


def test_a_file_of_32_bits_is_refused(tmp_path):
    Image.fromarray(GREY.astype(np.float32)).save(tmp_path / "a.tif")
    with pytest.raises(ConfigError, match="32 bits"):
        read_picture(tmp_path / "a.tif")


def test_what_is_no_regular_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "zero.png").symlink_to("/dev/zero")
    (tmp_path / "folder.png").mkdir()
    for name in ("pipe.png", "zero.png", "folder.png", "absent.png"):
        with pytest.raises(ConfigError):
            read_picture(tmp_path / name)
