"""A cell's own facts, of a cell file: table, tool, walls, and where fixtures stand.

What a file does not give is the task's own. Every length is in metres, every angle in
radians, every mass in kilograms; all positions are in the world's frame, whose origin
is the robot's base.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import BeforeValidator, model_validator
from tyro.constructors import PrimitiveConstructorSpec

from dovetail.errors import ConfigError, DovetailError
from dovetail.poses import Pose, quat_about_z
from dovetail.reading import read_toml
from dovetail.settings import (
    Range,
    defaults_of,
    fill_in,
    names_in,
    ranges_of,
    settings,
    unknown_settings,
    values_of,
)
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import (
    GRIPPERS,
    OPENING_MAX,
    Tool,
    bare_flange,
    grip_with,
)
from dovetail.workcell.workcell import (
    START_MARGIN,
    TABLE,
    Fixtures,
    Walls,
    Workcell,
)

_XYZ = ("x", "y", "z")
_PLACE = Range(-3.0, 3.0, "m", _XYZ)


@settings(owner="cell")
class TableConfig:
    """The table."""

    table_height: Annotated[float, Range(-1.0, 1.5, "m")] = 0.0
    """Height of its top over the robot's base [m]."""
    table_centre: Annotated[tuple[float, ...], Range(-3.0, 3.0, "m", ("x", "y"))] = (
        0.4,
        0.0,
    )
    """Middle of its top, x y [m]."""
    table_size: Annotated[tuple[float, ...], Range(0.05, 10.0, "m", ("x", "y"))] = (
        1.6,
        1.6,
    )
    """Extent of its top along x and y [m]."""


@settings(owner="cell")
class ToolConfig:
    """The tool on the flange."""

    tool: Literal["wsg50", "franka_hand", "robotiq_2f85", "none"] | None = None
    """Tool: a gripper, or none: the part is on the flange, by a holder of the length
    and mass that are given. Left out, it is the robot's usual gripper, or the task's
    own tool."""
    tool_length: Annotated[float | None, Range(0.03, 1.5, "m")] = None
    """Flange to the TCP, which is the end of the held part [m]; usually 0.18."""
    tool_mass: Annotated[float | None, Range(0.0, 30.0, "kg")] = None
    """Mass of the gripper with its fingers, or of the holder, without the part [kg];
    usually 1.2."""
    tool_opening: Annotated[float, Range(0.001, OPENING_MAX, "m")] = OPENING_MAX
    """Largest opening of the fingers [m]; a WSG 50's own stroke is 0.110."""


@settings(owner="cell")
class BoundsConfig:
    """Walls of the TCP, and where fixtures stand and episodes start."""

    walls_low: Annotated[tuple[float, ...] | None, _PLACE] = None
    """Lower walls of the TCP, x y z [m]."""
    walls_high: Annotated[tuple[float, ...] | None, _PLACE] = None
    """Upper walls of the TCP, x y z [m]."""
    fixture_low: Annotated[tuple[float, ...] | None, _PLACE] = None
    """Lower corner of the box in which the fixture's frame is drawn, x y z [m]."""
    fixture_high: Annotated[tuple[float, ...] | None, _PLACE] = None
    """Upper corner of that box, x y z [m]; equal to the lower one it is one place."""
    fixture_yaw: Annotated[
        tuple[float, ...] | None, Range(-3.2, 3.2, "rad", ("low", "high"))
    ] = None
    """Range of the fixture's turn about the vertical: low high [rad]."""
    start_low: Annotated[tuple[float, ...] | None, _PLACE] = None
    """Lower corner of the box in which the TCP starts, x y z [m]."""
    start_high: Annotated[tuple[float, ...] | None, _PLACE] = None
    """Upper corner of that box, x y z [m]."""


