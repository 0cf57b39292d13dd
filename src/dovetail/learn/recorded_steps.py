"""The policy steps of an Episode log: what was seen, done and paid, without cycles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail.control.period import POLICY_PERIOD
from dovetail.envs.log_facts import ACTION, CELL, FIRST, SUCCESS
from dovetail.episode import LED, Episode
from dovetail.errors import LogError
from dovetail.types import Array

MEANT = ("axes", "scale", "force_damping", "force_weight", "script")
"""Facts that give a log's actions and rewards their meaning; a run needs the same."""
_SUFFIXES = (".npz", ".parquet")
_TOLERANCE = 0.1  # of a policy step, of a real arm's clock


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedSteps:
    """Steps of one log, from the first whose previous observation is known."""

    columns: tuple[str, ...]
    """Names of what was seen."""
    seen: Array
    """Unscaled, before the first step and after each, shape (steps + 1, columns)."""
    actions: NDArray[np.float32]
    """In [-1, 1], shape (steps, actions)."""
    rewards: NDArray[np.float32]
    """Shape (steps,)."""
    is_led: NDArray[np.bool_]
    """True where the action was a person's, shape (steps,)."""
    success: bool
    """True if the last step completed the task."""
    cell: Mapping[str, Any]
    """Facts of the log's cell, see `envs.log_facts`."""
    action: Mapping[str, Any]
    """Facts of its actions, see `MEANT`."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.rewards)


def find_logs(paths: Sequence[str | Path]) -> list[Path]:
    """Return the files that paths name: Episode logs, and those in folders.

    Raises:
        LogError: No such file or folder, or a folder without a log.
    """
    found: list[Path] = []
    for text in paths:
        path = Path(text).expanduser()
        if path.is_dir():
            inside = [p for p in sorted(path.iterdir()) if p.suffix in _SUFFIXES]
            if not inside:
                raise LogError(
                    f"the folder {path} has no Episode log (.npz, .parquet) in it"
                )
            found += inside
        elif path.exists():
            found.append(path)
        else:
            raise LogError(
                f"there is no Episode log or folder {path}; dovetail record and "
                "dovetail cockpit write such"
            )
    return found


def read_steps(path: Path) -> RecordedSteps:
    """Read an Episode log.

    Raises:
        LogError: Damaged, empty, with steps of another length than a policy's, or
            silent about its cell or its actions; says what to do.
    """
    episode = Episode.load(path)
    if len(episode) == 0:
        raise LogError(f"the log {path} is empty: nothing was recorded; leave it out")
    told = {key: _told(path, episode.metadata, key) for key in (CELL, ACTION)}
    columns = tuple(name for name in episode.columns if name.startswith("obs_"))
    if not columns:
        raise LogError(f"the log {path} does not have what was seen; leave it out")
    last = np.append(np.flatnonzero(np.diff(episode["step"])), len(episode) - 1)
    _require_steps(path, episode["time"][last])
    seen = np.column_stack([episode[name] for name in columns])[last]
    first = _first(path, episode.metadata, columns)
    if first is not None:
        seen = np.vstack([first, seen])
    else:  # it began in the middle: with what its first step brought about
        last = last[1:]
    if len(last) == 0:
        raise LogError(
            f"the log {path} has one step, which teaches nothing; leave it out"
        )
    names = [
        name for name in episode.columns if name.removeprefix("action").isdecimal()
    ]
    if not names:
        raise LogError(f"the log {path} does not have what was done; leave it out")
    axes = told[ACTION].get("axes", [])
    if not isinstance(axes, list) or not all(isinstance(axis, str) for axis in axes):
        raise LogError(f"the log {path}: its actions' axes are {str(axes)[:80]}")
    actions = np.column_stack([episode[name] for name in names])[last]
    led = episode[LED][last] if LED in episode.columns else np.zeros(len(last))
    return RecordedSteps(
        columns=columns,
        seen=seen,
        actions=actions.clip(-1.0, 1.0).astype(np.float32),
        rewards=episode["reward"][last].astype(np.float32),
        is_led=led > 0.5,
        success=episode.metadata.get(SUCCESS) is True,
        cell=told[CELL],
        action={"script": "none", **told[ACTION]},  # older logs do not name it
    )


def _told(path: Path, metadata: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = metadata.get(key)
    if not isinstance(found, Mapping):
        raise LogError(
            f"the log {path} does not say of which {key} it is: record it again with "
            "this version"
        )
    return found


def _first(
    path: Path, metadata: Mapping[str, Any], columns: Sequence[str]
) -> Array | None:
    if FIRST not in metadata:
        return None
    try:
        first = np.array([float(metadata[FIRST][name]) for name in columns])
    except (KeyError, TypeError, ValueError) as error:
        raise LogError(
            f"the log {path}: its {FIRST!r} lacks a number: {error}"
        ) from error
    if not np.isfinite(first).all():
        raise LogError(f"the log {path}: its {FIRST!r} is not finite")
    return first


def _require_steps(path: Path, ends: Array) -> None:
    """Refuse a log whose steps have another length than a policy's."""
    length = float(np.median(np.diff(ends))) if len(ends) > 1 else POLICY_PERIOD
    if abs(length - POLICY_PERIOD) > _TOLERANCE * POLICY_PERIOD:
        raise LogError(
            f"the log {path} has steps of {1e3 * length:.1f} ms, a policy's have "
            f"{1e3 * POLICY_PERIOD:g} ms: record it with this version"
        )
