"""Sources of pictures: a folder or a device; see `simulated` for the third."""

import time
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dovetail.arms.arm import ArmState
from dovetail.errors import ConfigError, TrackerError
from dovetail.perceive.opencv import opencv
from dovetail.perceive.picture import SUFFIXES, read_picture
from dovetail.poses import Pose
from dovetail.types import Vec7


class Frame(NamedTuple):
    """One picture."""

    picture: NDArray[np.uint8]
    """Grey values, shape (height, width)."""
    age: float
    """Time since the middle of its exposure [s]."""
    q: Vec7 | None = None
    """Configuration of the arm then [rad], if the source knows it."""


class ImageSource(Protocol):
    """Anything that gives pictures."""

    def reset(self, fixture: Pose, seed: int) -> Frame | None:
        """Start an episode; return a picture from before the arm goes to its start."""
        ...

    def look(self, fixture: Pose, state: ArmState) -> Frame | None:
        """Return the newest picture that was not returned before; None is none.

        Args:
            fixture: Where it really is; only a simulation looks at it.
            state: What the arm has measured last.

        Raises:
            TrackerError: There will be no more pictures.
        """
        ...

    def close(self) -> None:
        """Give the source back; harmless when repeated."""
        ...


class Folder:
    """The pictures of a folder, by name, one for each look: a recording."""

    def __init__(self, path: Path, delay: float = 0.0) -> None:
        """Find the pictures.

        Args:
            path: The folder.
            delay: How old each is said to be [s].

        Raises:
            ConfigError: There is no such folder, or no picture in it.
        """
        if not path.is_dir():
            raise ConfigError(f"{path} is no folder of pictures")
        self.files = sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES)
        if not self.files:
            raise ConfigError(
                f"the folder {path} holds no picture; known are {' '.join(SUFFIXES)}"
            )
        self._delay, self._next = delay, 0

    def reset(self, fixture: Pose, seed: int) -> Frame | None:
        """Begin with the first picture."""
        self._next = 0
        return None

    def look(self, fixture: Pose, state: ArmState) -> Frame | None:
        """Return the next picture."""
        if self._next >= len(self.files):
            raise TrackerError(f"the {len(self.files)} pictures have all been shown")
        file = self.files[self._next]
        self._next += 1
        return Frame(read_picture(file), self._delay)

    def close(self) -> None:
        """Do nothing: every file is closed."""


class Device:
    """A video device of this machine, as OpenCV opens it."""

    def __init__(self, number: int, width: int, height: int, delay: float) -> None:
        """Open it.

        Args:
            number: Of the device.
            width: Of a picture [pixels].
            height: Of a picture [pixels].
            delay: From the exposure until the picture is here [s].

        Raises:
            ConfigError: There is no such device.
        """
        cv: Any = opencv()
        self._cv, self._delay, self._number = cv, delay, number
        self._device = cv.VideoCapture(number)
        if not self._device.isOpened():
            raise ConfigError(
                f"there is no camera {number}: plug it in, name another device:NUMBER, "
                "or see whether a program holds it"
            )
        self._device.set(cv.CAP_PROP_FRAME_WIDTH, width)
        self._device.set(cv.CAP_PROP_FRAME_HEIGHT, height)
        self._device.set(cv.CAP_PROP_BUFFERSIZE, 1)  # an old picture is worth nothing
        self._device.set(cv.CAP_PROP_ORIENTATION_AUTO, 0)  # the sensor's pixels

    def reset(self, fixture: Pose, seed: int) -> Frame | None:
        """Return a picture; the arm has not moved yet."""
        return self._read()

    def look(self, fixture: Pose, state: ArmState) -> Frame | None:
        """Return the newest picture."""
        return self._read()

    def _read(self) -> Frame:
        begin = time.monotonic()
        is_read, picture = self._device.read()
        if not is_read:
            raise TrackerError(
                f"camera {self._number} gives no picture any more: is it unplugged?"
            )
        grey = self._cv.cvtColor(picture, self._cv.COLOR_BGR2GRAY)
        return Frame(grey, self._delay + 0.5 * (time.monotonic() - begin))

    def close(self) -> None:
        """Close the device."""
        self._device.release()
