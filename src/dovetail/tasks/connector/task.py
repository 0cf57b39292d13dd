"""Connector: push a plug, which the fingers hold a little wrong, into its port."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from dovetail.errors import ConfigError
from dovetail.tasks.connector.geometry import (
    DEPTH,
    LENGTH,
    SECTIONS,
    SUCCESS_DEPTH,
    Kind,
    plug,
    port,
)
from dovetail.tasks.drawn_opening import DrawnOpening
from dovetail.tasks.grasp import Grasp
from dovetail.tasks.opening import widened_gap
from dovetail.tasks.starts import RandomisationConfig
from dovetail.tasks.task import Outline
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import Tool, wsg50

STARTS = RandomisationConfig(aside=0.06, height=(0.02, 0.08))
"""Over the port, as after a look from above."""


@dataclass(frozen=True, kw_only=True)
class Connector(DrawnOpening):
    """Push a plug into its port; where it is in the fingers nobody has measured.

    It may be displaced by 2 mm along each axis and turned by 0.04 rad about each, more
    than the port forgives. So it is found by touch, and turned upright in the port.
    """

    axes: str = "XYZ:force ABC:pose"
    """Mode of each axis: a plug that is held askew has to be turned upright."""
    connector: Kind = "sfp"
    """Connector: sfp or sc."""
    randomisation: RandomisationConfig = field(default_factory=lambda: STARTS)
    """Ranges of starts and ports."""
    clearance: float = field(init=False, default=0.0)
    """Gap on the narrower sides [m], of the connector."""

    done_word: ClassVar[str] = "plugged in"
    """The plug is in the port, deep enough."""
    training: ClassVar[Mapping[str, Any]] = {
        "recall": (4, 8, 12, 16),
        "informed": True,
        "theta_range": 0.1,
        "steps": 120_000,
    }
    """A policy finds out by touch how the plug is held, so it remembers where it has
    been, and its critics are told. It turns by a tenth of a radian at most, and learns
    from more steps than usual."""
    grasp: ClassVar[Grasp] = Grasp(0.002, 0.04)
    """As the grasp of the AI for Industry Challenge."""
    columns: ClassVar[tuple[str, ...]] = (
        *("joints", "position", "theta", "tilt", "velocity"),
    )

    def __post_init__(self) -> None:
        """Refuse a connector that is not known."""
        if self.connector not in SECTIONS:
            raise ConfigError(
                f"connector {self.connector!r} is unknown; known: {', '.join(SECTIONS)}"
            )
        section = SECTIONS[self.connector]
        gaps = [(o - i) / 2.0 for i, o in zip(section.plug, section.port, strict=True)]
        object.__setattr__(self, "clearance", min(gaps))
        super().__post_init__()

    def held(self) -> Part:
        """Return the plug; the middle of its end face is the TCP."""
        return plug(self.connector)

    def tool(self) -> Tool:
        """Return the gripper about the plug's wide side."""
        return wsg50(opening=SECTIONS[self.connector].plug[0], reach=LENGTH)

    def fixture(self, widened: float) -> Part:
        """Return the board with the port, in the port's frame.

        Raises:
            ConfigError: A gap would be negative.
        """
        widened_gap(self.clearance, widened)
        return port(self.connector, widened)

    def depths(self) -> tuple[float, float]:
        """Return how deep the port is, and which depth is done [m]."""
        return DEPTH, SUCCESS_DEPTH

    def outline(self) -> Outline:
        """Return the port from above, and the board around it."""
        x, y = (side / 2.0 for side in SECTIONS[self.connector].port)
        opening = np.array([[x, y], [-x, y], [-x, -y], [x, -y], [x, y]])
        corners = self.fixture(0.0).corners
        outer = float(np.abs(corners[:, :2]).max())
        return Outline(opening, outer, DEPTH)

    def describe(self) -> list[str]:
        """Return the connector in words."""
        return [f"{self.connector} connector"]
