"""Hand-eye calibration: a camera's place, from pictures of a board in many arm poses.

Either the camera is on the flange and the board stands still, or the camera stands and
the board is on the flange. With the mount's frame G in the other one, the camera's X in
its mount and the board's Y: ``G_i X C_i = Y`` in every picture i.

First in closed form (Park and Martin 1994), from the board's poses C_i; then X and Y
together are moved to where the corners of all pictures fit best. The covariance comes
from what is left, and each picture is predicted once from all others.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.perceive.camera import Lens
from dovetail.perceive.projection import Projection
from dovetail.poses import (
    Pose,
    compose,
    inverse,
    matrix_from_quat,
    quat_from_matrix,
    quat_from_vector,
    quat_multiply,
    rotation_error,
)
from dovetail.types import Array, Vec3

VIEWS_MIN = 6
"""Fewer pictures than these say nothing about how good the answer is."""
_TURN_MIN = 0.25
"""Smallest largest turn between two poses of the arm [rad]."""
_ONE_AXIS = 0.02
"""Share of the turns about a second axis below which they are about one."""
_SCALE_MIN, _SCALE_SIGMAS = 0.004, 4.0
"""From when on a print has another size than said: share, and standard deviations."""
_OUT_OF_STEP, _TURN_NOISE = 4.0, 0.02
"""Least mismatch of the turns that is out of step: over that of a pairing one picture
later or earlier [1], and itself [rad]."""
_NOT_PAIRED = 0.1
"""Largest mismatch of these turns [rad]: a wrong lens gives less."""
_ITERATIONS = 12
_GO_LEAVE_ONE_OUT, _GO_INTERVAL, _GO_PIXELS = 1e-3, 1e-3, 1.0


class HandEyeSample(NamedTuple):
    """One picture of the board, and where the arm was."""

    flange: Pose
    """Of the flange in the world."""
    board: Pose
    """Of the board in the camera, as the picture says."""
    corners: Array
    """Of its markers [pixels], shape (markers, 4, 2)."""
    points: Array
    """The same in the board's frame [m], shape (markers, 4, 3)."""


@dataclass(frozen=True, kw_only=True)
class HandEye:
    """A calibration, and how good it is."""

    mount: Literal["world", "flange"]
    """Body that the camera is fixed to."""
    camera: Pose
    """T_mount_camera."""
    board: Pose
    """The board: in the world for a camera on the flange, else in the flange."""
    covariance: Array
    """Of the camera's position [m] and rotation vector [rad], mount's axes, (6, 6)."""
    error: float
    """Of the corners, RMS of x and y [pixels]."""
    leave_one_out: Array
    """Distance of the board in each picture from its place by all others [m]."""
    scale: float
    """Size of the print over what is said."""
    scale_deviation: float
    """Its standard deviation."""

    @property
    def interval(self) -> Vec3:
        """Half of the 95 % interval of the camera's position, x y z [m]."""
        return 1.96 * np.sqrt(np.diag(self.covariance)[:3])

    @property
    def leave_one_out_rms(self) -> float:
        """RMS of `leave_one_out` [m]."""
        return float(np.sqrt((self.leave_one_out**2).mean()))

    def objections(self) -> list[str]:
        """Return why not to use it; empty is go."""
        found = []
        if self.leave_one_out_rms > _GO_LEAVE_ONE_OUT:
            found.append(
                f"a picture is {1e3 * self.leave_one_out_rms:.2f} mm from where the "
                f"others say; go is up to {1e3 * _GO_LEAVE_ONE_OUT:g} mm: the arm's "
                "angles, the lens or the board's flatness are wrong"
            )
        if self.interval.max() > _GO_INTERVAL:
            found.append(
                f"the camera's place is known to {1e3 * self.interval.max():.2f} mm; "
                f"go is up to {1e3 * _GO_INTERVAL:g} mm: take more pictures, turned "
                "further and from nearer"
            )
        if self.error > _GO_PIXELS:
            found.append(
                f"corners are {self.error:.2f} pixels off; go is up to "
                f"{_GO_PIXELS:g}: calibrate the lens again"
            )
        return found


def calibrate(
    views: Sequence[HandEyeSample], lens: Lens, mount: Literal["world", "flange"]
) -> HandEye:
    """Find where the camera sits.

    Args:
        views: At least 6, of the arm turned about two axes.
        lens: Of the camera.
        mount: What the camera is fixed to.

    Raises:
        ConfigError: Too few views, turns about one axis only, pictures and poses out of
            step, or a print of another size; says which.
    """
    if len(views) < VIEWS_MIN:
        raise ConfigError(
            f"{len(views)} pictures show the board; a calibration needs {VIEWS_MIN}, "
            "and 20 are good"
        )
    mounts = [view.flange for view in views]
    if mount == "world":
        mounts = [inverse(flange) for flange in mounts]
    boards = [view.board for view in views]
    _require_turns(mounts)
    _require_in_step(mounts, boards)
    camera = closed_form(mounts, boards)
    board = compose(compose(mounts[0], camera), boards[0])
    problem = _Problem(views, mounts, Projection(lens))
    answer = problem.refine(_Guess(camera, board, 1.0), free_scale=False)
    _require_size(problem, answer)
    whole = problem.refine(answer.guess, free_scale=True)
    errors = problem.leave_one_out(answer.guess)
    return HandEye(
        mount=mount,
        camera=answer.guess.camera,
        board=answer.guess.board,
        covariance=answer.covariance[:6, :6] * _inflation(errors, views, answer),
        error=answer.error,
        leave_one_out=errors,
        scale=whole.guess.scale,
        scale_deviation=float(np.sqrt(whole.covariance[12, 12])),
    )


def closed_form(mounts: Sequence[Pose], boards: Sequence[Pose]) -> Pose:
    """Return the camera in its mount by the relative motions alone.

    Args:
        mounts: The mount's frame in each picture.
        boards: The board in the camera.

    Reference:
        Park and Martin 1994: the turns of both are the same turn seen from two frames.
    """
    turns, rows, sides = np.zeros((3, 3)), [], []
    pairs = list(itertools.combinations(range(len(mounts)), 2))
    motions = []
    for i, j in pairs:
        A = compose(inverse(mounts[j]), mounts[i])
        B = compose(boards[j], inverse(boards[i]))
        motions.append((A, B))
        turns += np.outer(_vector(A), _vector(B))
    U, _, Vt = np.linalg.svd(turns)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    for A, B in motions:
        rows.append(matrix_from_quat(A.quat_wxyz) - np.eye(3))
        sides.append(R @ B.position - A.position)
    position = np.linalg.lstsq(np.vstack(rows), np.concatenate(sides), rcond=None)[0]
    return Pose(position, quat_from_matrix(R))


def _vector(pose: Pose) -> Vec3:
    return rotation_error(pose.quat_wxyz, np.array([1.0, 0.0, 0.0, 0.0]))


def _require_turns(mounts: Sequence[Pose]) -> None:
    """Refuse poses from which the camera's place does not follow."""
    turns = np.array([
        _vector(compose(inverse(b), a)) for a, b in itertools.combinations(mounts, 2)
    ])  # fmt: skip
    largest = float(np.linalg.norm(turns, axis=1).max())
    if largest < _TURN_MIN:
        raise ConfigError(
            f"the arm turned by {largest:.2f} rad at most between two pictures; needs "
            f"{_TURN_MIN:g}: tilt and turn the flange, do not only shift it"
        )
    size, axes = np.linalg.eigh(turns.T @ turns)
    if size[1] < _ONE_AXIS * size[2]:
        axis = ", ".join(f"{part:.2f}" for part in axes[:, 2])
        raise ConfigError(
            f"all turns of the arm are about one axis, ({axis}) in the mount's frame: "
            "how far the camera is along it cannot be known; tilt about another, too"
        )


