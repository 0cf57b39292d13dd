"""Facts of a checkpoint's JSON, checked before any other file of it is opened.

A checkpoint may be a stranger's, so everything in it is checked: counters are counts,
and checksums are of the checkpoint's own files, which are plain files of its folder.
"""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from dovetail.errors import ConfigError
from dovetail.reading import open_regular, read_json
from dovetail.settings import Range, in_count, in_range

VERSION = 1
FACTS = "checkpoint.json"
NETWORKS = "networks.msgpack"
REPLAY = "replay.npz"

_COUNTS = {
    "num_timesteps": (2_000_000_000, "steps"),
    "_n_updates": (10**12, "updates"),
    "_episode_num": (2_000_000_000, "episodes"),
}
"""Largest counts: `steps` ends at 1e9, ppo's last rollout beyond it, with up to 64
updates per step."""
_WALL_TIME = Range(0.0, 1e9, "s")
_LARGEST = 1_000_000
"""Size of a JSON that is read [bytes]; one of ours has less than 1000."""


class CheckpointFacts(NamedTuple):
    """Facts of a checkpoint, read before its other files are opened."""

    counters: dict[str, int]
    """Steps, updates and episodes done, by SBX's names."""
    wall_time: float
    """Training time so far [s]."""
    digests: dict[str, str]
    """SHA-256 of each of its other files, by name; they are plain files."""


def read_facts(place: Path, has_replay: bool) -> CheckpointFacts:
    """Read a checkpoint's JSON; open nothing that it names.

    Args:
        place: The checkpoint's folder.
        has_replay: The algorithm has a replay buffer.

    Raises:
        ValueError: Something in it is not allowed; says what is.
        OSError: It cannot be read.
    """
    facts = _read_table(place)
    if (version := facts.get("version")) != VERSION:
        raise ConfigError(f"version is {version!r}; this release reads {VERSION}")
    counters = {
        name: _count(facts.get(name), name, largest, unit)
        for name, (largest, unit) in _COUNTS.items()
    }
    wall_time = in_range("wall_time", facts.get("wall_time"), _WALL_TIME)
    names = [NETWORKS, REPLAY] if has_replay else [NETWORKS]
    return CheckpointFacts(counters, wall_time, _digests(place, facts, names))


def check_files(
    place: Path, digests: dict[str, str], limits: Mapping[str, int]
) -> None:
    """Hold a checkpoint's files against their checksums.

    Args:
        place: The checkpoint's folder.
        digests: SHA-256 of each file.
        limits: Largest size of each [bytes].

    Raises:
        ConfigError: One is damaged; names it.
        OSError: One is no regular file, or too large.
    """
    for name, digest in digests.items():
        with open_regular(place / name, limits[name]) as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != digest:
                raise ConfigError(f"{name} is damaged: its SHA-256 differs")


def _read_table(place: Path) -> dict[str, Any]:
    path = place / FACTS
    _require_plain(path)
    facts = read_json(path, _LARGEST)
    if not isinstance(facts, dict):
        raise ConfigError(f"{FACTS} holds no table")
    return facts


def _count(value: Any, name: str, largest: int, unit: str) -> int:
    if isinstance(value, bool):  # which Python takes for 0 and 1
        raise ConfigError(f"{name} is {value}; allowed: 0 to {largest} {unit}")
    return in_count(name, value, 0, largest, unit)


def _digests(place: Path, facts: dict[str, Any], names: list[str]) -> dict[str, str]:
    """Return the checksums, which are of these files of the folder and no others."""
    digests = facts.get("sha256")
    if not isinstance(digests, dict) or set(digests) != set(names):
        found = sorted(digests) if isinstance(digests, dict) else digests
        raise ConfigError(
            f"sha256 names {str(found)[:200]}; allowed: {' and '.join(names)}"
        )
    for name, digest in digests.items():
        if not isinstance(digest, str) or not re.fullmatch("[0-9a-f]{64}", digest):
            raise ConfigError(
                f"sha256 of {name} is {str(digest)[:80]!r}; allowed: 64 digits 0 to f"
            )
        _require_plain(place / name)
    return digests


def _require_plain(path: Path) -> None:
    """Refuse a link, which may lead anywhere, and a device, which may never end."""
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise ConfigError(
            f"{path.name} is a link, a device or a folder; allowed: a plain file"
        )
