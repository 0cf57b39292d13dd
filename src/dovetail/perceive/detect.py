"""From a picture to the board's pose, with its covariance, or the reason for none.

Markers are found by OpenCV, and the lines along their edges then give the pose: a line
through some ten points is a few hundredths of a pixel good, a corner is not. A flat
board has two poses that look alike (Collins and Bartoli 2014, IPPE): both are followed,
and neither is returned where the picture cannot tell them apart.
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dovetail.errors import ConfigError
from dovetail.perceive.board import Board
from dovetail.perceive.camera import Lens
from dovetail.perceive.edges import Edges, edge_points, find_edges
from dovetail.perceive.opencv import opencv
from dovetail.perceive.projection import Projection
from dovetail.poses import Pose, rotation_error
from dovetail.types import Array

_Names: TypeAlias = NDArray[np.intp]

MARKERS_MIN = 3
"""Fewer markers than these give no pose: their corners are too near each other."""
_TELL_APART = 16.0
"""Least lead over the other pose's fit: difference of the squared errors over their
variance, 4 sigma."""
_SAME = 0.01
"""Rotation up to which the other pose is the same one [rad], as seen from above."""
_SPREAD = 0.15
"""Spread of light over an edge, standard deviation [pixels]."""
_MISFIT, _MISFIT_MIN = 6.0, 0.6
"""Largest error of a marker's edges that is left in, over the expected and [pixels]."""
_FREEDOM = 20.0
"""Weight of the camera file's noise: as so many residuals of a picture's 64."""


class DetectionFailure(NamedTuple):
    """No pose, and why."""

    reason: str
    """One word for programs: none, few, other, two, ambiguous or misfit."""
    words: str
    """For a person."""


class Detection(NamedTuple):
    """One board in one picture."""

    pose: Pose
    """The fixture's frame in the camera's."""
    covariance: Array
    """Of position [m] and rotation vector [rad], camera's axes, shape (6, 6)."""
    error: float
    """Of the edges, RMS [pixels]."""
    other: Pose
    """The second pose that a flat board has."""
    other_error: float
    """That of its edges, RMS [pixels]."""
    ids: tuple[int, ...]
    """Markers that were used."""
    corners: Array
    """Their corners in the picture [pixels], shape (markers, 4, 2)."""
    points: Array
    """The same corners in the fixture's frame [m], shape (markers, 4, 3)."""


class Corners(NamedTuple):
    """Corners of markers in a picture and on the board."""

    seen: Array
    """[pixels], shape (markers, 4, 2)."""
    points: Array
    """In the fixture's frame [m], shape (markers, 4, 3)."""


class _Fit(NamedTuple):
    """One of the two poses at its minimum."""

    pose: Pose
    spread: float
    residuals: Array
    covariance: Array
    variance: float


