"""In what a twin's camera differs from what is believed of it."""

from dataclasses import dataclass
from typing import Annotated

from dovetail.control.ranges import Range, check_ranges

_AXES = tuple("xyz")
_SHIFT, _TURN = Range(-0.1, 0.1, "m", _AXES), Range(-0.2, 0.2, "rad", _AXES)


@dataclass(frozen=True, kw_only=True)
class TwinCamera:
    """The table [camera] of a twin's file; what is left out is exact.

    `bias`, `turn` and `jitter` are what is left of a camera without pictures, the
    tracker `twin`. With pictures they come about by themselves, from the errors of lens
    and place. Delay, rate and drop-outs hold for both.
    """

    delay: Annotated[float, Range(0.0, 5.0, "s")] = 0.05
    """Age of a picture when it can be used [s]."""
    rate: Annotated[float, Range(0.1, 1000.0, "1/s")] = 30.0
    """Pictures per second."""
    dropout: Annotated[float, Range(0.0, 1.0, "1")] = 0.0
    """Share of the pictures that are lost."""
    bias: Annotated[float, Range(0.0, 0.05, "m")] = 0.0
    """How far beside the fixture it is seen [m], in a horizontal direction that is
    drawn for each try."""
    turn: Annotated[float, Range(0.0, 0.5, "rad")] = 0.0
    """How far it is seen turned about the vertical [rad]; its sign is drawn."""
    jitter: Annotated[float, Range(0.0, 0.05, "m")] = 0.0
    """Standard deviation of a normal error of each picture, each of x y z [m]."""
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
    noise: Annotated[float, Range(0.0, 100.0, "grey values")] = 2.0
    """Standard deviation of each pixel [grey values of 255]."""
    blur: Annotated[float, Range(0.0, 10.0, "pixels")] = 0.7
    """Standard deviation of the lens's blur [pixels]."""
    exposure: Annotated[float, Range(0.0, 1.0, "s")] = 0.004
    """Time for which light falls on a picture [s]: what moves is smeared."""
    glare: Annotated[float, Range(0.0, 1000.0, "grey values")] = 0.0
    """Light of a lamp's reflection on the board, at a place drawn for each try [grey
    values]."""

    @property
    def misplaced(self) -> tuple[float, ...]:
        """Errors of lens and place, which a calibration has to find; 0 is exact."""
        return (
            self.focal_error,
            *self.centre_error,
            *self.position_error,
            *self.rotation_error,
        )

    def __post_init__(self) -> None:
        """Refuse a number out of range, by name."""
        check_ranges(self, "twin camera")
