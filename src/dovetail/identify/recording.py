"""The log of scripted motions, and what has to be true of it before it is fitted.

A recording is a folder: `recording.json` says how it was made, and one Episode file
for each sequence, `sequence-00.npz` on, holds every control cycle.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.limits import ApproachLimits
from dovetail.control.proven import DECLARED
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import task_class, task_of_file
from dovetail.episode import Episode
from dovetail.errors import ConfigError, LogError
from dovetail.identify.log_checks import (
    assign_steps,
    read_targets,
    require_gapless,
    require_numbers,
    require_robot,
    require_same_facts,
)
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from dovetail.plugins import require_trusted
from dovetail.poses import Pose
from dovetail.reading import read_json
from dovetail.robots.find import find_robot
from dovetail.robots.robot import Robot
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.options import option_types
from dovetail.tasks.task import Task
from dovetail.types import Array, Vec7
from dovetail.workcell.cell_config import CellConfig, cell_of
from dovetail.workcell.workcell import Workcell

FORMAT = 2
DESCRIPTION = "recording.json"
TARGETS = "targets"
"""Key of a sequence's metadata: columns and rows of the Target of each step."""
_KEYS = (
    *("format", "env_id", "arm_model", "robot", "task", "period", "fixture", "arm"),
    *("commands", "controller", "excitation", "q_start"),
)
_KINDS: Mapping[str, Any] = {
    **dict.fromkeys(("env_id", "arm_model", "robot", "task", "arm"), str),
    **dict.fromkeys(("commands", "controller", "excitation"), dict),
    **{"period": (int, float), "q_start": list},
}
"""Types of some of them; the others are checked where they are read."""
_UNFITTED = ("env_id", "arm_model", "created", "version", "delay")
"""Keys that do not affect a fit; the task's options stand beside them."""


@dataclass(frozen=True)
class Sequence:
    """One scripted motion as it was played and logged."""

    q_start: Vec7
    """Configuration at the reset, as measured [rad], shape (7,)."""
    targets: Array
    """The Target of each step, columns `TARGET_UNITS`."""
    log: Array
    """One row for each control cycle, columns CYCLE_COLUMNS."""
    cycles: tuple[int, ...]
    """Control cycles of each step; over a network not always the same number."""
    q_commanded: Vec7
    """Configuration that the reset was to reach [rad]; its TCP rotation is held."""

    @property
    def f_star(self) -> Array:
        """f* of X Y Z that each step asked for [m/s2], shape (steps, 3)."""
        return self.targets[:, :3]


@dataclass(frozen=True)
class Recording:
    """Scripted motions of one arm, and how they were made."""

    metadata: dict[str, Any]
    """Content of `recording.json`."""
    sequences: tuple[Sequence, ...]

    @property
    def period(self) -> float:
        """Control period [s]."""
        return float(self.metadata["period"])

    @property
    def task(self) -> TaskSpec:
        """Mode of each axis."""
        return TaskSpec.parse(self.metadata["task"])

    @cached_property
    def cell(self) -> Workcell:
        """Workcell in which the arm was recorded."""
        return _cell(self.metadata)

    @property
    def fixture(self) -> Pose:
        """Pose of the fixture."""
        return _fixture(self.metadata)

    def settings(self) -> tuple[OscConfig, LimitConfig]:
        """Return law and limits of the controller that played the motions."""
        given = self.metadata["controller"]
        low, high = given["walls"]
        config = EnvConfig(
            period=self.period,
            force_damping=given["force_damping"],
            near_speed=given["near_speed"],
            near_press=ApproachLimits.near_press,  # none: see `recorder`
            scheme=given["scheme"],
            **{name: given[name] for name in DECLARED if name in given},
        )
        cell = replace(self.cell, walls=(tuple(low), tuple(high)))
        return make_settings(cell, config, is_hardware=given["is_hardware"])

    def require_settings(self, path: Path) -> None:
        """Refuse a description from which no controller can be made.

        Raises:
            LogError: What is missing or no number.
        """
        place = self.metadata["fixture"]
        is_tilted = isinstance(place, list) and len(place) > 4
        require_numbers(path, "fixture", place, 6 if is_tilted else 4)
        try:
            self.settings()
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise LogError(
                f"{path} is damaged: its controller cannot be made "
                f"({type(error).__name__}: {error})"
            ) from error

    def positions(self) -> list[Array]:
        """Return the TCP by the controller's model at each cycle [m].

        Returns:
            One array of shape (cycles, 3) for each sequence, world axes, from the
            measured configuration.
        """
        columns = [COLUMN[name] for name in "xyz"]
        return [sequence.log[:, columns] for sequence in self.sequences]

    def fingerprint(self) -> str:
        """Return a hash of everything that a fit depends on."""
        known = {k: v for k, v in self.metadata.items() if k not in _UNFITTED}
        digest = hashlib.sha256(json.dumps(known, sort_keys=True).encode())
        for sequence in self.sequences:
            digest.update(np.ascontiguousarray(sequence.log[:, :-1]).tobytes())
            digest.update(sequence.targets.tobytes())
        return digest.hexdigest()[:16]

    def require_like(self, other: Self) -> None:
        """Refuse to compare with a recording of another robot, period or task.

        Raises:
            LogError: What differs, and both values.
        """
        names = ("robot", "period", "task", "commands", "controller")
        pairs = {name: (self.metadata[name], other.metadata[name]) for name in names}
        pairs["load"] = self._load(), other._load()
        for name, (mine, theirs) in pairs.items():
            if mine != theirs:
                raise LogError(
                    f"the two recordings differ in {name}: {mine!r} (arm "
                    f"{self.metadata['arm']}) and {theirs!r} (arm "
                    f"{other.metadata['arm']}); record both with the same settings"
                )

    def _load(self) -> str:
        load = self.cell.payload()
        return f"{load.mass:.6f} kg at {load.com.round(6).tolist()} m from the flange"

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read a recording and check it.

        Raises:
            LogError: Missing or damaged, incomplete, of another robot, period or task
                than it says, or with gaps or numbers that are not finite.
        """
        folder = Path(folder)
        metadata = read_description(folder)
        robot = _cell(metadata).loaded_robot()
        require_robot(folder / DESCRIPTION, metadata["robot"], robot)
        count = metadata["excitation"]["sequences"]
        cls(metadata, ()).require_settings(folder / DESCRIPTION)
        sequences = []
        for number in range(count):
            path = sequence_path(folder, number)
            if not path.is_file():
                raise LogError(
                    f"the recording {folder} is not complete: {path.name} of {count} "
                    "sequences is missing; finish it with the same `dovetail identify "
                    "record`"
                )
            sequences.append(_read_sequence(path, number, metadata, robot))
        return cls(metadata, tuple(sequences))


def sequence_path(folder: Path, number: int) -> Path:
    """Return where a sequence's log is."""
    return folder / f"sequence-{number:02d}.npz"


