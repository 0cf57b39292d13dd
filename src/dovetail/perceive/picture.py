"""A picture file as grey values, pixel for pixel as the sensor wrote them."""

import io
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dovetail.errors import ConfigError
from dovetail.reading import read_bytes

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")
"""Ends of the names of picture files."""
PIXELS_MAX = 64_000_000
"""Most pixels of a picture that is decoded."""
BYTES_MAX = 4 * PIXELS_MAX + 1_000_000
"""Largest picture file [bytes]: four channels, uncompressed."""
_FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "PPM")
_TURN = Image.Transpose
_UNTURNED = {
    2: _TURN.FLIP_LEFT_RIGHT,
    3: _TURN.ROTATE_180,
    4: _TURN.FLIP_TOP_BOTTOM,
    5: _TURN.TRANSPOSE,
    6: _TURN.ROTATE_90,
    7: _TURN.TRANSVERSE,
    8: _TURN.ROTATE_270,
}
"""Takes back the turn that an orientation in the header asks for."""


def read_picture(file: Path) -> NDArray[np.uint8]:
    """Read a picture's grey values, shape (height, width).

    An orientation in the header is ignored: a lens is calibrated for the sensor's
    pixels, and a turned picture has its centre elsewhere. The size in the header is
    checked before anything is decoded. Colour becomes luma; of 16 bits the upper 8
    stay.

    Raises:
        ConfigError: It cannot be read, is no picture or a damaged one, is too large, or
            has values that are neither 8 nor 16 bits.
    """
    try:
        content = read_bytes(file, BYTES_MAX)
    except OSError as error:
        raise ConfigError(f"{file} cannot be read: {error.strerror}") from error
    with warnings.catch_warnings():
        # Pillow warns of large pictures and odd headers; size is checked here
        warnings.simplefilter("ignore")
        try:
            return _decode(content)
        except ConfigError as error:
            raise ConfigError(f"{file} {error}") from error
        except Exception as error:  # Pillow raises anything at a damaged file
            raise ConfigError(
                f"{file} is no picture of the kinds {' '.join(SUFFIXES)}, or is "
                f"damaged: {_reason(error)}"
            ) from error


def _decode(content: bytes) -> NDArray[np.uint8]:
    with Image.open(io.BytesIO(content), formats=_FORMATS) as image:
        width, height = image.size
        if not 0 < width * height <= PIXELS_MAX:
            raise ConfigError(
                f"has {width} x {height} pixels; allowed: 1 to "
                f"{PIXELS_MAX // 1_000_000} million"
            )
        # Pillow turns a TIFF by its header, and no other kind
        turned = image.getexif().get(0x0112, 1) if image.format == "TIFF" else 1
        if image.format == "JPEG":
            image.draft("L", image.size)  # luma as it is stored
        image.load()
        if turned in _UNTURNED:
            image = image.transpose(_UNTURNED[turned])
        if image.mode.startswith("I;16"):
            return (np.asarray(image) >> 8).astype(np.uint8)
        if image.mode in ("I", "F"):
            raise ConfigError("has values of 32 bits; save it with 8 or 16")
        return np.array(image.convert("L"))


def _reason(error: Exception) -> str:
    if isinstance(error, Image.UnidentifiedImageError):
        return "its header is of none of them"
    return str(error) or type(error).__name__
