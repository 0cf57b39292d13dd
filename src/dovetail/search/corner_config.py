"""The numbers of the corner search."""

from typing import Annotated, Self

from pydantic import model_validator

from dovetail.errors import ConfigError
from dovetail.settings import Range, settings


@settings()
class AirConfig:
    """Way of the corner through the air to the surface."""

    speed: Annotated[float, Range(0.001, 0.25, "m/s")] = 0.15
    """Speed through free air [m/s], as far as an action asks for it."""
    over: Annotated[float, Range(0.001, 0.1, "m")] = 0.004
    """Height of the corner above the surface on the way there [m]."""
    touch_speed: Annotated[float, Range(0.001, 0.1, "m/s")] = 0.025
    """Speed down to the surface [m/s]: contact at this speed gives the peak force."""


@settings()
class SlideConfig:
    """Slide of the corner over the surface, until it falls in."""

    rings: tuple[float, ...] = (0.012, 0.022, 0.032)
    """Radii of the circles on which the corner slides [m], one after the other."""
    drop: Annotated[float, Range(0.0002, 0.01, "m")] = 0.0006
    """Depth below the surface from which the corner is in the opening [m]."""
    slide_speed: Annotated[float, Range(0.001, 0.1, "m/s")] = 0.05
    """Speed over the surface, and in the opening to its corner [m/s]."""
    slide_press: Annotated[float, Range(0.0, 10.0, "m/s2")] = 0.65
    """f* towards the surface on the way over it [m/s2]."""
    slide_gain: Annotated[float, Range(0.0, 200.0, "1/s")] = 65.0
    """Gain from the missing part of that speed to f*, against friction [1/s]."""
    slide_rate: Annotated[float, Range(0.0, 2000.0, "1/s2")] = 200.0
    """The same from the missing distance [1/s2]: a stuck corner is pushed harder."""
    friction: Annotated[float, Range(0.0, 10.0, "m/s2")] = 2.7
    """Most that is added to f* for what sticks [m/s2]."""

    @model_validator(mode="after")
    def _check_slide_config(self) -> Self:
        """Refuse a number out of range, by name."""
        if not self.rings or not all(0.0 < radius <= 0.1 for radius in self.rings):
            raise ConfigError(
                f"rings are {self.rings}; allowed: radii above 0 and up to 0.1 m"
            )
        return self


@settings()
class SeatConfig:
    """Push of the corner into the opening's corner."""

    seat_push: Annotated[float, Range(0.0, 10.0, "m/s2")] = 1.5
    """f* towards the opening's corner, until the end lies in the mouth [m/s2]."""
    seat_rate: Annotated[float, Range(0.0, 2000.0, "1/s2")] = 120.0
    """Gain from the corner's missing distance to that push [1/s2]."""
    seat_press: Annotated[float, Range(0.0, 10.0, "m/s2")] = 0.7
    """f* into the opening meanwhile, and `lift` of the push more [m/s2]."""
    lift: Annotated[float, Range(0.0, 1.0, "1")] = 0.18
    """Share of a push that lifts the part [1]: the tilted part leans on the wall."""
    shake: Annotated[float, Range(0.0, 10.0, "m/s2")] = 0.7
    """f* from side to side, against sticking [m/s2]."""


@settings()
class StraightenConfig:
    """Turn of the part until it is upright there."""

    hold_push: Annotated[float, Range(0.0, 10.0, "m/s2")] = 3.3
    """f* towards the opening's corner while the part is turned upright [m/s2]."""
    straighten_time: Annotated[float, Range(0.05, 10.0, "s")] = 0.35
    """Time of that turn [s], slower than `ClampConfig.turn_speed`: what is pushed in
    before it stands upright wedges."""
    leaning: Annotated[float, Range(0.0, 0.2, "rad")] = 0.08
    """Tilt that is left until the end is in [rad]: the corner stays in the opening's.
    A fit that is so tight that the part would wedge is tried upright."""


@settings()
class PushConfig:
    """Push of the part into the opening."""

    lean: Annotated[float, Range(0.0, 10.0, "m/s2")] = 3.0
    """f* towards the opening's corner until the end is in [m/s2]."""
    turn: Annotated[float, Range(0.0, 0.2, "rad")] = 0.09
    """Turn to both sides meanwhile [rad]: the fixture may be turned, too."""
    turn_rate: Annotated[float, Range(0.1, 5.0, "Hz")] = 1.0
    """Frequency of that turn [Hz]."""
    stir: Annotated[float, Range(0.0, 10.0, "m/s2")] = 1.0
    """f* round and round, and towards the corner, of what stands upright [m/s2]."""
    stir_rate: Annotated[float, Range(0.1, 5.0, "Hz")] = 1.5
    """Frequency of that circling [Hz]."""
    press: Annotated[float, Range(0.0, 10.0, "m/s2")] = 1.5
    """f* into the opening, at the end [m/s2]."""


@settings()
class CornerSearchConfig(
    AirConfig, SlideConfig, SeatConfig, StraightenConfig, PushConfig
):
    """Settings of the corner search, found by trials on twins medium and hard."""

    tilt: Annotated[float, Range(0.05, 0.5, "rad")] = 0.2
    """Turn of the part that puts one corner lowest [rad]: it falls in by about 0.14
    of the opening's width."""
