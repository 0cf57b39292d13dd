"""Errors of a twin's camera: the differences from its calibration and timing."""

from typing import Annotated

from dovetail.settings import Range, settings

_AXES = tuple("xyz")
_SHIFT, _TURN = Range(-0.1, 0.1, "m", _AXES), Range(-0.2, 0.2, "rad", _AXES)


@settings(owner="twin camera")
class TwinPictures:
    """Delay, rate and dropout of the pictures."""

    delay: Annotated[float, Range(0.0, 5.0, "s")] = 0.05
    """Age of a picture when it can be used [s]."""
    rate: Annotated[float, Range(0.1, 1000.0, "1/s")] = 30.0
    """Pictures per second."""
    dropout: Annotated[float, Range(0.0, 1.0, "1")] = 0.0
    """Share of the pictures that are lost."""


@settings(owner="twin camera")
class TwinSight:
    """Errors of a camera simulated without pictures, the tracker `twin`."""

    bias: Annotated[float, Range(0.0, 0.05, "m")] = 0.0
    """Offset of the seen fixture [m], in a horizontal direction that is drawn for each
    try."""
    turn: Annotated[float, Range(0.0, 0.5, "rad")] = 0.0
    """Turn of the seen fixture about the vertical [rad]; its sign is drawn."""
    jitter: Annotated[float, Range(0.0, 0.05, "m")] = 0.0
    """Standard deviation of a normal error of each picture, each of x y z [m]."""


@settings(owner="twin camera")
class TwinMisplaced:
    """Errors of lens and place, which a calibration has to find."""

    focal_error: Annotated[float, Range(-0.2, 0.2, "1")] = 0.0
    """True focal lengths over the camera file's, minus 1."""
    centre_error: Annotated[
        tuple[float, float], Range(-100.0, 100.0, "pixels", ("x", "y"))
    ] = (0.0, 0.0)
    """True centre minus the camera file's [pixels]."""
    position_error: Annotated[tuple[float, float, float], _SHIFT] = (0.0, 0.0, 0.0)
    """True place of the camera minus the camera file's, mount's axes [m]."""
    rotation_error: Annotated[tuple[float, float, float], _TURN] = (0.0, 0.0, 0.0)
    """Rotation vector from the camera file's to the true one, mount's axes [rad]."""

    def numbers(self) -> tuple[float, ...]:
        """Return every error; 0 is exact."""
        return (
            self.focal_error,
            *self.centre_error,
            *self.position_error,
            *self.rotation_error,
        )


@settings(owner="twin camera")
class TwinImage:
    """Imperfections of a picture against a clean drawing."""

    noise: Annotated[float, Range(0.0, 100.0, "grey values")] = 2.0
    """Standard deviation of each pixel [grey values of 255]."""
    blur: Annotated[float, Range(0.0, 10.0, "pixels")] = 0.7
    """Standard deviation of the lens's blur [pixels]."""
    exposure: Annotated[float, Range(0.0, 1.0, "s")] = 0.004
    """Time for which light falls on a picture [s]: what moves is smeared."""
    glare: Annotated[float, Range(0.0, 1000.0, "grey values")] = 0.0
    """Light of a lamp's reflection on the board, at a place drawn for each try [grey
    values]."""


@settings()
class TwinCamera(TwinPictures, TwinSight, TwinMisplaced, TwinImage):
    """The table [camera] of a twin's file; what is left out is exact.

    Without pictures `sight` holds, with pictures it comes about by itself, from
    `misplaced` and `image`. When pictures come holds for both.
    """
