"""A camera and a board on the fixture: where it is, how old that is and how sure."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from dovetail.arms.arm import ArmState
from dovetail.errors import TrackerError
from dovetail.perceive.camera import Camera
from dovetail.perceive.detect import Detection, DetectionFailure, Detector, explain
from dovetail.perceive.sources import Frame, ImageSource
from dovetail.poses import Pose, compose, matrix_from_quat
from dovetail.robots.robot import Robot
from dovetail.trackers.tracker import Estimate
from dovetail.types import Array, Vec7

_MEMORY = 2.0
"""Time for which the arm's past is kept, for pictures that come late [s]."""


class MarkerTracker:
    """Tells the pose of the newest picture in which the board was seen.

    A picture in which the board is hidden or doubtful gives no pose: the last one stays
    and its age grows; `reason` says why.
    """

    def __init__(self, camera: Camera, source: ImageSource, robot: Robot) -> None:
        """Take a camera.

        Args:
            camera: What is known of it.
            source: Its pictures.
            robot: The bare arm, for a camera on its flange.
        """
        self.camera, self.source = camera, source
        self.detector = Detector(camera.board, camera.lens, camera.edge_noise)
        self._robot = robot
        self._past: deque[tuple[float, Vec7]] = deque()
        self._seen: Estimate | None = None
        self._unseen: tuple[NDArray[np.uint8], DetectionFailure] | None = None
        self._stamp = self._now = 0.0
        self._seed = 0
        self.reason = "no picture was taken"
        """Reason why the newest picture gave no pose; empty if it gave one."""

    def reset(self, fixture: Pose, seed: int) -> None:
        """Forget, and look before the arm goes to its start."""
        self._past.clear()
        self._seen, self._unseen, self._now = None, None, 0.0
        self._seed = seed
        frame = self.source.reset(fixture, seed)
        if frame is not None and not self.is_on_arm:
            self._take(frame)

    @property
    def is_on_arm(self) -> bool:
        """True if the camera is on the flange."""
        return self.camera.mount == "flange"

    def rewind(self, fixture: Pose) -> None:
        """Go on in an episode whose time begins at 0 again, with what was seen."""
        self._past.clear()
        self._stamp, self._now = self._stamp - self._now, 0.0
        self.source.reset(fixture, self._seed)

    def update(self, fixture: Pose, state: ArmState) -> None:
        """Look at the newest picture.

        Raises:
            TrackerError: There are no more pictures.
        """
        self._now = state.stamp
        self._past.append((state.stamp, state.q))
        while self._past[0][0] < state.stamp - _MEMORY:
            self._past.popleft()
        frame = self.source.look(fixture, state)
        if frame is not None:
            self._take(frame)

    def estimate(self) -> Estimate:
        """Return the pose that was seen last, and the time since then.

        Raises:
            TrackerError: The board has not been seen in this episode.
        """
        if self._seen is None:
            why = self.reason
            if self._unseen is not None:
                why = explain(self.detector, *self._unseen)
            raise TrackerError(
                f"the camera has not seen the board in this episode: {why}"
            )
        return self._seen._replace(age=self._now - self._stamp)

    def close(self) -> None:
        """Give the pictures' source back; harmless when repeated."""
        self.source.close()

    def _take(self, frame: Frame) -> None:
        sight = self.detector.find(frame.picture)
        if isinstance(sight, DetectionFailure):
            self.reason, self._unseen = sight.words, (frame.picture, sight)
            return
        self.reason, self._unseen = "", None
        self._stamp = self._now - frame.age
        q = self._q_at(self._stamp) if frame.q is None else frame.q
        self._seen = locate(self.camera, sight, self._robot, q)

    def _q_at(self, stamp: float) -> Vec7 | None:
        """Return where the arm was at a time [rad], as measured."""
        if not self._past:
            return None
        stamps = [at for at, _ in self._past]
        joints = np.array([q for _, q in self._past])
        return np.array([np.interp(stamp, stamps, column) for column in joints.T])


def locate(
    camera: Camera, sight: Detection, robot: Robot, q: Vec7 | None = None
) -> Estimate:
    """Return the fixture in the world, by what a camera saw, at age 0.

    Args:
        camera: Which saw it.
        sight: What it saw.
        robot: The bare arm.
        q: Where the arm was then [rad]; a camera in the world needs none.

    Raises:
        TrackerError: The camera is on the flange, and q is not known.
    """
    mount = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    if camera.mount == "flange":
        if q is None:
            raise TrackerError("a camera on the flange needs the arm's configuration")
        mount = robot.tool_pose(q)
    place = compose(mount, camera.pose)
    covariance = _covariance(camera, sight, mount, place)
    return Estimate(compose(place, sight.pose), 0.0, covariance)


def _covariance(camera: Camera, sight: Detection, mount: Pose, place: Pose) -> Array:
    """Return that of the fixture's pose: of the picture, the lens and the place."""
    z = float(sight.pose.position[2])
    (fx, fy), (dx, dy, mx, my) = camera.lens.focal, camera.lens.deviation
    seen = sight.covariance.copy()
    seen[[0, 1, 2], [0, 1, 2]] += (
        z * np.array([mx / fx, my / fy, max(dx / fx, dy / fy)])
    ) ** 2
    whole = _turned(seen, matrix_from_quat(place.quat_wxyz))
    arm = matrix_from_quat(place.quat_wxyz) @ sight.pose.position
    x, y, w = arm
    lever = np.eye(6)  # a turn of the camera moves what it sees: turn x arm
    lever[:3, 3:] = -np.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    placed = _turned(camera.covariance(), matrix_from_quat(mount.quat_wxyz))
    return whole + lever @ placed @ lever.T


def _turned(covariance: Array, R: Array) -> Array:
    both = np.kron(np.eye(2), R)
    return both @ covariance @ both.T
