"""Runs each stage after those it needs; a failed one stops only those that need it."""

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from dovetail.errors import ConfigError
from dovetail.files import write_atomic
from dovetail.reading import open_regular
from dovetail.reproduce.executor import Executor, StageJob
from dovetail.reproduce.stage import (
    DONE,
    LOG,
    STAGE,
    Stage,
    read_done,
    read_json,
    require_same,
    stage_folder,
)

_WAIT = 0.1
_REASONS = {
    2: "",
    111: "the machine that Ray chose does not see the results folder: put --out on a "
    "file system that every machine of the cluster has at the same path",
    112: "Ray has lost it: its machine or worker died again and again",
}


class Display(Protocol):
    """Shows how the stages get on."""

    def started(self, stage: Stage) -> None:
        """A stage has been started."""
        ...

    def finished(self, stage: Stage, seconds: float) -> None:
        """A stage is done."""
        ...

    def failed(self, stage: Stage, reason: str) -> None:
        """A stage has failed, or cannot run because of one that has."""
        ...

    def tick(self) -> None:
        """Time goes by."""
        ...


@dataclass
class RunSummary:
    """Stages that are done, failed or left out."""

    done: set[str] = field(default_factory=set)
    """Stages that are done, in this sitting or before."""
    failed: dict[str, str] = field(default_factory=dict)
    """Reason of each failed stage, by its name."""
    left_out: dict[str, str] = field(default_factory=dict)
    """Stages that could not run, and the failed one that they need."""


def check_plan(stages: Sequence[Stage]) -> None:
    """Refuse a plan that no order can satisfy.

    Raises:
        ConfigError: A name twice, a need that is no stage, or needs in a circle.
    """
    names = [stage.name for stage in stages]
    for stage in stages:
        if names.count(stage.name) > 1:
            raise ConfigError(f"stage {stage.name} is planned twice")
        if missing := [need for need in stage.needs if need not in names]:
            raise ConfigError(
                f"stage {stage.name} needs {', '.join(missing)}, which is not planned"
            )
    left = {stage.name: set(stage.needs) for stage in stages}
    while left:
        free = [name for name, needs in left.items() if not needs & left.keys()]
        if not free:
            raise ConfigError(f"stages need each other in a circle: {', '.join(left)}")
        for name in free:
            del left[name]


def ranks(stages: Sequence[Stage]) -> dict[str, float]:
    """Return for each stage how long it and the longest chain after it take [s]."""
    found: dict[str, float] = {}

    def rank(stage: Stage) -> float:
        if stage.name not in found:
            after = [rank(other) for other in stages if stage.name in other.needs]
            found[stage.name] = stage.expected + max(after, default=0.0)
        return found[stage.name]

    for stage in stages:
        rank(stage)
    return found


def find_done(root: Path, stages: Sequence[Stage]) -> set[str]:
    """Return the stages that an earlier sitting finished.

    Raises:
        ConfigError: A stage's folder holds another experiment.
    """
    for stage in stages:
        begun = stage_folder(root, stage.name) / STAGE
        if begun.exists():
            require_same(stage, read_json(begun), begun.parent)
    return {stage.name for stage in stages if read_done(root, stage) is not None}


def run_stages(
    root: Path, stages: Sequence[Stage], executor: Executor, display: Display
) -> RunSummary:
    """Run every stage that is not done yet; a failed one does not stop the others.

    The longest chain of stages goes first. Stages that are running when this is
    interrupted are ended; the next sitting goes on with them.

    Args:
        root: Results folder.
        stages: The plan; see `check_plan`.
        executor: Where they run.
        display: Told what happens.
    """
    tally = RunSummary(done=find_done(root, stages))
    order = ranks(stages)
    waiting = sorted(
        (stage for stage in stages if stage.name not in tally.done),
        key=lambda stage: -order[stage.name],
    )
    running: dict[str, tuple[Stage, StageJob, float]] = {}
    try:
        while waiting or running:
            _leave_out(waiting, tally, display)
            for stage in [s for s in waiting if tally.done.issuperset(s.needs)]:
                if len(running) >= executor.slots:
                    break
                waiting.remove(stage)
                _prepare(root, stage)
                job = executor.start(root, stage.name)
                running[stage.name] = (stage, job, time.monotonic())
                display.started(stage)
            _collect(root, running, tally, display)
            display.tick()
            time.sleep(_WAIT if running else 0.0)
    finally:
        for _, job, _ in running.values():
            job.stop()
    return tally


def _leave_out(waiting: list[Stage], tally: RunSummary, display: Display) -> None:
    """Take out what needs a failed stage, and what needs that, and so on."""
    is_changed = True
    while is_changed:
        is_changed = False
        lost = {**{name: name for name in tally.failed}, **tally.left_out}
        for stage in list(waiting):
            cause = next((lost[need] for need in stage.needs if need in lost), None)
            if cause is not None:
                waiting.remove(stage)
                tally.left_out[stage.name] = cause
                display.failed(stage, f"left out: it needs {cause}, which failed")
                is_changed = True


def _prepare(root: Path, stage: Stage) -> None:
    folder = stage_folder(root, stage.name)
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(folder / STAGE, json.dumps(stage.to_json(), indent=2) + "\n")


def _collect(
    root: Path,
    running: dict[str, tuple[Stage, StageJob, float]],
    tally: RunSummary,
    display: Display,
) -> None:
    for stage, job, start in list(running.values()):
        code = job.poll()
        if code is None:
            continue
        del running[stage.name]
        folder = stage_folder(root, stage.name)
        if code == 0 and (folder / DONE).exists():
            tally.done.add(stage.name)
            display.finished(stage, time.monotonic() - start)
        else:
            tally.failed[stage.name] = _reason(code, folder / LOG)
            display.failed(stage, tally.failed[stage.name])


def last_lines(path: Path, count: int = 1) -> list[str]:
    """Return the last lines of a log that are not empty; none where there is no log."""
    try:
        with open_regular(path, sys.maxsize) as file:
            file.seek(0, 2)
            file.seek(max(0, file.tell() - 4000))
            text = file.read().decode("utf-8", "replace")
    except OSError:
        return []
    lines = [line.strip() for line in text.replace("\r", "\n").splitlines()]
    return [line for line in lines if line][-count:]


def _reason(code: int, log: Path) -> str:
    """Say why a stage failed: by its own words, or by how its process ended."""
    words = " ".join(last_lines(log))
    if code < 0:
        return f"its process was ended by signal {-code} (killed, or out of memory?)"
    return _REASONS.get(code) or words.removeprefix("dovetail: ") or f"exit code {code}"
