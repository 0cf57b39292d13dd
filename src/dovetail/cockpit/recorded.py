"""A recorded episode, ready to be drawn: its cell, and its state at any time.

A log of unknown origin may name one of dovetail's tasks and robots, but no module: only
the user who replays it may name one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from dovetail.cockpit.episode_logger import BELIEVED, FIXTURE, PULL
from dovetail.envs.log_facts import CELL
from dovetail.envs.registered import task_of_file
from dovetail.episode import Episode
from dovetail.errors import ConfigError, LogError
from dovetail.plugins import module_of, require_unread
from dovetail.poses import Pose
from dovetail.robots.find import (
    DEFAULT_ROBOT,
    find_robot,
    robot_label,
    whole_robot,
)
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.types import Array, Vec3, Vec7
from dovetail.workcell.cell_config import CellConfig, cell_of
from dovetail.workcell.workcell import Workcell

COLUMNS = ("time", "force", "torque", "speed", "reward", "apart")
"""Time since the log's begin [s], contact force [N], largest joint torque [Nm], speed
of the TCP [m/s], reward [1], distance of the TCP from the other log's [mm]."""
_POINTS = 600  # of a curve
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """One log and its cell."""

    name: str
    """Name of its file, with its folder."""
    cell: Workcell
    """Workcell of the episode."""
    time: Array
    """Time of each cycle since the first [s], shape (cycles,)."""
    q: Array
    """Joint angles [rad], shape (cycles, 7)."""
    position: Array
    """TCP [m], world axes, shape (cycles, 3)."""
    force: Array
    """Contact force [N], world axes, shape (cycles, 3): the estimated one where it was
    not measured, not-a-number where neither was known."""
    parts: Array
    """Positions of the joints of the cell's parts [rad, m], shape (cycles, joints); no
    column where the log has none."""
    is_estimated: bool
    """True if no cycle has a measured force."""
    fixtures: tuple[tuple[float, Pose], ...]
    """True poses of the fixture, each with its time of begin [s]."""
    believed: tuple[tuple[float, Pose], ...]
    """Believed poses of the fixture, likewise; empty where the log has none."""
    pulls: tuple[tuple[float, Vec3], ...]
    """Forces of the user's pull [N], world axes, likewise."""
    curves: Array
    """`COLUMNS` of some cycles, shape (points, columns)."""

    @classmethod
    def load(
        cls, path: Path, *, env: str | None = None, robot: str | None = None
    ) -> Self:
        """Read a log, and find its cell.

        Args:
            path: The Episode log.
            env: Its environment, if the log does not name it, or names a module's.
            robot: Its robot, likewise.

        Raises:
            LogError: Damaged, empty, or of another robot than the one given.
            ConfigError: No such environment or robot, or a module's that was not given.
        """
        episode = Episode.load(path)
        if len(episode) == 0:
            raise LogError(f"the log {path} is empty: nothing was recorded")
        facts = episode.metadata.get(CELL, {})
        if not isinstance(facts, Mapping):
            raise LogError(f"the log {path}: its metadata {CELL!r} is no table")
        logged_robot = facts.get("robot", episode.metadata.get("robot"))
        env_id = _named("env", env, facts.get("env_id"), DEFAULT_ENV)
        given = None if robot is None else whole_robot(robot)
        robot_name = _named("robot", given, logged_robot, DEFAULT_ROBOT)
        settings = facts.get("task", {})
        task = task_of_file(env_id, settings if isinstance(settings, Mapping) else {})
        cell = task.workcell(find_robot(robot_name), _cell_of(path, facts))
        columns = {name: episode[name] for name in episode.columns}
        begin = float(columns["time"][0])
        time = columns["time"] - begin
        first = task.trial_poses[0]
        pulls = _rows(path, episode.metadata, PULL, 4)
        return cls(
            name=f"{path.resolve().parent.name}/{path.stem}",
            cell=cell,
            time=time,
            q=_stack(columns, *(f"q{i}" for i in range(1, 8))),
            position=_stack(columns, "x", "y", "z"),
            force=_force(columns),
            parts=_parts(columns, [joint.column for joint in cell.joints]),
            is_estimated=bool(np.isnan(columns["fx"]).all()),
            fixtures=_fixtures(path, episode.metadata, begin, first),
            believed=_poses(_rows(path, episode.metadata, BELIEVED, 8), begin),
            pulls=tuple((float(row[0]) - begin, row[1:]) for row in pulls),
            curves=_curves(columns, time),
        )

    @property
    def end(self) -> float:
        """Length [s]."""
        return float(self.time[-1])

    def at(self, time: float) -> tuple[Vec7, Vec3, Pose]:
        """Return joint angles, contact force and fixture at a time [s] since its begin.

        Before the first cycle they are the first one's, after the last the last one's.
        """
        row = self._row(time)
        return self.q[row], self.force[row], _latest(self.fixtures, time)

    def parts_at(self, time: float) -> Array:
        """Return the positions of the parts' joints at a time [s]; empty is unknown."""
        return self.parts[self._row(time)]

    def believed_at(self, time: float) -> Pose | None:
        """Return the fixture's believed pose at a time [s]; None is unknown."""
        return _latest(self.believed, time) if self.believed else None

    def pull_at(self, time: float) -> Vec3:
        """Return the force of the user's pull at a time [s], world axes [N]."""
        return _latest(self.pulls, time) if self.pulls else np.zeros(3)

    def path(self, time: float) -> Array:
        """Return the path of the TCP until a time [m], shape (points, 3)."""
        end = self._row(time) + 1
        return self.position[: end : max(1, end // _POINTS)]

    def _row(self, time: float) -> int:
        row = int(np.searchsorted(self.time, time, side="right")) - 1
        return min(max(row, 0), len(self.time) - 1)

    def compared(self, other: "Recorded") -> Array:
        """Return the curves, with the distance of the TCP from another log's [mm].

        Both are taken at the same time since their begin; beyond the other's end there
        is nothing to compare.
        """
        curves = self.curves.copy()
        for axis in range(3):
            own, their = (
                np.interp(curves[:, 0], log.time, log.position[:, axis])
                for log in (self, other)
            )
            curves[:, -1] = np.hypot(curves[:, -1], 1e3 * (own - their))
        curves[curves[:, 0] > other.end, -1] = np.nan
        return curves


def _cell_of(path: Path, facts: Mapping[str, Any]) -> CellConfig | None:
    """Return what the log's cell file said, if there was one.

    Raises:
        LogError: It is damaged.
    """
    if (table := facts.get("cell")) is None:
        return None
    try:
        return cell_of(table)
    except ConfigError as error:
        raise LogError(f"the log {path}: its cell: {error}") from error


def _latest(changes: Sequence[tuple[float, T]], time: float) -> T:
    """Return the value at a time [s]: of the last change before it, or of the first."""
    found = changes[0][1]
    for begin, value in changes:
        if begin <= time:
            found = value
    return found


def _stack(columns: Mapping[str, Array], *names: str) -> Array:
    return np.column_stack([columns[name] for name in names])


def _force(columns: Mapping[str, Array]) -> Array:
    measured = _stack(columns, "fx", "fy", "fz")
    estimated = _stack(columns, "wrench_fx", "wrench_fy", "wrench_fz")
    return np.where(np.isnan(measured), estimated, measured)


def _curves(columns: Mapping[str, Array], time: Array) -> Array:
    chosen = np.unique(np.linspace(0, len(time) - 1, _POINTS).astype(int))
    torque = np.abs(_stack(columns, *(f"tau{i}" for i in range(1, 8)))).max(axis=1)
    force = np.linalg.norm(_force(columns), axis=1)
    speed = np.linalg.norm(_stack(columns, "vx", "vy", "vz"), axis=1)
    rows = (time, force, torque, speed, columns["reward"], np.zeros(len(time)))
    return np.column_stack(rows)[chosen]


def _named(what: str, given: str | None, logged: Any, usual: str) -> str:
    """Return the name given, the one in the log, or the usual one.

    Raises:
        ConfigError: The log names a module, or another than the one given.
    """
    if not isinstance(logged, str) or not logged:
        return given or usual
    require_unread("the log", what, logged)
    if given is None and module_of(what, logged):
        raise ConfigError(
            f"the log's {what} is {logged[:80]!r}, of a module; add --{what} "
            f"{logged[:80]} if you trust it"
        )
    if given is not None and _last_word(what, given) != _last_word(what, logged):
        raise ConfigError(
            f"{what} is {robot_label(given)[:80]!r}, the log says "
            f"{robot_label(logged)[:80]!r}; leave --{what} out"
        )
    return given or logged


def _last_word(what: str, name: str) -> str:
    """Return what a name calls: ours and a module's function may be the same."""
    return name.rpartition(":")[2] if module_of(what, name) else name


def _rows(path: Path, metadata: Mapping[str, Any], key: str, width: int) -> Array:
    """Return the rows of a path in a log; none if it has no such path."""
    try:
        rows = np.array(metadata.get(key, []), dtype=float).reshape(-1, width)
    except (TypeError, ValueError) as error:
        raise LogError(f"the log {path}: its {key!r} is no table: {error}") from error
    if not np.isfinite(rows).all():
        raise LogError(f"the log {path}: a number of its {key!r} is not finite")
    return rows


def _poses(rows: Array, begin: float) -> tuple[tuple[float, Pose], ...]:
    """Return rows of time, position and rotation as poses, by the time since begin."""
    return tuple((float(row[0]) - begin, Pose(row[1:4], row[4:8])) for row in rows)


def _parts(columns: Mapping[str, Array], names: list[str]) -> Array:
    """Return the joints of the parts; where the log has not all, no column."""
    if not names or not {*names} <= {*columns}:
        return np.zeros((len(columns["time"]), 0))
    return _stack(columns, *names)


def _fixtures(
    path: Path, metadata: Mapping[str, Any], begin: float, first: FixturePose
) -> tuple[tuple[float, Pose], ...]:
    """Return the poses of the fixture; where the log has none, the task's first."""
    poses = _poses(_rows(path, metadata, FIXTURE, 8), begin)
    try:
        if FIXTURE not in metadata and "fixture_pose" in metadata:  # of `evaluate`
            poses = ((0.0, FixturePose(**metadata["fixture_pose"]).pose()),)
        elif FIXTURE not in metadata and "fixture" in metadata:
            place = FixturePose.given(metadata["fixture"], first.facing)
            poses = ((0.0, place.pose()),)
        places = np.array([[*p.position, *p.quat_wxyz] for _, p in poses], dtype=float)
    except (TypeError, ValueError) as error:
        raise LogError(
            f"the log {path} does not say where its fixture was: {error}"
        ) from error
    if not np.isfinite(places).all():
        raise LogError(f"the log {path}: a place of its fixture is not finite")
    return poses or ((0.0, first.pose()),)
