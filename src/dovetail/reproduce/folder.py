"""The results folder: of one configuration, and for one command at a time.

OUT/reproduce.json has everything that decides the results, and every stage. OUT/twins
has the twins. OUT/stages/NAME has what a stage made, what it printed in every sitting
(log.txt), and `done` when it is done.
"""

import fcntl
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from dovetail import reading
from dovetail.errors import ConfigError
from dovetail.files import claim_output_folder, open_lock, write_atomic
from dovetail.plants.plant import Engine
from dovetail.plants.twin import Twin

SETTINGS = "reproduce.json"
TWINS = "twins"
"""Folder of the twins in the results folder: copies, so that a change of the original
does not mix two twins in one table."""
RECORDING, FIT, REPORT, RUN, EVALUATION = (
    *("recording", "fit", "report", "run", "evaluation"),
)
"""Folders in those of the stages."""
TRAIN = "train.toml"
DONE, LOG = "done", "log.txt"
VERSION = 3


def stage_path(name: str) -> Path:
    """Return the folder of a stage, seen from the results folder."""
    return Path("stages") / name


def stage_folder(root: Path, name: str) -> Path:
    """Return the folder of a stage."""
    return root / stage_path(name)


def is_done(root: Path, name: str) -> bool:
    """Say whether a stage is done."""
    return (stage_folder(root, name) / DONE).exists()


def twin_path(twin: str, engine: Engine = "mujoco") -> Path:
    """Return the file of a twin in an engine, seen from the results folder."""
    suffix = "" if engine == "mujoco" else f"-in-{engine}"
    return Path(TWINS) / f"{twin}{suffix}.toml"


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON file of the results folder.

    Raises:
        ConfigError: It is damaged.
    """
    try:
        table = reading.read_json(path)
        if not isinstance(table, dict):
            raise ConfigError("it holds no table")
    except (OSError, ConfigError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(
            f"{path} is damaged: {reason}; remove its folder, and that experiment is "
            "done again"
        ) from error
    return table


def open_folder(path: Path, settings: Mapping[str, Any]) -> Path:
    """Create the results folder, or check that the one there is of these settings.

    Args:
        path: New, empty, or one to go on with.
        settings: Everything that decides the results, ready for JSON.

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
    """Keep the twins beside their results, each for two engines."""
    (root / TWINS).mkdir(exist_ok=True)
    engines: tuple[Engine, ...] = ("mujoco", "drake")
    for name, twin in twins.items():
        for engine in engines:
            file = root / twin_path(name, engine)
            write_atomic(file, replace(twin, engine=engine).to_toml())


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
