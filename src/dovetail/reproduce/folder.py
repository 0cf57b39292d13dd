"""The results folder: of one configuration, and for one command at a time."""

import fcntl
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from dovetail.errors import ConfigError
from dovetail.files import claim_output_folder, open_lock, write_atomic
from dovetail.plants.twin import Twin
from dovetail.reproduce.experiments import TWINS, twin_file
from dovetail.reproduce.stage import read_json

SETTINGS = "reproduce.json"
VERSION = 1


def open_folder(path: Path, settings: Mapping[str, Any]) -> Path:
    """Create the results folder, or check that the one there is of these settings.

    Args:
        path: New, empty, or one to go on with.
        settings: Everything that decides the plan, ready for JSON.

    Returns:
        The folder, absolute; it holds reproduce.json.

    Raises:
        ConfigError: It holds something else, or results of other settings (names the
            first); nothing is changed then.
    """
    root = path.expanduser().absolute()
    mine = json.loads(json.dumps({"version": VERSION, **settings}))
    file = root / SETTINGS
    if file.exists():
        _require_same(mine, read_json(file), root)
        return root
    root = claim_output_folder(root)
    write_atomic(file, json.dumps(mine, indent=2) + "\n")
    return root


def _require_same(
    mine: Mapping[str, Any], other: Mapping[str, Any], root: Path, prefix: str = ""
) -> None:
    for key in [*mine, *(other.keys() - mine.keys())]:
        ours, theirs = mine.get(key), other.get(key)
        if ours == theirs:
            continue
        if isinstance(ours, Mapping) and isinstance(theirs, Mapping):
            _require_same(ours, theirs, root, f"{prefix}{key}.")
        raise ConfigError(
            f"{root} holds results of another configuration: {prefix}{key} is "
            f"{theirs!r} there and {ours!r} here; give the same settings to go on "
            "with it, or choose another --out (nothing was changed)"
        )


def write_twins(root: Path, twins: Mapping[str, Twin]) -> None:
    """Keep the twins beside their results, each also for PyBullet."""
    (root / TWINS).mkdir(exist_ok=True)
    for name, twin in twins.items():
        write_atomic(twin_file(root, name), twin.to_toml())
        other = replace(twin, engine="bullet")
        write_atomic(twin_file(root, f"{name}-in-bullet"), other.to_toml())


@contextmanager
def locked(root: Path) -> Iterator[None]:
    """Keep every other command out of the folder; the system frees it after a kill.

    Raises:
        ConfigError: Another command works in it.
    """
    with open_lock(root / ".lock") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ConfigError(
                f"another `dovetail reproduce` works in {root}; wait for it, or choose "
                "another --out"
            ) from error
        yield
