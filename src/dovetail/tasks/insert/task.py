"""Insert a part that a file describes into its fixture, straight down."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.gripper.facts import FORCE_RANGE, WIDTH_MAX
from dovetail.poses import TOOL_DOWN, Pose
from dovetail.robots.robot import GRAVITY
from dovetail.tasks.drawn_opening import DrawnOpening
from dovetail.tasks.insert.overlap import deepest_overlap
from dovetail.tasks.starts import RandomisationConfig
from dovetail.tasks.task import Outline
from dovetail.workcell.part_file import Pair, read_pair
from dovetail.workcell.part_text import require_whole, whole_part
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import GRIP, Tool, wsg50

HEXAGON = (
    '{"name": "hexagon", "units": "mm", "outline": "hexagon 20", "depth": 20, '
    '"gap": 0.3, "length": 70, "chamfer": 1}'
)
"""The part where none is given."""
_FRICTION, _SAFETY = 0.1, 2.0
"""Friction of steel fingers and safety against slipping, the rule of gripper makers."""
PAYLOAD_MAX = FORCE_RANGE[1] * _FRICTION / _SAFETY / float(np.linalg.norm(GRAVITY))
"""Heaviest part that a WSG 50 holds by friction [kg], at 80 N (data sheet)."""
LENGTH_MAX = 0.110
"""Longest part between flange and TCP [m]: with it the fingers are 17 mm long."""
_SLACK = 0.002  # [m] above the floor that is deep enough, at most a tenth of the depth
_OVERLAP = 1e-5  # [m] of two parts in one another, beyond rounding
BELOW_MAX = 0.075
"""Most that a fixture reaches below its mouth [m]: mouths are 80 to 120 mm high."""


class _Facts(NamedTuple):
    """Facts of a pair for tool and starts."""

    pair: Pair
    """The pair."""
    length: float
    """Length of the held part [m]."""
    grip: float
    """Width between the fingers [m]."""
    starts: RandomisationConfig
    """Usual ranges of starts and fixtures."""


@dataclass(frozen=True, kw_only=True)
class Insert(DrawnOpening):
    """Insert a part into its fixture, both described by a file.

    XYZ are accelerations, the turn about the vertical is a pose. Starts are turned by
    at most 0.2 rad from the fixture, so a part that fits in several turns goes in by
    the nearest.
    """

    part: str = HEXAGON
    """Parts that go together: the path of a TOML file, see docs/your-own-part.md. The
    task, and a policy, hold the content."""
    clearance: float = field(init=False)
    """Gap on each side [m]: the file's."""
    randomisation: RandomisationConfig = field(init=False)
    """Ranges of starts and fixtures: the usual ones, free of this fixture."""

    def __post_init__(self) -> None:
        """Read the part, and refuse one that cannot be held or inserted."""
        object.__setattr__(self, "part", whole_part(self.part))
        facts = _facts(self.part)
        object.__setattr__(self, "clearance", facts.pair.gap)
        object.__setattr__(self, "randomisation", facts.starts)
        super().__post_init__()

    @classmethod
    def whole(
        cls, options: Mapping[str, Any], *, may_read: bool = True
    ) -> dict[str, Any]:
        """Return options with the part's content in place of its path."""
        whole = dict(options)
        if isinstance(part := whole.get("part"), str):
            whole["part"] = whole_part(part) if may_read else require_whole(part)
        return whole

    def held(self) -> Part:
        """Return the held part; its end is the TCP."""
        return self._pair.held

    def tool(self) -> Tool:
        """Return the gripper about the held part."""
        facts = _facts(self.part)
        return wsg50(opening=facts.grip, reach=facts.length)

    def fixture(self, widened: float) -> Part:
        """Return the fixture in its own frame: its mouth's middle, z out.

        Raises:
            ConfigError: The gap would be negative.
        """
        return self._pair.make_fixture(widened)

    def depths(self) -> tuple[float, float]:
        """Return how deep the opening is, and which depth is done [m]."""
        depth = self._pair.depth
        return depth, depth - min(_SLACK, depth / 10.0)

    def describe(self) -> list[str]:
        """Return the part and its gap in words."""
        pair = self._pair
        return [pair.name, f"{1e3 * pair.gap:g} mm clearance per side"]

    def outline(self) -> Outline | None:
        """Return the opening from above, and the fixture around it."""
        pair = self._pair
        if pair.opening is None:
            return None
        corners = self.fixture(0.0).corners
        closed = np.vstack([pair.opening, pair.opening[:1]])
        outer = float(np.abs(corners[:, :2]).max())
        return Outline(closed, outer, pair.depth, -float(corners[:, 2].min()))

    @property
    def _pair(self) -> Pair:
        return _facts(self.part).pair


