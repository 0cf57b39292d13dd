"""Corners of markers where the lines along their edges meet.

Along the normal of an edge the grey value falls from the white paper to the black
border. Where it passes the middle between the two is a point of the edge; a line is
fitted through these points, and two lines meet in a corner.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail.perceive.opencv import opencv
from dovetail.types import Array

_POINTS = 14
"""Points along an edge; its ends, where the corner rounds off, are left out."""
_INSET = 0.14
_TAPS = np.arange(-8, 9) / 8.0
"""Samples of the grey value along a normal, in half windows."""
_CELLS = 8
_WINDOW = 1.0
"""Half of what is looked at along a normal, in cells of the marker."""
_NARROW = 1.5
_CONTRAST = 12.0
"""Smallest step from paper to border [grey values]."""
_PURE = 0.2
"""Share of a marker's points with black behind the border, or wide paper before it, at
least."""
_T = np.linspace(3.0, 0.0, 31)
_HALF = np.vectorize(lambda t: 0.5 * math.erfc(t / math.sqrt(2.0)))
_SHINE = 2.0 * _HALF(_T), _HALF(2.0 * _T)
"""Between two blurred edges 2 t deviations apart: how bright the darkest place is, and
what the far one adds at the near one [of the contrast]."""
_SHARE = 0.6
"""Share of an edge's points that must lie on one line."""
_OFF = 0.6
"""Largest distance of such a point from it [pixels]."""
_ROUNDS = 2
_WIDEST = 4.0
"""Half of what is looked at to tell an edge's width [pixels]."""


class Edges(NamedTuple):
    """The edges of markers in a picture, as lines: ``normal . x = distance``."""

    normal: Array
    """Out of the marker, unit length, shape (markers, 4, 2)."""
    distance: Array
    """[pixels], shape (markers, 4)."""
    corners: Array
    """Corner of each edge with the one before it [pixels], shape (markers, 4, 2)."""
    is_clean: NDArray[np.bool_]
    """True for each marker with four straight edges, shape (markers,)."""

    def of(self, keep: NDArray[np.intp]) -> "Edges":
        """Return those of some markers."""
        return Edges(
            self.normal[keep],
            self.distance[keep],
            self.corners[keep],
            self.is_clean[keep],
        )


def edge_points(corners: Array) -> Array:
    """Return two points of each edge, shape (markers, 4, 2, dimensions).

    There the errors of a line through evenly spaced points do not depend on each other.
    """
    reach = (1.0 - 2.0 * _INSET) / np.sqrt(12.0)
    share = np.array([0.5 - reach, 0.5 + reach])[:, None]
    begin, end = corners[:, :, None], np.roll(corners, -1, axis=1)[:, :, None]
    return begin + share * (end - begin)


def find_edges(picture: NDArray[np.uint8], expected: Array) -> Edges:
    """Return the edges of markers.

    Args:
        picture: Grey values, shape (height, width).
        expected: Where the corners are, to a pixel or two, clockwise from where -x and
            +y of the board meet, shape (markers, 4, 2).
    """
    grey = picture.astype(np.float32)  # of whole ones `remap` makes whole ones
    edges = _find_once(grey, expected)
    for _ in range(_ROUNDS - 1):
        edges = _find_once(grey, edges.corners)
    return edges


def _find_once(picture: NDArray[np.float32], corners: Array) -> Edges:
    begin, end = corners, np.roll(corners, -1, axis=1)  # edges, (markers, 4, 2)
    along = end - begin
    length = np.linalg.norm(along, axis=2, keepdims=True)
    along = along / np.maximum(length, 1e-9)
    out = np.stack([along[..., 1], -along[..., 0]], axis=2)  # clockwise: to the left
    middles = (begin + end) / 2.0
    across = ((middles - np.roll(middles, 2, axis=1)) * out).sum(axis=2, keepdims=True)
    window = np.clip(_WINDOW * across / _CELLS, _NARROW, 4.0)
    share = np.linspace(_INSET, 1.0 - _INSET, _POINTS)[:, None]
    middle = begin[:, :, None] + share * (end - begin)[:, :, None]
    reach = (window * out)[:, :, None, None] * _TAPS[:, None]
    place = (middle[:, :, :, None] + reach).astype(np.float32)
    grey = _sample(picture, place)  # (markers, 4, points, taps)
    crossing, is_crossed = _crossing(grey)
    shift = crossing * window
    rise = grey.max(axis=3) - grey.min(axis=3)
    return _meet(middle, out, shift, is_crossed & (rise > _CONTRAST), along)


