"""Errors of a twin's camera: the differences from its calibration and timing."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from dovetail.control.ranges import Range
from dovetail.control.sections import Section, Sectioned

_AXES = tuple("xyz")
_SHIFT, _TURN = Range(-0.1, 0.1, "m", _AXES), Range(-0.2, 0.2, "rad", _AXES)


@dataclass(frozen=True, kw_only=True)
class TwinPictures(Section):
    """Delay, rate and dropout of the pictures."""

    owner: ClassVar[str] = "twin camera"

    delay: Annotated[float, Range(0.0, 5.0, "s")] = 0.05
    """Age of a picture when it can be used [s]."""
    rate: Annotated[float, Range(0.1, 1000.0, "1/s")] = 30.0
    """Pictures per second."""
    dropout: Annotated[float, Range(0.0, 1.0, "1")] = 0.0
    """Share of the pictures that are lost."""


@dataclass(frozen=True, kw_only=True)
class TwinSight(Section):
    """Errors of a camera simulated without pictures, the tracker `twin`."""

    owner: ClassVar[str] = "twin camera"

    bias: Annotated[float, Range(0.0, 0.05, "m")] = 0.0
    """Offset of the seen fixture [m], in a horizontal direction that is drawn for each
    try."""
    turn: Annotated[float, Range(0.0, 0.5, "rad")] = 0.0
    """Turn of the seen fixture about the vertical [rad]; its sign is drawn."""
    jitter: Annotated[float, Range(0.0, 0.05, "m")] = 0.0
    """Standard deviation of a normal error of each picture, each of x y z [m]."""


@dataclass(frozen=True, kw_only=True)
class TwinMisplaced(Section):
    """Errors of lens and place, which a calibration has to find."""

    owner: ClassVar[str] = "twin camera"

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


@dataclass(frozen=True, kw_only=True)
class TwinImage(Section):
    """Imperfections of a picture against a clean drawing."""

    owner: ClassVar[str] = "twin camera"

    noise: Annotated[float, Range(0.0, 100.0, "grey values")] = 2.0
    """Standard deviation of each pixel [grey values of 255]."""
    blur: Annotated[float, Range(0.0, 10.0, "pixels")] = 0.7
    """Standard deviation of the lens's blur [pixels]."""
    exposure: Annotated[float, Range(0.0, 1.0, "s")] = 0.004
    """Time for which light falls on a picture [s]: what moves is smeared."""
    glare: Annotated[float, Range(0.0, 1000.0, "grey values")] = 0.0
    """Light of a lamp's reflection on the board, at a place drawn for each try [grey
    values]."""


@dataclass(frozen=True, kw_only=True)
class TwinCamera(Sectioned):
    """The table [camera] of a twin's file; what is left out is exact.

    Without pictures `sight` holds, with pictures it comes about by itself, from
    `misplaced` and `image`. When pictures come holds for both.
    """

    whose: ClassVar[str] = "a twin's camera"

    pictures: TwinPictures = field(default_factory=TwinPictures)
    """Delay, rate and dropout of the pictures."""
    sight: TwinSight = field(default_factory=TwinSight)
    """Errors of a camera simulated without pictures."""
    misplaced: TwinMisplaced = field(default_factory=TwinMisplaced)
    """Errors of lens and place."""
    image: TwinImage = field(default_factory=TwinImage)
    """Imperfections of a picture against a clean drawing."""
