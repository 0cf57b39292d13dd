"""A lens from pictures of a board: focal lengths, centre, distortion, and how sure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dovetail.errors import ConfigError
from dovetail.perceive.camera import Lens
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
    """Find the lens by which flat boards look as they do.

    Args:
        corners: Of each picture [pixels], shape (..., 2).
        points: The same in the board's frame [m], shape (..., 3).
        width: Of a picture [pixels].
        height: Of a picture [pixels].

    Raises:
        ConfigError: Too few pictures, all from one side, or in one spot; says which.
    """
    if len(corners) < PICTURES_MIN:
        raise ConfigError(
            f"{len(corners)} pictures show the board; a lens needs {PICTURES_MIN}, and "
            "20 are good"
        )
    cv: Any = opencv()
    seen = [part.reshape(-1, 1, 2).astype(np.float32) for part in corners]
    _require_cover(
        np.concatenate([part.reshape(-1, 2) for part in corners]), width, height
    )
    # Flat: OpenCV begins with the plane z = 0; the paper's height is the same for all.
    flat = [
        (part.reshape(-1, 3) * [1.0, 1.0, 0.0]).astype(np.float32) for part in points
    ]
    error, K, d, turns, _, deviations, _, errors = cv.calibrateCameraExtended(
        flat, seen, (width, height), None, None
    )
    _require_tilt(turns)
    fx, fy, cx, cy = (float(part) for part in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    lens = Lens(
        width=width,
        height=height,
        focal=(fx, fy),
        centre=(cx, cy),
        distortion=tuple(np.ravel(d)[:5].tolist()),
        deviation=tuple(np.ravel(deviations)[:4].tolist()),
    )
    return LensFit(
        lens=lens,
        error=float(error),
        errors=tuple(np.ravel(errors).tolist()),
        edge_noise=float(np.clip(error / np.sqrt(2.0), 0.03, 5.0)),
    )


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
