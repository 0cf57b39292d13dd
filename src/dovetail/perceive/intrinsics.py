"""A lens from pictures of a board: focal lengths, centre, distortion, and how sure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dovetail.errors import ConfigError
from dovetail.perceive.camera import DISTORTION, Lens
from dovetail.perceive.opencv import opencv
from dovetail.types import Array

PICTURES_MIN = 6
"""Fewer pictures than these say nothing about how good the answer is."""
_TILT_MIN = 0.35
"""Smallest largest angle between the board's faces [rad]: of flat views alone, focal
length and distance cannot be told apart."""
_COVER_MIN = 0.5
"""Smallest share of the picture's width and height in which corners were."""
_GO_PIXELS, _GO_FOCAL = 0.5, 0.003
_TOLD = 4.0
"""Least drop of the squared error by a term of the distortion, in variances, for which
it is kept: by chance the drop is smaller in 95 % of cases."""
_Single: TypeAlias = NDArray[np.float32]
_TERMS = DISTORTION.labels


@dataclass(frozen=True, kw_only=True)
class LensFit:
    """A calibration of a lens, and how good it is."""

    lens: Lens
    """The lens, with the deviations of focal lengths and centre."""
    error: float
    """Of all corners, RMS [pixels]."""
    errors: tuple[float, ...]
    """Of each picture's corners, RMS [pixels]."""
    edge_noise: float
    """Standard deviation of an edge's place [pixels], by what is left."""
    fixed: tuple[str, ...] = ()
    """Terms of the distortion that the pictures do not tell: they are 0."""

    def objections(self) -> list[str]:
        """Return why not to use it; empty is go."""
        found = []
        if self.error > _GO_PIXELS:
            worst = int(np.argmax(self.errors))
            found.append(
                f"corners are {self.error:.2f} pixels off; go is up to {_GO_PIXELS:g}: "
                f"the worst picture is number {worst + 1} with "
                f"{self.errors[worst]:.2f}; is the board flat?"
            )
        share = max(
            d / f for d, f in zip(self.lens.deviation[:2], self.lens.focal, strict=True)
        )
        if share > _GO_FOCAL:
            found.append(
                f"focal lengths are known to {100 * share:.2f} %; go is up to "
                f"{100 * _GO_FOCAL:g} %: take more pictures, tilted and at the borders"
            )
        return found


def fit_lens(
    corners: Sequence[Array], points: Sequence[Array], width: int, height: int
) -> LensFit:
    """Calibrate the lens from pictures of a flat board.

    Args:
        corners: Of each picture [pixels], shape (..., 2).
        points: The same in the board's frame [m], shape (..., 3).
        width: Of a picture [pixels].
        height: Of a picture [pixels].

    Raises:
        ConfigError: Too few pictures, all from one side, in one spot, or that fit no
            lens; says which.
    """
    if len(corners) < PICTURES_MIN:
        raise ConfigError(
            f"{len(corners)} pictures show the board; a lens needs {PICTURES_MIN}, and "
            "20 are good"
        )
    seen = [part.reshape(-1, 1, 2).astype(np.float32) for part in corners]
    _require_cover(
        np.concatenate([part.reshape(-1, 2) for part in corners]), width, height
    )
    # Flat: OpenCV begins with the plane z = 0; the paper's height is the same for all.
    flat = [
        (part.reshape(-1, 3) * [1.0, 1.0, 0.0]).astype(np.float32) for part in points
    ]
    found, fixed = _simplest(flat, seen, (width, height))
    _require_tilt(found.turns)
    return LensFit(
        lens=_lens(found, width, height),
        error=found.error,
        errors=found.errors,
        edge_noise=float(np.clip(found.error / np.sqrt(2.0), 0.03, 5.0)),
        fixed=fixed,
    )


class _Found(NamedTuple):
    """Fit of the pictures by OpenCV, with some terms of the distortion at 0."""

    error: float
    pinhole: tuple[float, ...]
    distortion: tuple[float, ...]
    deviation: tuple[float, ...]
    errors: tuple[float, ...]
    turns: Sequence[Array]

    @property
    def is_plausible(self) -> bool:
        """True if a lens can have this distortion."""
        return all(abs(term) <= DISTORTION.high for term in self.distortion)


