"""Executors of stages: their interface, and child processes of this machine."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Protocol

from dovetail.errors import ConfigError
from dovetail.reproduce.stage import LOG, stage_folder

ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MPLBACKEND": "agg",
}
"""Environment of a stage: as many stages as cores run at once."""


class StageJob(Protocol):
    """A stage that was started."""

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal, or None while it runs."""
        ...

    def stop(self) -> None:
        """End it, and what it started, at once; harmless when it has ended."""
        ...


class Executor(Protocol):
    """Starts stages."""

    slots: int
    """Number of stages that may run at once."""

    def start(self, root: Path, name: str) -> StageJob:
        """Start a stage whose folder holds its stage.json."""
        ...

    def close(self) -> None:
        """Release what it holds; its jobs have ended."""
        ...


def command(root: Path, name: str) -> list[str]:
    """Return the command line of a stage's process."""
    return [sys.executable, "-m", "dovetail.reproduce.child", str(root), name]


def start_process(root: Path, name: str) -> subprocess.Popen[bytes]:
    """Start a stage's process, which leads a group of its own; it prints to its log."""
    with (stage_folder(root, name) / LOG).open("ab") as log:
        return subprocess.Popen(
            command(root, name),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env={**os.environ, **ONE_THREAD, "PYTHONUNBUFFERED": "1"},
            start_new_session=True,
        )


class _Process:
    """A job that is a process of this machine."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    def poll(self) -> int | None:
        return self._process.poll()

    def stop(self) -> None:
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()


class LocalExecutor:
    """Runs stages as processes of this machine, as many at once as it has cores."""

    def __init__(self, workers: int | None = None) -> None:
        """Take the number of stages at once; None is the cores this process may use.

        Raises:
            ConfigError: Less than one.
        """
        self.slots = len(os.sched_getaffinity(0)) if workers is None else workers
        if self.slots < 1:
            raise ConfigError(f"workers is {self.slots}; needs at least 1")

    def start(self, root: Path, name: str) -> StageJob:
        """Start a stage whose folder holds its stage.json."""
        return _Process(start_process(root, name))

    def close(self) -> None:
        """Nothing is held."""
