"""The printed board: markers in a ring round the fixture's opening, in true size.

Eight square markers of the family AprilTag 36h11, its middle cut out. The print lies on
the fixture, its middle over the origin of the fixture's frame, "x" along the frame's x.
"""

import io
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from dovetail.perceive.opencv import opencv
from dovetail.settings import Range, settings
from dovetail.types import Array

MARKERS = 8
"""Markers of a board: with half of them hidden the pose is still known."""
_IDS = 587  # of the family 36h11
_CELLS = 8  # along a marker, its black border included
_PLACES = ((-1, 1), (0, 1), (1, 1), (-1, 0), (1, 0), (-1, -1), (0, -1), (1, -1))
"""Middles of the markers, in steps of `pitch`: x, then y."""
_PAPER = (0.210, 0.297)  # A4 [m]
_DPI = 600
_INCH = 0.0254  # m


@settings(owner="board")
class Board:
    """Printed board of markers, and its place on the fixture."""

    first_id: Annotated[int, Range(0, _IDS - MARKERS, "1")] = 0
    """Number of its first marker; the others follow. Two boards in one cell differ."""
    side: Annotated[float, Range(0.04, 0.19, "m")] = 0.100
    """Outer side of the print [m]; markers have 0.23 of it."""
    thickness: Annotated[float, Range(0.0, 0.02, "m")] = 0.0002
    """Height of the printed face above the fixture's frame [m]: paper and glue."""
    part: str = ""
    """Name of the fixture that it is glued to; empty if not given. A task with another
    fixture refuses it."""

    @property
    def marker(self) -> float:
        """Side of a marker, its black border included [m]."""
        return 0.23 * self.side

    @property
    def pitch(self) -> float:
        """Distance between the middles of neighbours [m]."""
        return 0.345 * self.side

    @property
    def cut_out(self) -> float:
        """Side of the square that is cut out of the middle [m]."""
        return 0.39 * self.side

    @property
    def ids(self) -> tuple[int, ...]:
        """Numbers of its markers."""
        return tuple(range(self.first_id, self.first_id + MARKERS))

    @cached_property
    def corners(self) -> Array:
        """Corners of each marker in the fixture's frame [m], shape (8, 4, 3).

        In the order in which a detector gives them: seen from above, beginning where
        -x and +y meet, clockwise.
        """
        half = self.marker / 2.0
        square = half * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1.0]])
        middles = self.pitch * np.array(_PLACES, dtype=float)
        flat = middles[:, None, :] + square
        return np.concatenate([flat, np.full((*flat.shape[:2], 1), self.thickness)], 2)

    @cached_property
    def dictionary(self) -> Any:
        """The family of its markers, as OpenCV has it."""
        aruco = opencv().aruco
        return aruco.getPredefinedDictionary(aruco.DICT_APRILTAG_36H11)

    def bits(self, marker: int) -> NDArray[np.bool_]:
        """Return which cells of a marker are white, rows from its top, shape (8, 8)."""
        picture = self.dictionary.generateImageMarker(marker, _CELLS)
        return np.asarray(picture) > 127

    @property
    def cell(self) -> float:
        """Side of the squares that markers are made of [m]."""
        return self.marker / _CELLS

    @cached_property
    def dark(self) -> Array:
        """Middles of the black squares in the plane of the print [m], shape (n, 2)."""
        squares = []
        for marker, (i, j) in zip(self.ids, _PLACES, strict=True):
            rows, columns = np.nonzero(~self.bits(marker))
            x = i * self.pitch + (columns + 0.5 - _CELLS / 2) * self.cell
            y = j * self.pitch - (rows + 0.5 - _CELLS / 2) * self.cell
            squares.append(np.column_stack([x, y]))
        return np.vstack(squares)

    def picture(self, pixels: int) -> NDArray[np.uint8]:
        """Return the print as grey values, +y up, shape (pixels, pixels)."""
        shown = np.full((pixels, pixels), 255, dtype=np.uint8)
        scale, half = pixels / self.side, self.side / 2.0
        # The same edge of two neighbours is the same pixel, despite rounding.
        low = np.floor(scale * (self.dark * [1, -1] + half - self.cell / 2) + 0.500001)
        high = np.floor(scale * (self.dark * [1, -1] + half + self.cell / 2) + 0.500001)
        for (left, top), (right, bottom) in zip(
            low.astype(int), high.astype(int), strict=True
        ):
            shown[top:bottom, left:right] = 0
        return shown

    def svg(self) -> str:
        """Return the print in true size, with the line to cut along."""
        s, half = 1e3, self.side / 2.0
        width = s * self.cell
        squares = [
            f"M{s * (x + half) - width / 2:.4f} {s * (half - y) - width / 2:.4f}"
            f"h{width:.4f}v{width:.4f}h{-width:.4f}z"
            for x, y in self.dark
        ]
        side, cut = s * self.side, s * self.cut_out
        at = (side - cut) / 2.0
        return (
            '<svg xmlns="http://www.w3.org/2000/svg" '
            f'width="{side:g}mm" height="{side:g}mm" viewBox="0 0 {side:g} {side:g}">\n'
            f'<path shape-rendering="crispEdges" d="{"".join(squares)}"/>\n'
            '<g fill="none" stroke="#888" stroke-width="0.1">'
            f'<rect width="{side:g}" height="{side:g}"/>'
            f'<rect x="{at:g}" y="{at:g}" width="{cut:g}" height="{cut:g}"/></g>\n'
            f'<text x="{side - at + 0.4:g}" y="{side / 2.0:g}" font-size="1.2" '
            f'fill="#888">x</text>\n</svg>\n'
        )

    def pdf(self) -> bytes:
        """Return the print on a page of A4, in true size."""
        from PIL import Image, ImageDraw

        width, height = (round(edge / _INCH * _DPI) for edge in _PAPER)
        pixels = round(self.side / _INCH * _DPI)
        page = Image.new("L", (width, height), 255)
        left, top = (width - pixels) // 2, (height - pixels) // 2
        page.paste(Image.fromarray(self.picture(pixels)), (left, top))
        draw, cut = ImageDraw.Draw(page), pixels * self.cut_out / self.side
        for side in (pixels, cut):
            at = [(edge - side) / 2.0 for edge in (width, height)]
            draw.rectangle([*at, at[0] + side, at[1] + side], outline=128)
        draw.text((left, top + pixels + 40), self.title, fill=0, font_size=80)
        content = io.BytesIO()
        page.save(content, "PDF", resolution=float(_DPI))
        return content.getvalue()

    @property
    def title(self) -> str:
        """Title of the print, with the length to check with a ruler."""
        last = self.ids[-1]
        return (
            f"dovetail board {self.first_id} to {last}: print at 100 %; the outer "
            f"square has sides of {1e3 * self.side:.1f} mm"
        )