def read_description(folder: Path) -> dict[str, Any]:
    """Read `recording.json`.

    Raises:
        LogError: Missing, damaged, or of another format.
    """
    path = folder / DESCRIPTION
    try:
        metadata = read_json(path)
    except (OSError, ConfigError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise LogError(
            f"{folder} is no recording: {path.name} cannot be read ({reason}); make "
            "one with `dovetail identify record`"
        ) from error
    if not isinstance(metadata, dict):
        raise LogError(
            f"{path} holds no table; make it with `dovetail identify record`"
        )
    missing = [key for key in _KEYS if key not in metadata]
    if missing or metadata["format"] != FORMAT:
        raise LogError(
            f"{path} lacks {', '.join(missing) or 'no key'} and has format "
            f"{metadata.get('format')}; this version reads {FORMAT}: record it again"
        )
    for key, kind in _KINDS.items():
        if not isinstance(metadata[key], kind):
            raise LogError(f"{path} is damaged: {key} is {metadata[key]!r}")
    counts = (metadata["excitation"].get(key) for key in ("sequences", "steps"))
    if not all(isinstance(count, int) and count > 0 for count in counts):
        raise LogError(f"{path} is damaged: excitation is {metadata['excitation']!r}")
    if len(metadata["q_start"]) != metadata["excitation"]["sequences"]:
        raise LogError(f"{path} is damaged: q_start is not one for each sequence")
    return metadata


def _task(metadata: dict[str, Any]) -> Task:
    env_id = require_trusted("recording", "env_id", metadata["env_id"])
    names = option_types(task_class(env_id))
    return task_of_file(env_id, {k: metadata[k] for k in names if k in metadata})


def _cell(metadata: dict[str, Any]) -> Workcell:
    given = require_trusted("recording", "arm_model", metadata["arm_model"])
    robot = find_robot(given)
    return _task(metadata).workcell(robot, _cell_file(metadata))


def _cell_file(metadata: dict[str, Any]) -> CellConfig | None:
    """Return what the recording's cell file said, if there was one."""
    try:
        return None if (table := metadata.get("cell")) is None else cell_of(table)
    except ConfigError as error:
        raise LogError(f"{DESCRIPTION} is damaged: {error}") from error


def usual_place(task: Task, cell: Workcell | None = None) -> FixturePose:
    """Return where a task's fixture is while an arm is identified in a cell."""
    own = task.recording_pose or task.trial_poses[0]
    return own if cell is None else task.placed_in(cell, own)


def _fixture(metadata: dict[str, Any]) -> Pose:
    """Return where the fixture was; its facing is its task's."""
    facing = usual_place(_task(metadata)).facing
    return FixturePose.given(metadata["fixture"], facing).pose()


def _read_sequence(
    path: Path, number: int, metadata: dict[str, Any], robot: Robot
) -> Sequence:
    """Read one sequence and check it against the recording's description."""
    episode = Episode.load(path)
    facts = {name: metadata[name] for name in ("robot", "task", "period")}
    require_same_facts(path, episode.metadata, facts | {"sequence": number})
    log = episode.data[:, [episode.columns.index(name) for name in CYCLE_COLUMNS]]
    require_gapless(path, log, float(metadata["period"]))
    require_robot(path, metadata["robot"], robot, log)
    steps = episode["step"].astype(int)
    firsts = np.flatnonzero(np.diff(steps, prepend=-1))
    wanted = metadata["excitation"]["steps"]
    if len(firsts) != wanted or (steps[firsts] != np.arange(len(firsts))).any():
        raise LogError(
            f"{path}: it has {len(firsts)} policy steps, the recording's sequences "
            f"have {wanted}: delete the file and record it again"
        )
    targets = read_targets(path, episode.metadata.get(TARGETS), len(firsts))
    first, cycles = assign_steps(path, log, steps, targets[:, :3])
    q_start = require_numbers(path, "q_start", episode.metadata.get("q_start"), 7)
    if first > 0:  # a network's latency: the arm was still held at its start
        q_start = log[first, COLUMN["q1"] : COLUMN["q7"] + 1]
    told = metadata["q_start"][number]
    commanded = require_numbers(path.with_name(DESCRIPTION), "q_start", told, 7)
    return Sequence(q_start, targets, log[first:], cycles, commanded)
