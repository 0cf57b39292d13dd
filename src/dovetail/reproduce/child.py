"""The process of one stage: `python -m dovetail.reproduce.child OUT NAME`.

A stage runs in a process of its own, so that its crash is its own. It ends with the
process that started it, and ends its own child processes.
"""

import fcntl
import os
import pkgutil
import platform
import signal
import sys
import threading
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from rich.console import Console

from dovetail.errors import ConfigError, DovetailError
from dovetail.files import open_lock
from dovetail.reproduce.stage import (
    STAGE,
    StageContext,
    read_json,
    stage_folder,
    write_done,
)

FAILED = 2
"""Exit code of a stage that ended with an error of dovetail's own."""
PATIENCE = 20.0
"""Longest wait for the process of an earlier sitting to end [s]."""


def main(words: Sequence[str]) -> int:
    """Run one stage; return 0 when it is done, `FAILED` with the reason printed."""
    root, name = Path(words[0]), words[1]
    end_with_parent()
    try:
        lock = _lock(stage_folder(root, name) / ".lock")
        _run(root, name)
        lock.close()
    except DovetailError as error:
        print(f"dovetail: {error}", flush=True)  # noqa: T201  (into the log)
        return FAILED
    return 0


def _run(root: Path, name: str) -> None:
    stage = read_json(stage_folder(root, name) / STAGE)
    module, _, function = stage["run"].partition(":")
    console = Console(file=sys.stdout, width=120, force_terminal=False)
    sitting = StageContext(root, name, dict(stage["settings"]), console)
    start = time.monotonic()
    result = pkgutil.resolve_name(f"{module}:{function}")(sitting)
    write_done(
        root,
        stage,
        result=result,
        last_sitting_s=round(time.monotonic() - start, 1),
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
        machine=f"{platform.node()}, {platform.machine()}, {os.cpu_count()} cores",
    )


def _lock(path: Path) -> IO[str]:
    """Take the stage's folder for this process; the system frees it when that dies.

    Raises:
        ConfigError: Another process has it and does not end.
    """
    file = open_lock(path)
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return file
        except BlockingIOError as error:
            if time.monotonic() > deadline:
                file.close()
                raise ConfigError(
                    f"another process works in {path.parent}; wait for it, or end it"
                ) from error
            time.sleep(0.1)


def end_with_parent() -> None:
    """End this process and its children as soon as the one that started it is gone."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.3)
        if os.getpgid(0) == os.getpid():  # it leads a group of its own
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
