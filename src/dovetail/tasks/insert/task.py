"""Insert a part that a file describes into its fixture, straight down."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.gripper.facts import FORCE_RANGE, WIDTH_MAX
from dovetail.poses import TOOL_DOWN, Pose
from dovetail.robots.robot import GRAVITY
from dovetail.tasks.drawn_opening import DrawnOpening
from dovetail.tasks.insert.overlap import deepest_overlap
from dovetail.tasks.region import Region
from dovetail.tasks.starts import RandomisationConfig
from dovetail.tasks.task import Goal, Outline
from dovetail.types import Array, Vec3
from dovetail.workcell.end_outline import end_outline
from dovetail.workcell.near_mouth import (
    is_divided,
    post_line,
    sections_near_end,
    sections_near_mouth,
    walled_corner,
)
from dovetail.workcell.part_file import Pair, read_pair
from dovetail.workcell.part_text import require_whole, whole_part
from dovetail.workcell.parts import Part
from dovetail.workcell.pins import led_pin
from dovetail.workcell.tool import GRIP, Tool, wsg50
from dovetail.workcell.workcell import WALLS

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
RAISED_MAX = 0.040
"""Most that a fixture stands higher than others do [m]: starts are up to 120 mm over
its mouth, and keep 20 mm from the walls of the TCP."""
_USUAL = RandomisationConfig()
_LOWEST = _USUAL.middle[2] - _USUAL.half_range[2]
"""Lowest mouth of a usual fixture [m]."""
_UNDER, _WALL_ROOM = 0.005, 0.020
"""Least space under a fixture, and over the TCP's lower wall: what limits keep at 5 ms
[m]."""


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
    raised: float
    """Height of the mouth above that of other fixtures [m]."""


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
    zero_at: ClassVar[str] = "mouth"
    """A policy sees how high the part is over the mouth, not over the floor: it holds
    for any depth. Not where fixtures tilt or open to the robot, as there the zero is
    not the mouth of each."""
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
        if self.tilt > 0.0 or self.facing != "up":
            object.__setattr__(self, "zero_at", "")
        if self.facing == "up" and facts.raised > 0.0:
            self._raise(facts.raised)

    def _raise(self, by: float) -> None:
        """Stand the fixture higher [m], wherever the task places it."""
        x, y, z = self.randomisation.middle
        ranges = replace(self.randomisation, middle=(x, y, z + by))
        made = {
            "randomisation": ranges,
            "trial_poses": tuple(p._replace(z=p.z + by) for p in self.trial_poses),
            "trial_region": Region.about(ranges.middle, ranges.half_range, ranges.yaw),
        }
        if (aside := self.recording_pose) is not None:
            made["recording_pose"] = aside._replace(z=aside.z + by)
        for name, value in made.items():
            object.__setattr__(self, name, value)

    @classmethod
    def whole(
        cls, options: Mapping[str, Any], *, may_read: bool = True
    ) -> dict[str, Any]:
        """Return options with the part's content in place of its path."""
        whole = dict(options)
        if isinstance(part := whole.get("part"), str):
            whole["part"] = whole_part(part) if may_read else require_whole(part)
        return whole

    @classmethod
    def listed(cls, name: str, text: str) -> list[str]:
        """Return the paths that a text lists; a folder's are those of its parts.

        These are its TOML files, or the `part.toml` of each folder in it.

        Raises:
            ConfigError: A folder without any.
        """
        values = super().listed(name, text)
        if name != "part":
            return values
        return [path for value in values for path in _part_files(value)]

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

    def counted(self, error: Vec3, goal: Goal) -> Vec3:
        """Return the error, its depth below the mouth left out beside the mouth.

        A small fixture's part comes lower beside it than in it; no depth counts there.
        Inside is what success calls so: see `IntoOpening.judge`.
        """
        height = float(error @ goal.normal)  # above the floor
        lateral = float(np.linalg.norm(error - height * goal.normal))
        depth = self._depths[0] - height
        if depth <= 0.0 or lateral <= self._lateral_max:
            return error
        return error + depth * goal.normal

    def describe(self) -> list[str]:
        """Return the part and its gap in words."""
        pair = self._pair
        return [pair.name, f"{1e3 * pair.gap:g} mm clearance per side"]

    def outline(self) -> Outline:
        """Return the opening from above, and the fixture around it.

        Of a pair that lists its shapes, it is what the held part's end needs, or the
        post that it goes over.
        """
        pair, fixture = self._pair, self.fixture(0.0)
        outer = float(np.abs(fixture.corners[:, :2]).max())
        sizes = outer, pair.depth
        if (opening := pair.opening) is not None:
            return Outline(_closed(opening), *sizes)
        sections = sections_near_mouth(fixture, pair.depth)
        ends = sections_near_end(pair.held, pair.depth)
        post = post_line(sections, end_outline(pair.held, 0.0))
        if post is not None:
            return Outline(
                _closed(post),
                *sizes,
                is_straight=False,
                is_post=True,
                is_divided=is_divided(post, ends),
            )
        tips = sections_near_end(pair.held, 0.0)
        if (pin := led_pin(ends, tips, sections, pair.gap)) is not None:
            return Outline(
                _closed(pin.opening),
                *sizes,
                is_straight=False,
                corner=pin.corner,
                is_pin=True,
            )
        opening = end_outline(pair.held, pair.gap)
        return Outline(
            _closed(opening),
            *sizes,
            is_straight=False,
            corner=walled_corner(sections, opening),
            is_divided=is_divided(opening, sections),
        )

    @property
    def _pair(self) -> Pair:
        return _facts(self.part).pair


def _closed(line: Array) -> Array:
    return np.vstack([line, line[:1]])


def _part_files(value: str) -> list[str]:
    """Return the files of the parts in a folder, or a path that is none as it is."""
    folder = Path(value).expanduser()
    if not folder.is_dir():
        return [value]
    found = sorted(folder.glob("*.toml")) or sorted(folder.glob("*/part.toml"))
    if not found:
        raise ConfigError(
            f"part: the folder {value!r} has no *.toml and no */part.toml; give a "
            "folder of part files, or the files",
            name="part",
            value=value,
        )
    return [str(path) for path in found]


@lru_cache(maxsize=512)
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
    _require_held(pair, length, grip, top)
    starts, raised = _starts(pair, fixture, top), _raised(pair, fixture)
    return _Facts(pair, length, grip, starts, raised)


def _raised(pair: Pair, fixture: Part) -> float:
    """Return how much higher than others a fixture stands [m]: deep ones need it.

    Raises:
        ConfigError: It is too deep for the walls of the TCP.
    """
    below = -float(fixture.corners[:, 2].min())
    ends = below + _UNDER, pair.depth + WALLS[0][2] + _WALL_ROOM
    raised = max(max(ends) - _LOWEST, 0.0)
    if raised <= RAISED_MAX:
        return raised
    what, value = "its end goes", pair.depth
    if ends[0] > ends[1]:
        what, value = "the fixture reaches", below
    most = value - (raised - RAISED_MAX)
    raise ConfigError(
        f"part {pair.name!r}: {what} {1e3 * value:.4g} mm below the mouth; allowed: up "
        f"to {1e3 * most:.4g} mm, over the table and the walls of the tool; make it "
        "less deep",
        name="part",
        value=value,
        unit="m",
        allowed=(0.0, most),
    )


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
    return replace(
        _USUAL,
        fixture_half=float(np.abs(fixture.corners[:, :2]).max()),
        held_radius=float(np.hypot(*pair.held.corners[:, :2].T).max()),
        gap=_USUAL.gap + top,
    )
