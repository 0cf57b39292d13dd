"""Peg in hole (Kaspar et al. 2020): push a peg into a hole whose pose is known."""

from dataclasses import dataclass, field
from typing import Any

from dovetail.tasks.drawn_opening import DrawnOpening
from dovetail.tasks.opening import widened_gap
from dovetail.tasks.peg_in_hole.geometry import (
    HoleBlock,
    Peg,
    PegShape,
    hole_outline,
)
from dovetail.tasks.starts import (
    RandomisationConfig,
)
from dovetail.tasks.task import Outline
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import Tool, wsg50


@dataclass(frozen=True, kw_only=True)
class PegInHole(DrawnOpening):
    """The paper's task: XYZ as accelerations, the turn about the vertical as a pose.

    The goal is the peg's pose when inserted: its end in the middle of the hole's floor,
    its rotation the hole's. Done is `HoleBlock.success_depth` below the mouth and
    inside the hole. Starts below the block's surface, beside it, are included: see
    `RandomisationConfig`.
    """

    peg: PegShape = "square"
    """Shape of peg and hole: square, triangle or round."""
    clearance: float = 0.0005
    """Gap between peg and hole on each side [m]."""
    block: HoleBlock = field(default_factory=HoleBlock)
    """Block that the peg goes into."""

    def __post_init__(self) -> None:
        """Refuse a peg or a clearance that cannot be built."""
        Peg(shape=self.peg)
        super().__post_init__()

    def held(self) -> Part:
        """Return the peg; its end face is the TCP."""
        return Peg(shape=self.peg).part()

    def tool(self) -> Tool:
        """Return the gripper about the peg."""
        peg = Peg(shape=self.peg)
        return wsg50(opening=peg.width, reach=peg.length)

    def fixture(self, widened: float) -> Part:
        """Return the hole's block in the hole's frame: its mouth's middle, z out.

        Raises:
            ConfigError: The clearance would be negative.
        """
        gap = widened_gap(self.clearance, widened)
        return self.block.part(Peg(shape=self.peg), gap)

    def depths(self) -> tuple[float, float]:
        """Return how deep the opening is, and which depth is done [m]."""
        return self.block.depth, self.block.success_depth

    @classmethod
    def low_starts(cls) -> dict[str, Any]:
        """Return the settings with which the peg starts beside the block."""
        low, _ = RandomisationConfig().height
        return {"randomisation": RandomisationConfig(height=(low, 0.0))}

    def describe(self) -> list[str]:
        """Return peg and clearance in words."""
        words = [f"{self.peg} peg", f"{1e3 * self.clearance:g} mm clearance per side"]
        return words if self.facing == "up" else [*words, f"facing {self.facing}"]

    def outline(self) -> Outline:
        """Return the hole from above, and the block around it."""
        return Outline(
            hole_outline(Peg(shape=self.peg), self.clearance),
            self.block.width / 2.0,
            self.block.depth,
        )
