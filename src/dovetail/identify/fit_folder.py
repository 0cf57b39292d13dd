"""Folder of a fit: its settings, every generation as it ends, and the result.

`fit.json` holds settings and result, `generations.jsonl` one line per generation,
`model.toml` the fitted model. Killed at any moment, a fit goes on from the last whole
line.
"""

import json
import os
from pathlib import Path
from typing import Any, Self

from dovetail.errors import ConfigError, LogError
from dovetail.files import claim_output_folder, write_atomic
from dovetail.reading import parse_json, read_json, read_text

FORMAT = 1
SUMMARY = "fit.json"
GENERATIONS = "generations.jsonl"
MODEL = "model.toml"


class FitFolder:
    """The folder of one fit, with the generations that are in it."""

    def __init__(self, path: Path, summary: dict[str, Any] | None) -> None:
        """Wrap a folder; use `claim`."""
        self.path = path
        self.summary: dict[str, Any] | None = summary
        """Content of `fit.json` of a fit to go on with; None for a new one."""
        self.generations: list[dict[str, Any]] = []
        """Each told generation: "values" [m] and "time" [s] since the beginning."""

    @classmethod
    def claim(cls, path: Path, settings: dict[str, Any], *, resume: bool) -> Self:
        """Take a new or empty folder, or with `resume` the one of the same fit.

        Args:
            path: The folder; created where it does not exist.
            settings: What determines the search; has to be the same to go on.
            resume: Go on with what is there.

        Raises:
            ConfigError: It holds something else, or a fit of other settings; nothing
                is overwritten.
        """
        if path.exists() and not path.is_dir():
            raise ConfigError(f"the output folder {path} is a file; choose another")
        is_used = path.is_dir() and any(path.iterdir())
        if not is_used:
            return cls(claim_output_folder(path), None)
        if not (path / SUMMARY).is_file():
            raise ConfigError(
                f"the folder {path} is not empty and holds no fit; nothing was "
                "overwritten: choose another --out"
            )
        if not resume:
            raise ConfigError(
                f"the folder {path} holds a fit; nothing was overwritten: go on with "
                "it by --resume, or choose another --out"
            )
        summary = read_summary(path)
        _require_same(path, summary["settings"], settings)
        folder = cls(path, summary)
        folder._read_generations()
        return folder

    def write_summary(self, summary: dict[str, Any]) -> Path:
        """Write `fit.json`."""
        whole: dict[str, Any] = {"format": FORMAT, **summary}
        self.summary = whole
        return write_atomic(self.path / SUMMARY, json.dumps(whole, indent=1) + "\n")

    def begin_generations(self) -> None:
        """Write the file of the generations, with none."""
        write_atomic(self.path / GENERATIONS, "")

    def append(self, values: list[float], time: float) -> None:
        """Add a generation; it is on the disk when this returns.

        Raises:
            LogError: The disk is full or not writable.
        """
        line = {"values": values, "time": round(time, 3)}
        try:
            with (self.path / GENERATIONS).open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise LogError(
                f"cannot write {self.path / GENERATIONS}: {error.strerror}; free some "
                "space and go on with --resume"
            ) from error
        self.generations.append(line)

    def _read_generations(self) -> None:
        """Read the generations; a last line that was cut short is removed."""
        path = self.path / GENERATIONS
        try:
            lines = read_text(path).split("\n") if path.is_file() else []
            whole = lines[:-1]  # what follows the last line's end was not finished
            self.generations = [parse_json(line, "a line") for line in whole]
        except (OSError, ValueError) as error:
            raise LogError(
                f"{path} is damaged ({error}); the fit cannot go on: choose another "
                "--out"
            ) from error
        if lines and lines[-1]:
            write_atomic(path, "".join(line + "\n" for line in whole))


def read_summary(path: Path) -> dict[str, Any]:
    """Read `fit.json` of a folder.

    Raises:
        LogError: Missing, damaged or of another format.
    """
    file = path / SUMMARY
    try:
        summary = read_json(file)
    except (OSError, ConfigError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise LogError(
            f"{path} holds no fit: {SUMMARY} cannot be read ({reason}); make one with "
            "`dovetail identify fit`"
        ) from error
    found = summary.get("format") if isinstance(summary, dict) else None
    if found != FORMAT:
        raise LogError(f"{file} has format {found}; this version reads {FORMAT}")
    return summary


def _require_same(path: Path, before: dict[str, Any], now: dict[str, Any]) -> None:
    differ = [
        f"{name} is {before.get(name)!r} there and {now[name]!r} here"
        for name in now
        if before.get(name) != now[name]
    ]
    if differ:
        raise ConfigError(
            f"the folder {path} holds a fit of another configuration: "
            f"{'; '.join(differ)}; nothing was overwritten: choose another --out"
        )
