"""Writes down what happens in the cockpit, as Episode logs.

One begins with each reset, and after a rest in which the arm was only held.
"""

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.episode import OBSERVED, Episode
from dovetail.errors import LogError
from dovetail.poses import Pose

IDLE_MAX = 40
"""Policy steps that are still written while nothing happens: 2 s."""
CYCLES_MAX = 120_000
"""Control cycles in one file: about 40 MB; the next file goes on."""
FIXTURE = "fixture_path [s, m, wxyz]"
"""Key of the metadata: rows of time, position and rotation where the fixture moved."""


class Diary:
    """Keeps the episode that runs, and writes it beside the control loop.

    A file is whole or absent. What cannot be written is said once, in `problem`.
    """

    def __init__(self, folder: Path | None) -> None:
        """Take the folder, made with the first log; None keeps nothing."""
        self.folder = folder
        self.files: list[Path] = []
        """Logs that were written."""
        self.problem = ""
        """Why a log could not be written; empty where all could."""
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="diary")
        self._episode: Episode | None = None
        self._about: dict[str, Any] = {}
        self._fixture: list[list[float]] = []
        self._idle = self._number = 0
        self._is_worth = False

    def begin(self, about: Mapping[str, Any]) -> None:
        """End the log that runs, and start one.

        Args:
            about: What runs where, plain data.
        """
        self.end()
        self._about = dict(about)
        self._fixture = []
        self._idle = 0
        self._open()

    def _open(self) -> None:
        self._episode = Episode(metadata=self._about) if self.folder else None
        self._is_worth = False
        self._fixture = self._fixture[-1:]

    def follow(self, stamp: float, fixture: Pose) -> None:
        """Note where the fixture is at a time [s], where that has changed."""
        row = [*fixture.position.tolist(), *fixture.quat_wxyz.tolist()]
        if not self._fixture or self._fixture[-1][1:] != row:
            self._fixture.append([stamp, *row])

    def add(
        self,
        state: ArmState,
        step: int,
        action: np.ndarray,
        reward: float,
        raw: np.ndarray,
        is_idle: bool,
    ) -> None:
        """Add a policy step.

        Args:
            state: What the arm said; its log holds the step's cycles.
            step: Number of the step in the episode.
            action: That was followed.
            reward: Of the step.
            raw: Unscaled observation after it.
            is_idle: Whether the arm was only held: soon, that is not written any more.
        """
        self._idle = self._idle + 1 if is_idle else 0
        if self._idle > IDLE_MAX:  # what happens next has a file of its own
            self.end()
            return
        if self._episode is None:
            self._open()
        if self._episode is None:
            return
        self._is_worth = self._is_worth or not is_idle
        observed = raw if len(raw) == len(OBSERVED) else None
        self._episode.append(state.log, step, action, reward, observed)
        if len(self._episode) >= CYCLES_MAX:
            self.end()

    def end(self) -> None:
        """Have what runs written, if anything happened in it."""
        episode, self._episode = self._episode, None
        if episode is None or self.folder is None or not self._is_worth:
            return
        episode.metadata[FIXTURE] = self._fixture
        self._number += 1
        name = f"{self._number:03d}.npz"
        self._writer.submit(self._write, episode, self.folder / name)

    def _write(self, episode: Episode, file: Path) -> None:
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self.files.append(episode.save(file))
        except (LogError, OSError) as error:
            self.problem = f"the log {file} is lost: {error}"

    def flush(self) -> None:
        """Wait until everything that ended is written."""
        done: Future[None] = self._writer.submit(lambda: None)
        done.result()

    def close(self) -> None:
        """Write what runs, and wait for it."""
        self.end()
        self._writer.shutdown(wait=True)