class Detector:
    """Looks for one board through one lens."""

    def __init__(self, board: Board, lens: Lens, edge_noise: float = 0.05) -> None:
        """Prepare.

        Args:
            board: What is looked for.
            lens: Of the camera.
            edge_noise: Standard deviation of an edge's place [pixels], as calibrated.
        """
        self.board, self.lens, self.noise = board, lens, edge_noise
        self.projection = Projection(lens)
        aruco = opencv().aruco
        settings = aruco.DetectorParameters()
        settings.cornerRefinementMethod = aruco.CORNER_REFINE_NONE
        self._finder: Any = aruco.ArucoDetector(board.dictionary, settings)

    def find(self, picture: NDArray[np.uint8]) -> Detection | DetectionFailure:
        """Return the board's pose, or why there is none.

        Args:
            picture: Grey values, shape (height, width).

        Raises:
            ConfigError: The picture has another size than the lens.
        """
        self._require_size(picture)
        found = self._markers(picture)
        if isinstance(found, DetectionFailure):
            return found
        names, seen = found
        points = self.board.corners[names - self.board.first_id]
        rough, _ = self.projection.flat_poses(points, seen, self.board.thickness)
        edges = find_edges(picture, self.projection.place(rough, points))
        keep = np.flatnonzero(edges.is_clean)
        return self._fit(points[keep], edges.of(keep), names[keep])

    def find_corners(self, picture: NDArray[np.uint8]) -> Corners | DetectionFailure:
        """Return where the markers' corners are; the lens does not matter.

        Args:
            picture: Grey values, shape (height, width).
        """
        found = self._markers(picture)
        if isinstance(found, DetectionFailure):
            return found
        names, seen = found
        points = self.board.corners[names - self.board.first_id]
        flat = points[..., :2].reshape(-1, 1, 2)
        plane, _ = opencv().findHomography(flat, seen.reshape(-1, 1, 2))
        expected = opencv().perspectiveTransform(flat, plane).reshape(seen.shape)
        edges = find_edges(picture, expected)
        keep = np.flatnonzero(edges.is_clean)
        if len(keep) < MARKERS_MIN:
            return DetectionFailure(
                "misfit", "the markers have no straight edges: is it blurred?"
            )
        return Corners(edges.corners[keep], points[keep])

    def _markers(
        self, picture: NDArray[np.uint8]
    ) -> tuple[_Names, Array] | DetectionFailure:
        """Return numbers and rough corners of the board's markers."""
        corners, ids, _ = self._finder.detectMarkers(picture)
        found = [] if ids is None else np.ravel(ids).tolist()
        own = [i for i, name in enumerate(found) if name in self.board.ids]
        names = [found[i] for i in own]
        if len(set(names)) < len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            return DetectionFailure(
                "two", f"two boards are in sight: markers {twice} twice"
            )
        if len(names) < MARKERS_MIN:
            return self._blind(found, names)
        seen = np.array([np.reshape(corners[i], (4, 2)) for i in own], dtype=float)
        return np.array(names), seen

    def _require_size(self, picture: NDArray[np.uint8]) -> None:
        wanted = self.lens.height, self.lens.width
        if picture.shape != wanted:
            raise ConfigError(
                f"a picture is {' x '.join(map(str, picture.shape[::-1]))} pixels and "
                f"the camera was calibrated at {wanted[1]} x {wanted[0]}: set the "
                "camera to that resolution, or calibrate it at this one"
            )

    def _blind(self, found: list[int], names: list[int]) -> DetectionFailure:
        first, last = self.board.ids[0], self.board.ids[-1]
        if not found:
            return DetectionFailure("none", "no marker is in sight")
        if not names:
            return DetectionFailure(
                "other",
                f"another board is in sight: markers {sorted(found)}, and this one has "
                f"{first} to {last}",
            )
        return DetectionFailure(
            "few",
            f"{len(names)} of {len(self.board.ids)} markers are in sight; a pose needs "
            f"{MARKERS_MIN}",
        )

    def _fit(
        self, points: Array, edges: Edges, names: NDArray[np.intp]
    ) -> Detection | DetectionFailure:
        """Fit both poses to the markers that agree with each other."""
        limit = max(_MISFIT * self.noise, _MISFIT_MIN)
        while len(points) >= MARKERS_MIN:
            poses = self.projection.flat_poses(
                points, edges.corners, self.board.thickness
            )
            fits = [self._minimum(pose, points, edges) for pose in poses]
            best, other = sorted(fits, key=lambda fit: float(fit.residuals.std()))
            errors = np.abs(best.residuals).reshape(len(points), -1).max(axis=1)
            if errors.max() <= limit:
                return self._judged(best, other, points, edges, names)
            keep = np.delete(np.arange(len(points)), errors.argmax())
            points, edges, names = points[keep], edges.of(keep), names[keep]
        return DetectionFailure(
            "misfit",
            f"fewer than {MARKERS_MIN} markers fit the board to {limit:.2f} pixels: it "
            "is bent, blurred, covered, another one, or the lens is not this",
        )

    def _minimum(self, pose: Pose, points: Array, edges: Edges) -> _Fit:
        """Move a pose to where the board's edges lie on the picture's.

        Light spreads over edges: every marker looks larger or smaller by the same, not
        the distances between them. That is a seventh unknown.
        """
        on_edges = edge_points(points)
        fit = self._step(pose, 0.0, self.noise**2, on_edges, edges)
        for _ in range(2):
            fit = self._step(fit.pose, fit.spread, fit.variance, on_edges, edges)
        return fit

    def _step(
        self, pose: Pose, spread: float, variance: float, on_edges: Array, edges: Edges
    ) -> _Fit:
        """Return what one step of Gauss and Newton makes of a pose."""
        nx, ny = edges.normal[:, :, None, 0], edges.normal[:, :, None, 1]
        place, slopes = self.projection.place_and_slopes(pose, on_edges)
        # Positive where the picture's edge is farther out than the model's.
        gap = edges.distance[:, :, None] - nx * place[..., 0] - ny * place[..., 1]
        residuals = gap.ravel() - spread
        J = np.ones((residuals.size, 7))
        rows = nx[..., None] * slopes[..., 0, :] + ny[..., None] * slopes[..., 1, :]
        J[:, :6] = rows.reshape(-1, 6)
        prior = np.zeros((7, 7))
        prior[6, 6] = variance / _SPREAD**2
        inverted = np.linalg.inv(J.T @ J + prior)
        step = inverted @ (J.T @ residuals - prior[:, 6] * spread)
        left = residuals - J @ step
        squares = _FREEDOM * self.noise**2 + float(left @ left)
        variance = squares / (_FREEDOM + left.size - 7)
        covariance = np.asarray(variance * inverted[:6, :6], dtype=np.float64)
        pose = self.projection.moved(pose, step[:6])
        return _Fit(pose, spread + float(step[6]), left, covariance, variance)

    def _judged(
        self,
        best: _Fit,
        other: _Fit,
        points: Array,
        edges: Edges,
        names: NDArray[np.intp],
    ) -> Detection | DetectionFailure:
        excess = other.residuals @ other.residuals - best.residuals @ best.residuals
        turn = rotation_error(best.pose.quat_wxyz, other.pose.quat_wxyz)
        if np.linalg.norm(turn) > _SAME and excess / best.variance < _TELL_APART:
            return DetectionFailure(
                "ambiguous",
                "the board's two possible poses cannot be told apart: look at it more "
                "from the side, or from nearer",
            )
        # An edge moved in by 1 pixel moves both of its corners with it.
        inwards = edges.normal + np.roll(edges.normal, 1, axis=1)
        corners = edges.corners - best.spread * inwards
        return Detection(
            best.pose, best.covariance, float(best.residuals.std()),
            other.pose, float(other.residuals.std()),
            tuple(names.tolist()), corners, points,
        )  # fmt: skip


def explain(
    detector: Detector, picture: NDArray[np.uint8], blind: DetectionFailure
) -> str:
    """Return why there is no pose, for a person, after another look at the picture."""
    flipped = np.ascontiguousarray(picture[:, ::-1])
    if blind.reason != "two" and isinstance(detector.find(flipped), Detection):
        return "the picture is mirrored: switch the camera's mirroring off"
    return blind.words
