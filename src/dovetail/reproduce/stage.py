"""A stage: one experiment of the plan, in a folder that says when it is done.

    OUT/stages/NAME/stage.json    what is to be done: function, settings, needs
                    log.txt       what it printed, every sitting
                    done.json     there when it is done: settings and result
                    ...           what it made

`done.json` is written last and in one piece, so that a stage is done or not, whenever
its process, or the machine, was killed.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console

from dovetail import reading
from dovetail.errors import ConfigError
from dovetail.files import write_atomic

STAGES, STAGE, DONE, LOG = "stages", "stage.json", "done.json", "log.txt"


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One experiment: pure data, from which any process can run it."""

    name: str
    """Name of the stage and of its folder."""
    run: str
    """Function of the stage: "module:function", called with a `Sitting`."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Everything that decides the result, as JSON knows it."""
    needs: tuple[str, ...] = ()
    """Stages whose results it reads."""
    expected: float = 1.0
    """Estimated time on one core [s]: for the order and the time left only."""

    def to_json(self) -> dict[str, Any]:
        """Return what decides the result, as it looks when read from a file."""
        facts = {
            "name": self.name,
            "run": self.run,
            "settings": dict(self.settings),
            "needs": list(self.needs),
        }
        return json.loads(json.dumps(facts))


@dataclass(frozen=True)
class StageContext:
    """Argument of a stage's function, each time that it runs."""

    root: Path
    """The results folder."""
    name: str
    """The stage's name."""
    settings: dict[str, Any]
    """The stage's settings."""
    console: Console
    """Goes to the stage's log."""

    @property
    def folder(self) -> Path:
        """Return the stage's own folder; it exists."""
        return stage_folder(self.root, self.name)

    def of(self, name: str) -> Path:
        """Return the folder of another stage."""
        return stage_folder(self.root, name)


def stage_folder(root: Path, name: str) -> Path:
    """Return the folder of a stage."""
    return root / STAGES / name


def with_tuples(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings as a config takes them: JSON has no tuples."""
    return {k: tuple(v) if isinstance(v, list) else v for k, v in settings.items()}


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON file that this package wrote.

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


def read_done(root: Path, stage: Stage) -> dict[str, Any] | None:
    """Return what a finished stage left, or None when it is not finished.

    Raises:
        ConfigError: It was made with other settings (names the first).
    """
    path = stage_folder(root, stage.name) / DONE
    if not path.exists():
        return None
    done = read_json(path)
    require_same(stage, done, path.parent)
    return done


def require_same(stage: Stage, other: Mapping[str, Any], folder: Path) -> None:
    """Refuse a stage's folder that holds another experiment of that name.

    Raises:
        ConfigError: Names the first setting that differs, and both values.
    """
    mine = _flat(stage.to_json())
    theirs = _flat(
        {key: other.get(key) for key in ("name", "run", "settings", "needs")}
    )
    for key in [*mine, *(theirs.keys() - mine.keys())]:
        if mine.get(key) != theirs.get(key):
            raise ConfigError(
                f"{folder} holds {stage.name} with {key} {theirs.get(key)!r}, this "
                f"command asks for {mine.get(key)!r}; choose another --out (nothing "
                "was changed)"
            )


def write_done(root: Path, stage: Mapping[str, Any], **facts: Any) -> None:
    """Say that a stage is done.

    Args:
        root: Results folder.
        stage: `Stage.to_json`.
        facts: Its result and what else is worth knowing; ready for JSON.
    """
    text = json.dumps({**stage, **facts}, indent=2, allow_nan=False) + "\n"
    write_atomic(stage_folder(root, stage["name"]) / DONE, text)


def _flat(facts: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in facts.items():
        if isinstance(value, Mapping) and value:
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat
