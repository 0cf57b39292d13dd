"""A camera in the simulation: pictures with blur, noise, exposure and delay."""

from collections import deque
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail.arms.arm import ArmState
from dovetail.perceive.camera import Camera, Lens
from dovetail.perceive.opencv import opencv
from dovetail.perceive.projection import Projection
from dovetail.perceive.sources import Frame
from dovetail.plants.plant import COLUMN
from dovetail.plants.twin_camera import TwinCamera, TwinImage
from dovetail.poses import Pose, compose, inverse, quat_from_vector, quat_multiply
from dovetail.types import Array, Vec7
from dovetail.view.renderer import CameraView, Plate, Renderer
from dovetail.workcell.workcell import Workcell

_SAMPLES = 4  # of a pixel: edges of markers must be where they are
_STREAM = 0xCA3E7A
"""Keeps these draws apart from those of start and fixture, which have the same seed."""
_MEMORY = 1.0
"""Time for which the past is kept beyond the delay [s]."""
_SPOT = 0.012
"""Radius of a reflection on the board [m]."""
_Q = slice(COLUMN["q1"], COLUMN["q7"] + 1)


class _Moment(NamedTuple):
    stamp: float
    q: Vec7
    fixture: Pose


def true_camera(camera: Camera, twin: TwinCamera) -> Camera:
    """Return the camera as it is, where the file says what is believed of it."""
    lens, misplaced = camera.lens, twin
    focal = tuple(f * (1.0 + misplaced.focal_error) for f in lens.focal)
    centre = tuple(np.add(lens.centre, misplaced.centre_error).tolist())
    turn = quat_from_vector(np.array(misplaced.rotation_error))
    rotation = quat_multiply(turn, camera.pose.quat_wxyz)
    position = np.add(camera.position, misplaced.position_error)
    return replace(
        camera,
        lens=replace(lens, focal=focal, centre=centre),
        position=tuple(position.tolist()),
        rotation=tuple(rotation.tolist()),
        delay=twin.delay,
        rate=twin.rate,
    )


class Simulated:
    """Draws what a camera would see, when it would see it."""

    def __init__(
        self, camera: Camera, cell: Workcell, twin: TwinCamera | None = None
    ) -> None:
        """Prepare; OpenGL is opened with the first picture.

        Args:
            camera: What is believed of it.
            cell: What it looks at.
            twin: In what it differs from that; None is in nothing.
        """
        told = camera
        errors = twin or TwinCamera(delay=told.delay, rate=told.rate)
        self.errors = errors
        self.camera = true_camera(camera, errors)
        self._cell = cell
        self._studio: _Studio | None = None
        self._past: deque[_Moment] = deque()
        self._begin(0)

    def _begin(self, seed: int) -> None:
        self._seed, self._last = seed, -1_000_000
        rng = np.random.default_rng([_STREAM, seed])
        self._phase = float(rng.uniform(0.0, 1.0 / self.camera.rate))
        half = 0.4 * self.camera.board.side
        self._spot = np.array([*rng.uniform(-half, half, 2), 0.0])
        self._past.clear()

    def reset(self, fixture: Pose, seed: int) -> Frame | None:
        """Return a picture with the arm in its usual posture, over the table.

        A camera on the flange gives none: the arm has to take it to where it sees.
        """
        self._begin(seed)
        if self.camera.mount == "flange":
            return None
        q = self._cell.robot.posture("down")
        still = _Moment(0.0, q, fixture)
        picture = self._expose(still, still, self._rng(self._last))
        return Frame(picture, self.camera.delay, q)

    def look(self, fixture: Pose, state: ArmState) -> Frame | None:
        """Return the newest picture whose delay is over, if it was not lost."""
        self._remember(fixture, state)
        made, now = self.camera, state.stamp
        newest = int(np.floor((now - made.delay - self._phase) * made.rate + 1e-9))
        while newest > self._last and self._is_lost(newest):
            newest -= 1
        if newest <= self._last:
            return None
        self._last = newest
        stamp = newest / made.rate + self._phase
        half = self.errors.exposure / 2.0
        begin, middle, end = (self._at(stamp + part) for part in (-half, 0.0, half))
        picture = self._expose(begin, end, self._rng(newest))
        return Frame(picture, now - stamp, middle.q)

    def _rng(self, number: int) -> np.random.Generator:
        """Return the random numbers of one picture."""
        return np.random.default_rng([_STREAM, self._seed, number + 1_000_000])

    def _is_lost(self, number: int) -> bool:
        return bool(self._rng(number).random() < self.errors.dropout)

    def _remember(self, fixture: Pose, state: ArmState) -> None:
        """Keep where arm and fixture were; in between the fixture moves evenly."""
        past = self._past
        if len(state.log) and past:
            begin, before = past[-1].stamp, past[-1].fixture
            span = max(state.stamp - begin, 1e-9)
            for row in state.log[:-1]:
                share = (row[0] - begin) / span
                if 0.0 < share < 1.0:
                    moved = _between(before, fixture, share)
                    past.append(_Moment(float(row[0]), row[_Q].copy(), moved))
        past.append(_Moment(state.stamp, state.q.copy(), fixture))
        while past[0].stamp < state.stamp - self.camera.delay - _MEMORY:
            past.popleft()

    def _at(self, stamp: float) -> _Moment:
        """Return arm and fixture at a time; before the first one they stood still."""
        past = self._past
        if stamp <= past[0].stamp:
            return past[0]._replace(stamp=stamp)
        i = next(i for i in range(len(past) - 1, -1, -1) if past[i].stamp <= stamp)
        if i == len(past) - 1:
            return past[i]._replace(stamp=stamp)
        a, b = past[i], past[i + 1]
        share = min((stamp - a.stamp) / max(b.stamp - a.stamp, 1e-9), 1.0)
        q = a.q + share * (b.q - a.q)
        return _Moment(stamp, q, _between(a.fixture, b.fixture, share))

    def place(self, q: Vec7) -> Pose:
        """Return the camera in the world with the arm at q [rad]."""
        if self.camera.mount == "world":
            return self.camera.pose
        return compose(self._cell.robot.tool_pose(q), self.camera.pose)

    def _expose(
        self, begin: _Moment, end: _Moment, rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        """Return the picture of a moment, smeared by what moved meanwhile."""
        studio = self._open()
        views = [inverse(self.place(moment.q)) for moment in (begin, end)]
        boards = [
            compose(view, moment.fixture)
            for view, moment in zip(views, (begin, end), strict=True)
        ]
        middle = _Moment(
            0.0, 0.5 * (begin.q + end.q), _between(begin.fixture, end.fixture, 0.5)
        )
        grey = studio.draw(
            middle.q, middle.fixture, self.place(middle.q), middle.fixture
        )
        smear = studio.smear(boards)
        if np.linalg.norm(smear) > 0.3:
            grey = _smeared(grey, smear)
        if self.errors.glare:
            grey = studio.shine(grey, boards[0], self._spot, self.errors.glare)
        return spoil(grey, self.errors, rng)

    def still(
        self, q: Vec7, fixture: Pose, board: Pose, seed: int
    ) -> NDArray[np.uint8]:
        """Return a picture of an arm that stands.

        Args:
            q: Its configuration [rad].
            fixture: Where the fixture is.
            board: Where the board is: on the fixture, or in the tool.
            seed: Of the noise.
        """
        grey = self._open().draw(q, fixture, self.place(q), board)
        return spoil(grey, self.errors, np.random.default_rng([_STREAM, seed]))

    def _open(self) -> "_Studio":
        if self._studio is None:
            self._studio = _Studio(self.camera, self._cell)
        return self._studio

    def close(self) -> None:
        """Give OpenGL back."""
        if self._studio is not None:
            self._studio.close()
            self._studio = None


def spoil(grey: Array, flaws: TwinImage, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a picture as a sensor gives it: blurred, noisy, cut off at 0 and 255."""
    cv: Any = opencv()
    if flaws.blur:
        grey = cv.GaussianBlur(grey, (0, 0), flaws.blur)
    if flaws.noise:
        normal = rng.standard_normal(grey.shape, dtype=np.float32)
        grey = grey + np.float32(flaws.noise) * normal
    return np.clip(np.rint(grey), 0.0, 255.0).astype(np.uint8)


def _between(begin: Pose, end: Pose, share: float) -> Pose:
    position = begin.position + share * (end.position - begin.position)
    quat = end.quat_wxyz if share > 0.5 else begin.quat_wxyz
    return Pose(position, quat)


def _smeared(grey: Array, smear: Array) -> Array:
    """Return a picture convolved with a line [pixels]."""
    cv: Any = opencv()
    half = int(np.ceil(np.abs(smear).max() / 2.0)) + 1
    kernel = np.zeros((2 * half + 1,) * 2, dtype=np.float32)
    for share in np.linspace(-0.5, 0.5, 8 * half + 1):
        x, y = share * smear + half
        i, j = int(np.floor(x)), int(np.floor(y))
        a, b = x - i, y - j
        kernel[j, i] += (1 - a) * (1 - b)
        kernel[j, i + 1] += a * (1 - b)
        kernel[j + 1, i] += (1 - a) * b
        kernel[j + 1, i + 1] += a * b
    return cv.filter2D(grey, -1, kernel / kernel.sum())


class _Studio:
    """Renderer and lens of one camera."""

    def __init__(self, camera: Camera, cell: Workcell) -> None:
        self._cv: Any = opencv()
        lens, board = camera.lens, camera.board
        self._board, self._projection = board, Projection(lens)
        self._edges, size, self._maps = _pinhole(lens)
        self._renderer = Renderer(
            cell,
            width=size[0],
            height=size[1],
            plate=Plate(board.dark, board.cell, board.side, board.cut_out),
            samples=_SAMPLES,
        )

    def draw(self, q: Vec7, fixture: Pose, camera: Pose, board: Pose) -> Array:
        """Return grey values, not rounded, shape (height, width)."""
        up = Pose(np.array([0.0, 0.0, self._board.thickness]), np.eye(4)[0])
        picture = self._renderer.draw(
            q, fixture, plate=compose(board, up), view=CameraView(camera, self._edges)
        )
        grey = self._cv.cvtColor(picture, self._cv.COLOR_RGB2GRAY).astype(np.float32)
        if self._maps is not None:
            grey = self._cv.remap(grey, *self._maps, self._cv.INTER_LINEAR)
        return grey

    def smear(self, boards: list[Pose]) -> Array:
        """Return how far the board's middle moves in the picture [pixels]."""
        begin, end = (self._projection.place(b, np.zeros((1, 3)))[0] for b in boards)
        return end - begin

    def shine(self, grey: Array, board: Pose, spot: Array, light: float) -> Array:
        """Return the picture with a lamp's reflection on the board."""
        there = self._projection.place(board, spot[None])[0]
        focal = self._projection.matrix[0, 0]
        radius = focal * _SPOT / max(float(board.position[2]), 1e-3)
        y, x = np.mgrid[: grey.shape[0], : grey.shape[1]].astype(np.float32)
        distance = (x - there[0]) ** 2 + (y - there[1]) ** 2
        return grey + light * np.exp(-0.5 * distance / radius**2)

    def close(self) -> None:
        """Give OpenGL back."""
        self._renderer.close()


def _pinhole(
    lens: Lens,
) -> tuple[tuple[float, float, float, float], tuple[int, int], Any]:
    """Return what to draw for a lens: edges 1 m ahead, size, and maps to bend it by."""
    (fx, fy), (cx, cy) = lens.focal, lens.centre
    w, h = lens.width, lens.height
    edges = (-0.5 - cx) / fx, (w - 0.5 - cx) / fx, (-0.5 - cy) / fy, (h - 0.5 - cy) / fy
    if not any(lens.distortion):
        return edges, (w, h), None
    cv: Any = opencv()
    v, u = np.mgrid[:h, :w].astype(float)
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)[:, None]
    flat = cv.undistortPoints(pixels, lens.matrix(), lens.coefficients())[:, 0]
    low, high = flat.min(axis=0) - 2.0 / fx, flat.max(axis=0) + 2.0 / fx
    size = np.ceil((high - low) * [fx, fy]).astype(int)
    high = low + size / np.array([fx, fy])
    at = (flat - low) * [fx, fy] - 0.5
    maps = tuple(part.reshape(h, w).astype(np.float32) for part in at.T)
    return (low[0], high[0], low[1], high[1]), (int(size[0]), int(size[1])), maps