@settings()
class CellConfig(TableConfig, ToolConfig, BoundsConfig):
    """Everything that a cell file may give."""

    @model_validator(mode="after")
    def _check_cell_config(self) -> Self:
        """Refuse bounds that exclude each other, and half of what belongs together."""
        self._require_ordered("walls_low", "walls_high", can_be_equal=False)
        self._require_ordered("fixture_low", "fixture_high", can_be_equal=True)
        self._require_ordered("start_low", "start_high", can_be_equal=False)
        self._require_together("fixture_low", "fixture_high", "fixture_yaw")
        self._require_together("start_low", "start_high")
        if self.fixture_yaw is not None and self.fixture_yaw[0] > self.fixture_yaw[1]:
            low, high = self.fixture_yaw
            raise ConfigError(
                f"fixture_yaw is {low:g} to {high:g} rad; give the smaller one first",
                name="fixture_yaw",
                value=self.fixture_yaw,
            )
        if self.tool == "none":
            self._require_together("tool_length", "tool_mass", beside='tool = "none"')
        return self

    def _require_ordered(self, low: str, high: str, *, can_be_equal: bool) -> None:
        """Refuse a box whose lower corner is not below its upper one."""
        a, b = vars(self)[low], vars(self)[high]
        if a is None or b is None:
            return
        for axis, x, y in zip(_XYZ, a, b, strict=True):
            if x > y or (x == y and not can_be_equal):
                raise ConfigError(
                    f"{low} {axis} is {x:g} m and {high} {axis} is {y:g} m, which "
                    f"exclude each other: give {low} {axis} below {high} {axis}",
                    name=f"{low}[{axis}]",
                    value=x,
                    unit="m",
                )

    def _require_together(self, *names: str, beside: str = "") -> None:
        """Refuse some of these keys without the others."""
        given = [name for name in names if vars(self)[name] is not None]
        missing = [name for name in names if name not in given]
        if missing and (given or beside):
            units = ranges_of(CellConfig)
            wanted = ", ".join(f"{n} [{units[n].unit}]" for n in missing)
            raise ConfigError(
                f"{beside or ' and '.join(given)} is given without {wanted}: give "
                f"{', '.join(names)} together",
                name=missing[0],
            )

    @property
    def file(self) -> str:
        """Path of the file that it was read from, else a name for one."""
        return str(vars(self).get("_file", "cell.toml"))

    @property
    def gives_walls(self) -> bool:
        """True if the file says where the TCP may go, or start."""
        given = self.walls_low, self.walls_high, self.start_low
        return any(corner is not None for corner in given)

    def table(self) -> dict[str, Any]:
        """Return what differs from the usual cell, by key, as a file holds it."""
        usual, own = defaults_of(CellConfig), values_of(self)
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in own.items()
            if value != usual[name]
        }

    def describe(self) -> str:
        """Return in words what differs from the usual cell; empty for nothing."""
        return ", ".join(f"{n} {_words(value)}" for n, value in self.table().items())

    def top(self) -> Part:
        """Return the table."""
        usual = TABLE.primitives[0]
        thick = usual.size[2]
        x, y = self.table_centre
        half = (self.table_size[0] / 2.0, self.table_size[1] / 2.0, thick)
        at = np.array([x, y, self.table_height - thick])
        return Part("table", (usual._replace(size=half, position=at),))

    def fit(self, usual: Workcell) -> Workcell:
        """Return a task's cell with these facts in the place of its own.

        Raises:
            ConfigError: The tool cannot hold the part; or walls that exclude each
                other, the table or the starts.
        """
        if not (said := self.describe()):
            return usual
        low, high = usual.walls
        walls = self.walls_low or low, self.walls_high or high
        self._require_walls(walls)
        return replace(
            usual,
            name=f"{usual.name}, cell: {said}",
            own=said,
            place=usual.place if self.fixture_low is None else self._place(),
            tool=self._tool(usual.tool, usual.held),
            walls=walls,
            fixtures=self._fixtures(),
            table=self.top(),
            starts=self._starts(),
        )

    def _place(self) -> Pose:
        """Return the middle of the region of fixtures."""
        middle = (np.array(self.fixture_low) + np.array(self.fixture_high)) / 2.0
        yaw = float(np.mean(self.fixture_yaw or 0.0))
        return Pose(middle, quat_about_z(yaw))

    def _fixtures(self) -> Fixtures | None:
        if self.fixture_low is None:
            return None
        assert self.fixture_high is not None
        assert self.fixture_yaw is not None
        return self.fixture_low, self.fixture_high, self.fixture_yaw

    def _starts(self) -> Walls | None:
        if self.start_low is None or self.start_high is None:
            return None
        return self.start_low, self.start_high

    def _require_walls(self, walls: Walls) -> None:
        """Refuse walls without an inside, through the table, or that exclude starts."""
        for axis, low, high in zip(_XYZ, *walls, strict=True):
            if low >= high:
                raise ConfigError(
                    f"cell walls_low {axis} is {low:g} m and walls_high {axis} is "
                    f"{high:g} m, with the task's own where the file gives one: they "
                    "exclude each other; give both, the lower one smaller",
                    name=f"walls_low[{axis}]",
                )
        if walls[0][2] < self.table_height:
            raise ConfigError(
                f"cell walls_low z is {walls[0][2]:g} m, below the table's top at "
                f"table_height {self.table_height:g} m: give walls_low z from "
                f"{self.table_height:g} m, usually 0.03 m above it",
                name="walls_low[z]",
                value=walls[0][2],
                unit="m",
            )
        if (starts := self._starts()) is None:
            return
        for axis, *at in zip(_XYZ, *starts, *walls, strict=True):
            first, last, low, high = at
            if first < low + START_MARGIN - 1e-9 or last > high - START_MARGIN + 1e-9:
                raise ConfigError(
                    f"cell start_low to start_high reach from {axis} = {first:g} to "
                    f"{last:g} m, the walls allow {low + START_MARGIN:g} to "
                    f"{high - START_MARGIN:g} m: move the starts, or the walls",
                    name=f"start_low[{axis}]",
                    value=first,
                    unit="m",
                )

    def _tool(self, own: Tool, held: Part) -> Tool:
        """Return the tool about the held part.

        Raises:
            ConfigError: It opens too little, is too short, or is not to be changed.
        """
        length, mass = self.tool_length, self.tool_mass
        reach = own.reach or -float(held.corners[:, 2].min())
        if self.tool == "none":
            assert length is not None
            assert mass is not None
            return bare_flange(reach=reach, length=length, mass=mass)
        if own.opening is not None and own.opening > self.tool_opening:
            raise ConfigError(
                f"cell tool_opening is {self.tool_opening:g} m, and the {held.name} is "
                f"{own.opening:g} m wide between the fingers: give a wider opening, up "
                f"to {OPENING_MAX:g} m, or a smaller part",
                name="tool_opening",
                value=self.tool_opening,
                unit="m",
                allowed=(own.opening, OPENING_MAX),
            )
        if self.tool in (None, own.name) and length is None and mass is None:
            return own
        if own.opening is None:
            raise ConfigError(
                f"cell tool, tool_length or tool_mass is given, and the task has a "
                f"tool of its own, {own.name}: leave them out, or let the task's "
                "tool() return a gripper"
            )
        return grip_with(
            GRIPPERS[self.tool or own.name],
            opening=own.opening,
            reach=reach,
            length=length,
            mass=mass,
        )