def _simplest(
    flat: Sequence[_Single], seen: Sequence[_Single], size: tuple[int, int]
) -> tuple[_Found, tuple[str, ...]]:
    """Return the fit without the terms of high order that the pictures do not show.

    k3 and then k2 are left out where the squared error hardly grows. In a long lens's
    narrow view they would follow the noise: 60 instead of 0. OpenCV's own deviation of
    such a term is no help: it is far too small where the term is least certain.
    """
    cv: Any = opencv()
    count, free = 2 * sum(map(len, seen)), 9 + 6 * len(seen)
    found, fixed, flags = _calibrate(flat, seen, size, 0), (), 0
    for name, flag in (("k3", cv.CALIB_FIX_K3), ("k2", cv.CALIB_FIX_K2)):
        simpler = _calibrate(flat, seen, size, flags | flag)
        gain = (simpler.error / found.error) ** 2 - 1.0
        if found.is_plausible and gain * max(count - free, 1) > _TOLD:
            break
        found, fixed, flags = simpler, (*fixed, name), flags | flag
    return found, fixed


def _calibrate(
    flat: Sequence[_Single], seen: Sequence[_Single], size: tuple[int, int], flags: int
) -> _Found:
    cv: Any = opencv()
    try:
        error, K, d, turns, shifts, _, _, errors = cv.calibrateCameraExtended(
            flat, seen, size, None, None, flags=flags
        )
    except cv.error as error:
        raise ConfigError(
            "no lens fits these pictures: show the whole board, tilted differently in "
            f"each ({error.err})"
        ) from error
    d = np.ravel(d)[: len(_TERMS)]
    slopes = [
        cv.projectPoints(points, turn, shift, K, d)[1][:, : 10 + len(_TERMS)]
        for points, turn, shift in zip(flat, turns, shifts, strict=True)
    ]
    return _Found(
        float(error),
        (float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])),
        tuple(d.tolist()),
        tuple(_deviations(slopes, float(error), np.append(np.ones(4), d) != 0.0)),
        tuple(np.ravel(errors).tolist()),
        turns,
    )


def _deviations(
    slopes: Sequence[Array], error: float, is_free: NDArray[np.bool_]
) -> list[float]:
    """Return the standard deviations of focal lengths and centre [pixels].

    Columns are brought to one size first. OpenCV's own inverse does not: with a long
    lens it leaves out the least certain direction, and its deviations are too small.

    Args:
        slopes: Of each picture's corners by the board's pose (6), focal lengths, centre
            and distortion; two rows for each corner.
        error: Of all corners, RMS [pixels].
        is_free: Which of the last 9 columns were fitted.
    """
    lens = int(is_free.sum())
    normal = np.zeros((lens, lens))
    for part in slopes:
        pose, rest = part[:, :6], part[:, 6:][:, is_free]
        # what of the lens's slopes no motion of this board makes up for
        scale = np.linalg.norm(pose, axis=0)
        left = rest - pose / scale @ np.linalg.lstsq(pose / scale, rest, rcond=None)[0]
        normal += left.T @ left
    scale = np.sqrt(np.diag(normal))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), hermitian=True)
    rows = sum(map(len, slopes))
    free = max(rows - lens - 6 * len(slopes), 1)
    variance = error**2 * rows / 2.0 / free
    return np.sqrt(variance * np.diag(inverse) / scale**2)[:4].tolist()


def _lens(found: _Found, width: int, height: int) -> Lens:
    """Return the lens; numbers that no lens has mean that the pictures tell too little.

    Raises:
        ConfigError: Says which number, and how narrow the view is.
    """
    fx, fy, cx, cy = found.pinhole
    try:
        return Lens(
            width=width,
            height=height,
            focal=(fx, fy),
            centre=(cx, cy),
            distortion=found.distortion,
            deviation=found.deviation,
        )
    except ConfigError as error:
        view = np.degrees(2.0 * np.arctan2(width / 2.0, fx))
        raise ConfigError(
            f"the pictures do not tell this lens: {error}; its view is {view:.1f} "
            "degrees wide: take more pictures, tilted further, from nearer and at the "
            "borders"
        ) from error


def _require_cover(seen: Array, width: int, height: int) -> None:
    share = (seen.max(axis=0) - seen.min(axis=0)) / [width, height]
    if share.min() < _COVER_MIN:
        raise ConfigError(
            f"the board was in {100 * share[0]:.0f} % of the pictures' width and "
            f"{100 * share[1]:.0f} % of their height; needs {100 * _COVER_MIN:.0f} % "
            "each: show it at the borders and corners, too"
        )


def _require_tilt(turns: Sequence[Array]) -> None:
    cv: Any = opencv()
    faces = np.array([cv.Rodrigues(turn)[0][:, 2] for turn in turns])
    largest = float(np.arccos(np.clip(faces @ faces.T, -1.0, 1.0)).max())
    if largest < _TILT_MIN:
        raise ConfigError(
            f"the board was tilted by {largest:.2f} rad at most between two pictures; "
            f"needs {_TILT_MIN:g}: focal length and distance cannot be told apart "
            "otherwise"
        )
