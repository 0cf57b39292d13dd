"""Snakemake runs the stages by the rules of the Snakefile; this starts and watches it.

A second run in the folder is kept out by `folder.locked`, not by Snakemake's own lock:
that one stays after a kill and has to be taken off by hand.
"""

import os
import re
import runpy
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console

from dovetail.errors import DovetailError
from dovetail.files import open_lock
from dovetail.reading import open_regular
from dovetail.reproduce.folder import LOG, is_done, stage_folder
from dovetail.reproduce.plan import Stage

SNAKEFILE = Path(__file__).parent / "Snakefile"
OUTPUT = "snakemake.txt"
"""File of what Snakemake itself prints, in the results folder."""
_FAILED = re.compile(rf"log: stages/(\S+)/{re.escape(LOG)} \(check log")
"""Snakemake's word of a stage that failed."""
_LOOK = 0.5
"""Time between two looks for finished stages [s]."""
_PATIENCE = 20.0
"""Longest wait for the stages to end after Ctrl-C [s]: a training saves a
checkpoint."""


@dataclass
class RunSummary:
    """Stages that are done, failed or left out."""

    done: set[str] = field(default_factory=set)
    """Stages that are done, in this sitting or before."""
    failed: dict[str, str] = field(default_factory=dict)
    """Reason of each failed stage, by its name."""
    left_out: dict[str, str] = field(default_factory=dict)
    """Stages that could not run, and the failed one that they need."""


def run_stages(
    root: Path, stages: Sequence[Stage], words: Sequence[str], console: Console
) -> RunSummary:
    """Run every stage that is not done yet; a failed one does not stop the others.

    Args:
        root: Results folder; it holds reproduce.json.
        stages: The plan.
        words: Options of Snakemake: where the stages run, and how many at once.
        console: Where the progress goes.

    Raises:
        DovetailError: Snakemake ended before it had started a stage that is missing.
        KeyboardInterrupt: It was cut short; no stage goes on.
    """
    with open_lock(root / OUTPUT) as output:  # no link to somewhere else
        start = output.seek(0, os.SEEK_END)
        process = subprocess.Popen(
            [*_command(root), *words],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, "COLUMNS": "200", "PYTHONUNBUFFERED": "1"},
            start_new_session=True,
        )
    begin = time.time()
    progress = _Progress(root, stages, start, console)
    try:
        while process.poll() is None:
            time.sleep(_LOOK)
            began = time.monotonic()
            progress.look()
            time.sleep(20.0 * (time.monotonic() - began))  # thousands of stages
    except KeyboardInterrupt:
        os.killpg(process.pid, signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_PATIENCE)
        raise
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    progress.look()
    summary = summarise(root, stages)
    if process.returncode and not any(
        _has_changed(root, name, begin) for name in summary.failed
    ):
        said = " ".join(last_lines(root / OUTPUT, 5, start))
        raise DovetailError(
            f"Snakemake ended with code {process.returncode} before it ran a stage: "
            f"{said} (all in {root / OUTPUT})"
        )
    return summary


def _command(root: Path) -> list[str]:
    """Return the command line of Snakemake, but for where the stages run."""
    return [
        *(sys.executable, "-P", "-m", __name__),
        *("--snakefile", str(SNAKEFILE), "--directory", str(root)),
        *("--workflow-profile", "none"),  # the folder may come from a stranger
        *("--nolock", "--keep-going", "--rerun-incomplete"),
        *("--resources", "cabinet=1"),  # one at a time: they share their ports
        # A stage is done once: a copied folder has other times, a new version other
        # rules. Other settings are refused before.
        *("--rerun-triggers", "input"),
        *("--scheduler", "greedy", "--nocolor", "--quiet", "host", "reason"),
    ]


class _Progress:
    """A line for each stage that is done, with the time left, or that has failed."""

    def __init__(
        self, root: Path, stages: Sequence[Stage], start: int, console: Console
    ) -> None:
        self._root = root
        self._console = console
        self._start = start
        self._failed: set[str] = set()
        self._total = len(stages)
        self._left = {s.name: s for s in stages if not is_done(root, s.name)}
        self._begin = time.monotonic()
        self._made = 0.0
        if before := self._total - len(self._left):
            self._print(f"{before} of {self._total} stages were done before")

    def look(self) -> None:
        """Print a line for each stage that has ended since the last look."""
        for name in _FAILED.findall(_tail(self._root / OUTPUT, self._start)):
            if name not in self._failed:
                self._failed.add(name)
                self._print(f"FAILED  {name}  {_reason(self._root, name)}")
        for name in [name for name in self._left if is_done(self._root, name)]:
            self._made += self._left.pop(name).expected
            count = self._total - len(self._left)
            spent = time.monotonic() - self._begin
            left = sum(stage.expected for stage in self._left.values())
            self._print(
                f"done    {name}  ({count} of {self._total} stages done, about "
                f"{format_time(spent * left / self._made)} left)"
            )

    def _print(self, text: str) -> None:
        self._console.print(text, soft_wrap=True, highlight=False, markup=False)


def summarise(root: Path, stages: Sequence[Stage]) -> RunSummary:
    """Say what became of the stages: the missing ones that had all they need failed.

    Args:
        root: Results folder.
        stages: The plan, each stage after those that it needs.
    """
    summary = RunSummary()
    for stage in stages:
        lost = {**{name: name for name in summary.failed}, **summary.left_out}
        cause = next((lost[need] for need in stage.needs if need in lost), None)
        if is_done(root, stage.name):
            summary.done.add(stage.name)
        elif cause is not None:
            summary.left_out[stage.name] = cause
        else:
            summary.failed[stage.name] = _reason(root, stage.name)
    return summary


def format_time(seconds: float) -> str:
    """Return a duration as 45 s, 12:05 min or 3:07 h."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60}:{whole % 60:02d} min"
    return f"{whole // 3600}:{whole % 3600 // 60:02d} h"


def _reason(root: Path, name: str) -> str:
    """Say why a stage failed, by the last line of its log."""
    words = " ".join(last_lines(stage_folder(root, name) / LOG))
    return words.removeprefix("dovetail: ") or "it said nothing"


def _has_changed(root: Path, name: str, since: float) -> bool:
    """Say whether a stage's log was written to; file systems round its time."""
    log = stage_folder(root, name) / LOG
    return log.is_file() and log.stat().st_mtime >= since - 2.0


def last_lines(path: Path, count: int = 1, start: int = 0) -> list[str]:
    """Return the last lines of a log that are not empty; none where there is no log.

    Args:
        path: The log.
        count: Most lines.
        start: Where the log begins that is of interest [bytes].
    """
    text = _tail(path, start).replace("\r", "\n")
    lines = [line.strip() for line in text.splitlines()]
    return [line for line in lines if line][-count:]


def _tail(path: Path, start: int) -> str:
    """Return the end of a log; nothing where there is no log."""
    try:
        with open_regular(path, sys.maxsize) as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(start, file.tell() - 16_000))
            return file.read().decode("utf-8", "replace")
    except OSError:
        return ""


def end_with_parent() -> None:
    """End this process and its children as soon as the one that started it is gone."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.3)
        os.killpg(0, signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()


if __name__ == "__main__":
    end_with_parent()
    runpy.run_module("snakemake", run_name="__main__", alter_sys=True)