def _crossing(grey: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return where grey values pass the middle between paper and border.

    A border that is few pixels wide is never quite black, where a white cell is behind
    it; that moves the middle, too, by `_SHINE` of how bright its darkest place is. So
    does the dark behind a strip of paper.

    Args:
        grey: Along the normals, outwards, shape (markers, 4, points, taps).

    Returns:
        Where, in half windows, and whether at all, each of shape (markers, 4, points).
    """
    darkest, brightest = grey.min(axis=3), grey[..., _TAPS.size // 2 :].max(axis=3)
    few = round(_PURE * 4 * _POINTS)
    black, white = (
        np.partition(ends.reshape(len(grey), -1), rank, axis=1)[:, rank, None, None]
        for ends, rank in ((darkest, few), (brightest, -few))
    )
    contrast = np.maximum(white - black, 1e-9)
    middle = (
        0.5
        + np.interp((darkest - black) / contrast, *_SHINE)
        - np.interp((white - brightest) / contrast, *_SHINE)
    )
    above = grey - (black + contrast * middle)[..., None]
    passes = (above[..., :-1] < 0.0) & (above[..., 1:] >= 0.0)
    last = passes.shape[3] - 1 - passes[..., ::-1].argmax(axis=3)[..., None]
    here, there = (np.take_along_axis(above, last + i, 3)[..., 0] for i in (0, 1))
    share = here / np.minimum(here - there, -1e-9)
    return _TAPS[last[..., 0]] + share / 8.0, passes.any(axis=3)


def _sample(picture: NDArray[np.float32], place: NDArray[np.float32]) -> Array:
    """Return grey values between pixels; outside of the picture all are the same."""
    cv = opencv()
    flat = place.reshape(place.shape[0] * place.shape[1], -1, 2)
    grey = cv.remap(
        picture, flat, None, cv.INTER_LINEAR,
        borderMode=cv.BORDER_REPLICATE,
    )  # fmt: skip
    return grey.reshape(place.shape[:-1]).astype(float)


def _meet(
    middle: Array, out: Array, shift: Array, is_there: Array, along: Array
) -> Edges:
    """Fit the lines and return them with where neighbours meet."""
    # In the frame of the edge: s along it, `shift` across. Two rounds, as points that
    # lie far from the first line are of something that covers the edge.
    s = ((middle - middle[:, :, :1]) * along[:, :, None]).sum(axis=3)
    offset, slant = _fit_line(s, shift, is_there.astype(float))
    off = shift - (offset + slant * s)
    use = is_there * (np.abs(off) < _OFF)
    offset, slant = _fit_line(s, shift, use)
    is_clean = (use.mean(axis=2) >= _SHARE).all(axis=1)
    foot = middle[:, :, 0] + offset * out
    way = along + slant * out
    normal = np.stack([way[..., 1], -way[..., 0]], axis=2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    distance = (normal * foot).sum(axis=2)
    # A corner is where the edge before it and its own meet.
    before, d_before = np.roll(normal, 1, axis=1), np.roll(distance, 1, axis=1)
    cross = before[..., 0] * normal[..., 1] - before[..., 1] * normal[..., 0]
    is_clean &= (np.abs(cross) > 1e-3).all(axis=1)
    cross = np.where(np.abs(cross) > 1e-3, cross, 1.0)
    x = (d_before * normal[..., 1] - distance * before[..., 1]) / cross
    y = (before[..., 0] * distance - normal[..., 0] * d_before) / cross
    return Edges(normal, distance, np.stack([x, y], axis=2), is_clean)


def _fit_line(s: Array, t: Array, use: Array) -> tuple[Array, Array]:
    """Return offset and slope of t over s, weighted, each of shape (..., 1)."""
    total = np.maximum(use.sum(axis=2, keepdims=True), 1e-9)
    s0 = (use * s).sum(axis=2, keepdims=True) / total
    t0 = (use * t).sum(axis=2, keepdims=True) / total
    spread = (use * (s - s0) ** 2).sum(axis=2, keepdims=True)
    slope = (use * (s - s0) * (t - t0)).sum(axis=2, keepdims=True)
    slope = slope / np.maximum(spread, 1e-9)
    return t0 - slope * s0, slope


def edge_width(picture: NDArray[np.uint8], corners: Array) -> float:
    """Return over how many pixels the edges of markers fall: standard deviation.

    A pixel alone gives about half a pixel.

    Args:
        picture: Grey values, shape (height, width).
        corners: Where they are, as in `find_edges`.
    """
    begin, end = corners, np.roll(corners, -1, axis=1)
    along = end - begin
    along = along / np.linalg.norm(along, axis=2, keepdims=True)
    out = np.stack([along[..., 1], -along[..., 0]], axis=2)
    share = np.linspace(0.3, 0.7, _POINTS)[:, None]
    middle = begin[:, :, None] + share * (end - begin)[:, :, None]
    reach = _WIDEST * out[:, :, None, None] * _TAPS[:, None]
    grey = _sample(
        picture.astype(np.float32),
        (middle[:, :, :, None] + reach).astype(np.float32),
    )
    slope = np.maximum(np.diff(grey.mean(axis=2), axis=2), 0.0)  # noise averages out
    weight = slope**2
    taps = _WIDEST * (_TAPS[1:] + _TAPS[:-1]) / 2.0
    total = np.maximum(weight.sum(axis=2), 1e-9)
    mean = (weight @ taps) / total
    spread = (weight * (taps - mean[..., None]) ** 2).sum(axis=2) / total
    return float(np.median(np.sqrt(2.0 * spread)))  # a squared bell is narrower
