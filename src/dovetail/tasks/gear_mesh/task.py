"""Gear mesh: put a gear on a shaft so that its teeth mesh with a gear beside it."""

from dataclasses import dataclass, field
from typing import ClassVar

from dovetail.errors import ConfigError
from dovetail.tasks.drawn_opening import DrawnOpening
from dovetail.tasks.gear_mesh.geometry import (
    DEPTH,
    REACH,
    SHAFT_RADIUS,
    STALK_RADIUS,
    SUCCESS_DEPTH,
    gear,
    station,
)
from dovetail.tasks.starts import RandomisationConfig
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import Tool, wsg50

STARTS = RandomisationConfig(aside=0.08, height=(0.01, 0.10))
"""Above both gears, and turned by up to 0.2 rad, more than half a tooth."""


@dataclass(frozen=True, kw_only=True)
class GearMesh(DrawnOpening):
    """Put a gear on a shaft beside a gear that stands still, and let the teeth mesh.

    The bore finds the shaft first; 8 mm deeper the teeth meet, and go in where a tooth
    is turned to a gap. The fixture's frame is at the shaft's end, its x axis towards
    the standing gear.
    """

    clearance: float = 0.0002
    """Gap between bore and shaft on each side [m]."""
    randomisation: RandomisationConfig = field(default_factory=lambda: STARTS)
    """Ranges of starts and shafts."""

    done_word: ClassVar[str] = "meshed"
    """The gear lies on the shaft's shoulder, its teeth in the other's."""

    def held(self) -> Part:
        """Return the gear; the middle of its lower face is the TCP."""
        return gear(self.clearance)

    def tool(self) -> Tool:
        """Return the gripper about the gear's stalk."""
        return wsg50(opening=2.0 * STALK_RADIUS, reach=REACH)

    def fixture(self, widened: float) -> Part:
        """Return plate, shaft and standing gear in the shaft's frame.

        Raises:
            ConfigError: The gap would be negative.
        """
        if self.clearance + widened < 0.0 or widened >= SHAFT_RADIUS:
            raise ConfigError(
                f"clearance_offset {1e3 * widened:g} mm with a clearance of "
                f"{1e3 * self.clearance:g} mm; allowed: {-1e3 * self.clearance:g} mm "
                f"to less than {1e3 * SHAFT_RADIUS:g} mm, the shaft's radius"
            )
        return station(widened)

    def depths(self) -> tuple[float, float]:
        """Return how deep the gear goes, and which depth is done [m]."""
        return DEPTH, SUCCESS_DEPTH

    def describe(self) -> list[str]:
        """Return the clearance in words."""
        return ["gear mesh", f"{1e3 * self.clearance:g} mm clearance per side"]