def _words(value: Any) -> str:
    if isinstance(value, list):
        return "(" + " ".join(map(str, value)) + ")"
    return str(value)


def load_cell(path: str | Path) -> CellConfig:
    """Read a cell file.

    Raises:
        ConfigError: It cannot be read, is not TOML, has an unknown key or a wrong
            value, or bounds that exclude each other; names the file.
    """
    path = Path(path).expanduser()
    try:
        table = read_toml(path)
    except FileNotFoundError as error:
        raise ConfigError(
            f"there is no cell file {path}: give the path of a TOML file "
            "(docs/your-own-cell.md)"
        ) from error
    except OSError as error:
        raise ConfigError(
            f"cannot read the cell file {path}: {error.strerror}"
        ) from error
    try:
        cell = cell_of(table)
        fill_in(cell, _file=path)
        return cell
    except ConfigError as error:
        error.args = (f"{path}: {error}",)
        raise


def cell_of(table: Any) -> CellConfig:
    """Return what the content of a cell file says.

    Raises:
        ConfigError: It is no table, has an unknown key or a wrong value.
    """
    if not isinstance(table, Mapping):
        raise ConfigError(
            f"cell is {str(table)[:60]!r}; needed: a table of {', '.join(_KEYS)}"
        )
    if unknown := set(map(str, table)) - set(_KEYS):
        raise unknown_settings(unknown, _KEYS, "the cell")
    for name, allowed in ranges_of(CellConfig).items():
        value = table.get(name)
        if allowed.labels and value is not None and not isinstance(value, list | tuple):
            raise ConfigError(
                f"cell {name} is {value!r}; give {len(allowed.labels)} numbers in "
                f"{allowed.unit}: {' '.join(allowed.labels)}",
                name=name,
                value=value,
                unit=allowed.unit,
            )
    return CellConfig(**table)


_KEYS = names_in(CellConfig)


def _read(value: Any) -> Any:
    """Return a setting's value as a cell: a file's path, its content, or a cell."""
    if value is None or isinstance(value, CellConfig):
        return value
    return load_cell(value) if isinstance(value, str | Path) else cell_of(value)


def _from_words(words: list[str]) -> CellConfig:
    try:
        return load_cell(words[0])
    except ConfigError as error:  # tyro would put a frame around a ValueError
        raise DovetailError(str(error)) from error


CellFile: TypeAlias = Annotated[
    CellConfig | None,
    BeforeValidator(_read),
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="FILE",
        instance_from_str=_from_words,
        is_instance=lambda value: value is None or isinstance(value, CellConfig),
        str_from_instance=lambda cell: ["None"],
    ),
]
"""Type of a setting that holds a cell: in Python a `CellConfig`, the path of a file or
its content; on a command line the path."""
