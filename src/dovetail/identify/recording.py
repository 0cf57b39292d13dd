"""The log of scripted motions, and what has to be true of it before it is fitted.

A recording is a folder: `recording.json` says how it was made, and one Episode file
for each sequence, `sequence-00.npz` on, holds every control cycle.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import make_settings
from dovetail.episode import Episode
from dovetail.errors import LogError
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from dovetail.poses import Pose, quat_about_z
from dovetail.scene import SceneConfig
from dovetail.types import Array, Vec7

FORMAT = 1
DESCRIPTION = "recording.json"
_KEYS = (
    *("format", "robot", "task", "period", "peg", "clearance", "hole", "arm"),
    *("commands", "controller", "excitation", "q_start"),
)
_GAP = 0.25
"""Deviation of the time between two cycles that is a gap, as a share of the period."""
_POSITION_TOLERANCE = 1e-3
"""Largest distance between the logged TCP and the model's at the logged q [m]."""


@dataclass(frozen=True)
class Sequence:
    """One scripted motion as it was played and logged."""

    q_start: Vec7
    """Configuration at the reset, as measured [rad], shape (7,)."""
    actions: Array
    """Actions in [-1, 1], shape (steps, 4)."""
    log: Array
    """One row for each control cycle, columns CYCLE_COLUMNS."""
    cycles: tuple[int, ...]
    """Control cycles of each step; over a network not always the same number."""


@dataclass(frozen=True)
class Recording:
    """Scripted motions of one arm, and how they were made."""

    metadata: dict[str, Any]
    """What `recording.json` holds."""
    sequences: tuple[Sequence, ...]

    @property
    def period(self) -> float:
        """Control period [s]."""
        return float(self.metadata["period"])

    @property
    def task(self) -> TaskSpec:
        """Mode of each axis."""
        return TaskSpec.parse(self.metadata["task"])

    @property
    def scene(self) -> SceneConfig:
        """Geometry of the task."""
        return SceneConfig(
            peg=self.metadata["peg"], clearance=self.metadata["clearance"]
        )

    @property
    def hole(self) -> Pose:
        """Where the hole was."""
        x, y, z, yaw = self.metadata["hole"]
        return Pose(np.array([x, y, z]), quat_about_z(yaw))

    def settings(self) -> tuple[OscConfig, LimitConfig]:
        """Return law and limits of the controller that played the motions."""
        return make_settings(self.scene, self.period, **self.metadata["controller"])

    def positions(self) -> list[Array]:
        """Return the TCP by the controller's model at each cycle [m].

        Returns:
            One array of shape (cycles, 3) for each sequence, world axes, from the
            measured configuration.
        """
        columns = [COLUMN[name] for name in "xyz"]
        return [sequence.log[:, columns] for sequence in self.sequences]

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read a recording and check it.

        Raises:
            LogError: Missing or damaged, incomplete, of another robot, period or task
                than it says, or with gaps or numbers that are not finite.
        """
        folder = Path(folder)
        metadata = read_description(folder)
        count = metadata["excitation"]["sequences"]
        sequences = []
        for number in range(count):
            path = sequence_path(folder, number)
            if not path.is_file():
                raise LogError(
                    f"the recording {folder} has {number} of {count} sequences: "
                    f"{path.name} is missing; finish it with the same `dovetail "
                    "identify record`"
                )
            sequences.append(_read_sequence(path, metadata))
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
        metadata = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise LogError(
            f"{folder} is no recording: {path.name} cannot be read ({error}); make one "
            "with `dovetail identify record`"
        ) from error
    missing = [k for k in _KEYS if k not in metadata] if metadata else list(_KEYS)
    if missing or metadata["format"] != FORMAT:
        raise LogError(
            f"{path} lacks {', '.join(missing) or 'nothing'} and has format "
            f"{metadata.get('format')}; this version reads {FORMAT}"
        )
    return metadata


def _read_sequence(path: Path, metadata: dict[str, Any]) -> Sequence:
    """Read one sequence and check it against the recording's description."""
    episode = Episode.load(path)
    for name in ("robot", "task", "period"):
        if episode.metadata.get(name) != metadata[name]:
            raise LogError(
                f"{path}: the {name} is {episode.metadata.get(name)!r}, the "
                f"recording's is {metadata[name]!r}; the file is of another recording"
            )
    columns = [episode.columns.index(name) for name in CYCLE_COLUMNS]
    log = episode.data[:, columns]
    names = [name for name in episode.columns if name.startswith("action")]
    steps = episode["step"].astype(int)
    _require_gapless(path, log, float(metadata["period"]))
    _require_robot(path, log, metadata)
    firsts = np.flatnonzero(np.diff(steps, prepend=-1))
    actions = np.column_stack([episode[name] for name in names])[firsts]
    cycles = np.diff([*firsts, len(steps)])
    _require_steps(path, steps[firsts], metadata)
    q_start = np.asarray(episode.metadata["q_start"], dtype=float)
    return Sequence(q_start, actions, log, tuple(int(n) for n in cycles))


def _require_steps(path: Path, steps: Array, metadata: dict[str, Any]) -> None:
    expected = metadata["excitation"]["steps"]
    if not np.array_equal(steps, np.arange(expected)):
        raise LogError(
            f"{path}: it has {len(steps)} policy steps, numbered {steps.min()} to "
            f"{steps.max()}; the recording has {expected}: play it again"
        )


def _require_gapless(path: Path, log: Array, period: float) -> None:
    """Refuse a log in which cycles are missing."""
    time = log[:, COLUMN["time"]]
    intervals = np.diff(time)
    bad = np.abs(intervals - period) > _GAP * period
    if bad.any():
        row = int(np.argmax(bad))
        raise LogError(
            f"{path}: {1e3 * intervals[row]:g} ms pass between the cycles {row} and "
            f"{row + 1}, at {time[row]:.3f} s; the period is {1e3 * period:g} ms "
            f"({int(bad.sum())} such gaps): delete the file and record it again"
        )


def _require_robot(path: Path, log: Array, metadata: dict[str, Any]) -> None:
    """Refuse a log whose TCP is not where this robot's is at the logged q."""
    scene = SceneConfig(peg=metadata["peg"], clearance=metadata["clearance"])
    robot = scene.robot()
    if metadata["robot"] != robot.name:
        raise LogError(
            f"{path}: the log is of the robot {metadata['robot']!r}; it can be "
            f"replayed on {robot.name!r} only"
        )
    for row in (0, len(log) // 2, len(log) - 1):
        q = log[row, COLUMN["q1"] : COLUMN["q7"] + 1]
        logged = log[row, COLUMN["x"] : COLUMN["z"] + 1]
        distance = float(np.linalg.norm(robot.tool_pose(q).position - logged))
        if not distance < _POSITION_TOLERANCE:
            raise LogError(
                f"{path}: in row {row} the TCP is {1e3 * distance:.1f} mm from where "
                f"{robot.name} has it at the logged configuration; allowed is "
                f"{1e3 * _POSITION_TOLERANCE:g} mm: the log is of another robot or tool"
            )