def _require_in_step(mounts: Sequence[Pose], boards: Sequence[Pose]) -> None:
    """Refuse pictures that belong to the pose before or after."""
    now = _mismatch(mounts, boards)
    for shift, word in ((1, "after"), (-1, "before")):
        other = _mismatch(mounts[max(shift, 0) :], boards[max(-shift, 0) :])
        if now > _TURN_NOISE and now > _OUT_OF_STEP * other:
            raise ConfigError(
                "pictures and poses are out of step: each picture fits the pose "
                f"{word} its own; pair them again; let the arm stand for each picture"
            )
    if now > _NOT_PAIRED:
        raise ConfigError(
            f"pictures and poses do not belong together: between two pictures arm and "
            f"board turn by amounts that differ by {now:.2f} rad (median); up to "
            f"{_NOT_PAIRED:g} is expected: are the lines of the poses in the order of "
            "the pictures, the angles in radians, and is it this arm?"
        )


def _mismatch(mounts: Sequence[Pose], boards: Sequence[Pose]) -> float:
    """Return by how much the turns of arm and board differ in size, median [rad]."""
    pairs = list(zip(mounts, boards, strict=False))
    sizes = [
        np.linalg.norm(_vector(compose(inverse(b[0]), a[0])))
        - np.linalg.norm(_vector(compose(b[1], inverse(a[1]))))
        for a, b in itertools.combinations(pairs, 2)
    ]
    return float(np.median(np.abs(sizes)))


class _Guess(NamedTuple):
    camera: Pose
    board: Pose
    scale: float


class _Answer(NamedTuple):
    guess: _Guess
    covariance: Array
    error: float


class _Problem:
    """Least squares over the corners of all pictures."""

    def __init__(
        self,
        views: Sequence[HandEyeSample],
        mounts: Sequence[Pose],
        projection: Projection,
    ) -> None:
        self._views, self._projection = views, projection
        self._back = [inverse(mount) for mount in mounts]

    def predict(self, guess: _Guess, i: int) -> Pose:
        """Return the board in the camera, in picture i."""
        return compose(inverse(guess.camera), compose(self._back[i], guess.board))

    def refine(
        self,
        guess: _Guess,
        *,
        free_scale: bool,
        without: int | None = None,
        iterations: int = _ITERATIONS,
    ) -> _Answer:
        """Return the best camera and board, by Gauss and Newton.

        Args:
            guess: Where to start.
            free_scale: Whether the print's size is unknown, too.
            without: A picture that is left out.
            iterations: At most.
        """
        free = 13 if free_scale else 12
        used = [i for i in range(len(self._views)) if i != without]
        for _ in range(iterations):
            normal, side, _, _ = self._sums(guess, used, free)
            step = np.asarray(np.linalg.solve(normal, side), dtype=np.float64)
            guess = _moved(guess, step)
            if np.abs(step).max() < 1e-10:
                break
        normal, _, squares, count = self._sums(guess, used, free)
        inverted = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        error = float(np.sqrt(squares / count))
        return _Answer(guess, squares / (count - free) * inverted, error)

    def _sums(
        self, guess: _Guess, used: Sequence[int], free: int
    ) -> tuple[Array, Array, float, int]:
        """Return the normal equations, the squared error and how many it is of."""
        normal, side = np.zeros((free, free)), np.zeros(free)
        squares, count = 0.0, 0
        for i in used:
            J, residuals = self._linear(guess, i)
            J = J[:, :free]
            normal += J.T @ J
            side += J.T @ residuals
            squares += float(residuals @ residuals)
            count += len(residuals)
        return normal, side, squares, count

    def _linear(self, guess: _Guess, i: int) -> tuple[Array, Array]:
        """Return slopes by camera, board and scale, and what is left [pixels]."""
        view = self._views[i]
        pose = self.predict(guess, i)
        points = guess.scale * view.points
        place, slopes = self._projection.place_and_slopes(pose, points)
        slopes = slopes.reshape(-1, 6)
        R_camera = matrix_from_quat(guess.camera.quat_wxyz).T  # mount to camera
        back = self._back[i]
        there = compose(back, guess.board).position - guess.camera.position
        x, y, z = there
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        by_camera = np.zeros((6, 6))
        by_camera[:3, :3], by_camera[:3, 3:] = -R_camera, R_camera @ cross
        by_camera[3:, 3:] = -R_camera
        R_board = R_camera @ matrix_from_quat(back.quat_wxyz)
        by_board = np.kron(np.eye(2), R_board)
        turned = view.points.reshape(-1, 3) @ matrix_from_quat(pose.quat_wxyz).T
        by_scale = np.einsum(
            "pij,pj->pi", slopes.reshape(-1, 2, 6)[:, :, :3], turned
        ).reshape(-1, 1)
        J = np.hstack([slopes @ by_camera, slopes @ by_board, by_scale])
        return J, (view.corners - place).ravel()

    def leave_one_out(self, guess: _Guess) -> Array:
        """Return how far each board is from where the other pictures say [m]."""
        errors = []
        for i, view in enumerate(self._views):
            other = self.refine(guess, free_scale=False, without=i, iterations=3)
            there = self.predict(other.guess, i)
            errors.append(np.linalg.norm(there.position - view.board.position))
        return np.array(errors)


