"""Episode logs of the cockpit, written beside the control loop.

A log begins with each reset, and after a rest in which the arm was only held.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.cockpit.snapshot import Snapshot
from dovetail.envs.log_facts import FIRST, SUCCESS
from dovetail.episode import OBSERVED, Episode
from dovetail.errors import LogError
from dovetail.poses import Pose

IDLE_MAX = 40
"""Policy steps that are still written while nothing happens: 2 s."""
CYCLES_MAX = 120_000
"""Control cycles in one file: about 40 MB; the next file goes on."""
FIXTURE = "fixture_path [s, m, wxyz]"
"""Key of the metadata: rows of time, position and rotation where the fixture moved."""
BELIEVED = "believed_path [s, m, wxyz]"
"""The same of its believed pose."""
PULL = "pull_path [s, N]"
"""Key of the metadata: rows of time and force where the user's pull changed."""
DEMONSTRATION = "demonstration"
"""Key of the metadata: finished or unfinished, in a demonstration."""
DEMONSTRATIONS = "demonstrations"
"""Folder of demonstrations, in that of the logs."""


class EpisodeLogger:
    """Collects the episode that runs, and writes it in a thread of its own.

    A file is whole or absent. A failed write is reported once, in `problem`. A
    demonstration has a file of its own in `demonstrations`, from its first motion to
    its end; it stays unless its user throws it away.
    """

    def __init__(self, folder: Path | None) -> None:
        """Take the folder, made with the first log; None keeps nothing."""
        self.folder = folder
        self.files: list[Path] = []
        """Logs that were written."""
        self.problem = ""
        """Reason why a log could not be written; empty if all could."""
        self.is_demonstration = False
        """True while a demonstration runs."""
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="episode logger")
        self._episode: Episode | None = None
        self._about: dict[str, Any] = {}
        self._observed: Sequence[str] = OBSERVED
        self._parts: Sequence[str] = ()
        self._paths: dict[str, list[list[float]]] = {}
        self._idle = self._number = 0
        self._is_worth = False
        self._newest: Path | None = None

    @property
    def demonstrations(self) -> list[Path]:
        """Demonstrations that were written and not thrown away."""
        return [file for file in self.files if file.parent.name == DEMONSTRATIONS]

    def describe_demonstrations(self) -> str:
        """Return how many there are, and whether one runs, in words; empty for none."""
        count = len(self.demonstrations)
        words = [f"{count} demonstration{'s' if count != 1 else ''}"] if count else []
        return ", ".join(words + ["one runs"] * self.is_demonstration)

    def begin(
        self,
        about: Mapping[str, Any],
        observed: Sequence[str] = OBSERVED,
        parts: Sequence[str] = (),
    ) -> None:
        """End the log that runs, and start one.

        Args:
            about: Metadata: plain data.
            observed: Names of the observation's columns.
            parts: Names of the columns of the parts' joints.
        """
        self.end()
        self._about, self._observed, self._parts = dict(about), observed, parts
        self._paths = {FIXTURE: [], BELIEVED: [], PULL: []}
        self._idle = 0
        self._newest = None
        self._open()

    def begin_demonstration(self) -> None:
        """Make the log that has begun a demonstration."""
        self.is_demonstration = True

    def see_first(self, raw: np.ndarray) -> None:
        """Note the unscaled observation before the first action."""
        if self._episode is not None:
            seen = zip(self._observed, raw.tolist(), strict=True)
            self._episode.metadata[FIRST] = dict(seen)

    def _open(self) -> None:
        self._episode = None
        if self.folder:
            self._episode = Episode(
                metadata=self._about, observed=self._observed, parts=self._parts
            )
        self._is_worth = False
        self._paths = {key: rows[-1:] for key, rows in self._paths.items()}

    def follow(
        self, stamp: float, fixture: Pose, snapshot: Snapshot | None = None
    ) -> None:
        """Note the fixture's pose at a time [s], where it has changed.

        Args:
            stamp: Time of the episode.
            fixture: True pose.
            snapshot: Its believed pose and the pull are noted, too.
        """
        now = {FIXTURE: [*fixture.position, *fixture.quat_wxyz]}
        if snapshot is not None:
            believed = snapshot.believed
            now[BELIEVED] = [*believed.position, *believed.quat_wxyz]
            now[PULL] = [*snapshot.pull]
        for key, values in now.items():
            row, rows = [float(value) for value in values], self._paths[key]
            if not rows or rows[-1][1:] != row:
                rows.append([stamp, *row])

    def add(
        self,
        state: ArmState,
        step: int,
        reward: float,
        info: Mapping[str, Any],
        *,
        is_idle: bool = False,
    ) -> None:
        """Add a policy step.

        Args:
            state: State of the arm; its log holds the step's cycles.
            step: Number of the step in the episode.
            reward: Of the step.
            info: Info of a `TeleopWrapper`: action, intervention, observation.
            is_idle: Whether the arm was only held: soon, that is not written any more.
        """
        raw = info["observation_raw"]
        self._idle = self._idle + 1 if is_idle else 0
        if self.is_demonstration and is_idle and not self._is_worth:
            self.see_first(raw)  # nothing was shown yet
            return
        if self._idle > IDLE_MAX:  # what happens next has a file of its own
            if not self.is_demonstration:
                self.end()
            return
        if self._episode is None:
            self._open()
        if self._episode is None:
            return
        self._is_worth = self._is_worth or not is_idle
        self._episode.append(
            state.log,
            step,
            info["action"],
            reward,
            raw,
            is_intervention=info["is_intervention"],
            parts=state.parts,
        )
        if len(self._episode) >= CYCLES_MAX:
            self.end()

    def end(self, success: bool = False) -> None:
        """End the log; write it if anything happened in it.

        Args:
            success: Whether the task was done; a demonstration without is unfinished.
        """
        episode, self._episode = self._episode, None
        is_shown, self.is_demonstration = self.is_demonstration, False
        if episode is None or self.folder is None or not self._is_worth:
            return
        episode.metadata |= {**self._paths, SUCCESS: success}
        folder = self.folder
        if is_shown:
            episode.metadata[DEMONSTRATION] = "finished" if success else "unfinished"
            folder = folder / DEMONSTRATIONS
        file = self._next_file(folder)
        self._newest = file if is_shown else None
        self._writer.submit(self._write, episode, file)

    def _next_file(self, folder: Path) -> Path:
        """Return a file that does not exist, also not of an earlier cockpit."""
        while True:
            self._number += 1
            file = folder / f"{self._number:03d}.npz"
            if not file.exists():
                return file

    def end_demonstration(self, is_kept: bool) -> str:
        """End the demonstration that runs, if one does; keep or throw away the newest.

        The others stay. One that is kept before it succeeded is unfinished.

        Returns:
            What was done, in words.
        """
        was_running = self.is_demonstration
        if was_running and not is_kept:
            self.is_demonstration, self._episode = False, None
            return "thrown away"
        if is_kept:
            self.end()
        file = self._newest
        if file is None:
            return "there is no demonstration"
        if is_kept:
            kind = "unfinished, " if was_running else ""
            return f"kept, {kind}as {file.name}"
        self._newest = None
        self.flush()
        file.unlink(missing_ok=True)
        self.files = [other for other in self.files if other != file]
        return f"{file.name} is thrown away"

    def _write(self, episode: Episode, file: Path) -> None:
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self.files.append(episode.save(file))
        except (LogError, OSError) as error:
            self.problem = f"the log {file} is lost: {error}"

    def flush(self) -> None:
        """Wait until everything that ended is written."""
        self._writer.submit(lambda: None).result()

    def close(self) -> None:
        """Write the log that runs, and wait for it."""
        self.end()
        self._writer.shutdown(wait=True)