@lru_cache(maxsize=64)
def _facts(text: str) -> _Facts:
    """Return what a pair asks of tool and starts, or refuse it.

    Raises:
        ConfigError: The parts overlap where they should stand in the end, or the held
            part is too heavy, too long, too wide or too short to be held.
    """
    pair = read_pair(text)
    corners, fixture = pair.held.corners, pair.make_fixture(0.0)
    length = -float(corners[:, 2].min())
    held = corners[corners[:, 2] < GRIP - length + 1e-9]
    grip = 2.0 * float(np.abs(held[:, 0]).max())
    end = Pose(np.array([0.0, 0.0, -pair.depth]), TOOL_DOWN)
    if (found := deepest_overlap(fixture, pair.held, end)) and found.depth > _OVERLAP:
        raise ConfigError(
            f"part {pair.name!r}: where it should stand in the end, its shape "
            f"{found.other!r} is {1e3 * found.depth:.3f} mm inside the fixture's "
            f"{found.one!r}: make the held part smaller, or the opening larger",
            name="part",
        )
    top = max(float(fixture.corners[:, 2].max()), 0.0)
    if (below := -float(fixture.corners[:, 2].min())) > BELOW_MAX:
        raise ConfigError(
            f"part {pair.name!r}: the fixture reaches {1e3 * below:.4g} mm below its "
            f"mouth; allowed: up to {1e3 * BELOW_MAX:g} mm, over the table",
            name="part",
            value=below,
            unit="m",
            allowed=(0.0, BELOW_MAX),
        )
    _require_held(pair, length, grip, top)
    return _Facts(pair, length, grip, _starts(pair, fixture, top))


def _require_held(pair: Pair, length: float, grip: float, top: float) -> None:
    """Refuse a part that the gripper cannot hold until it is inserted."""
    mass = sum(shape.mass for shape in pair.held.primitives)
    shortest = pair.depth + top + GRIP
    ranges = (
        (mass, 0.0, PAYLOAD_MAX, 1.0, "kg", "lower its density, or hollow it"),
        (length, shortest, LENGTH_MAX, 1e3, "mm long", "change its length"),
        (grip, 1e-3, WIDTH_MAX, 1e3, "mm wide", "turn it: fingers close along x"),
    )
    for value, low, high, scale, unit, remedy in ranges:
        if not low <= value <= high:
            span = f"{scale * low:.4g} to {scale * high:.4g} {unit}"
            raise ConfigError(
                f"part {pair.name!r}: the held part is {scale * value:.4g} {unit}; a "
                f"WSG 50 holds {span} until it is inserted; {remedy}",
                name="part",
                value=value,
                unit="kg" if scale == 1.0 else "m",
                allowed=(low, high),
            )


def _starts(pair: Pair, fixture: Part, top: float) -> RandomisationConfig:
    """Return the usual starts, in free air about this fixture."""
    usual = RandomisationConfig()
    return replace(
        usual,
        fixture_half=float(np.abs(fixture.corners[:, :2]).max()),
        held_radius=float(np.hypot(*pair.held.corners[:, :2].T).max()),
        gap=usual.gap + top,
    )