def _moved(guess: _Guess, step: Array) -> _Guess:
    return _Guess(
        _stepped(guess.camera, step[:6]),
        _stepped(guess.board, step[6:12]),
        guess.scale + float(step[12:].sum()),
    )


def _stepped(pose: Pose, step: Array) -> Pose:
    quat = quat_multiply(quat_from_vector(step[3:]), pose.quat_wxyz)
    return Pose(pose.position + step[:3], quat)


def _require_size(problem: _Problem, answer: _Answer) -> None:
    """Refuse a print whose size is not what is said: the arm's way is the ruler."""
    whole = problem.refine(answer.guess, free_scale=True)
    scale, deviation = whole.guess.scale, float(np.sqrt(whole.covariance[12, 12]))
    if abs(scale - 1.0) > max(_SCALE_MIN, _SCALE_SIGMAS * deviation):
        raise ConfigError(
            f"the print has {100 * scale:.1f} +- {100 * 1.96 * deviation:.1f} % of the "
            "size that is said: print it at 100 %, or measure it and say so; or the "
            "camera is mounted otherwise"
        )


def _inflation(errors: Array, views: Sequence[HandEyeSample], answer: _Answer) -> float:
    """Return by how much more than the corners the arm's own errors spread, at least 1.

    Corners alone say how far each board is off; where it is off more than twice that,
    the arm's angles or the lens are, which no residual of one picture shows.
    """
    distance = np.array([np.linalg.norm(view.board.position) for view in views])
    places = answer.covariance
    expected = np.sqrt(
        np.trace(places[:3, :3])
        + np.trace(places[6:9, 6:9])
        + distance.mean() ** 2 * np.trace(places[3:6, 3:6])
    )
    seen = float(np.sqrt((errors**2).mean()))
    spread = _seen_spread(views, answer.error)
    ratio = seen / float(np.hypot(expected, spread))
    return ratio**2 if ratio > 2.0 else 1.0


def _seen_spread(views: Sequence[HandEyeSample], error: float) -> float:
    """Return how far one picture's board is off for corners off by `error` [m]."""
    spreads = []
    for view in views:
        distance = float(np.linalg.norm(view.board.position))
        seen, size = view.corners.reshape(-1, 2), view.points.reshape(-1, 3)
        pixels = np.linalg.norm(seen - seen.mean(axis=0), axis=1).mean()
        metres = np.linalg.norm(size - size.mean(axis=0), axis=1).mean()
        along = distance * error / pixels / np.sqrt(len(seen))
        across = metres / pixels * error / np.sqrt(len(seen))
        spreads.append(np.hypot(along, across))
    return float(np.mean(spreads))
