"""Progress of a training run: progress.csv with a row per episode, and a bar."""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from dovetail.errors import ConfigError
from dovetail.files import write_atomic
from dovetail.reading import read_text

WINDOW = 50
"""Finished episodes behind the success rate and the reward that are shown."""
LEARNED = ("evaluating", "done")
"""Phases of a run that learns no more."""
_SHORTEST_BAR = 15
"""Columns that a bar has at least; words give way to it."""
_DROPPED = ("reward", "steps/s", "success")
"""Words that are left out, in this order, where a line has no room."""


class EpisodeRow(NamedTuple):
    """One finished episode: a row of progress.csv."""

    step: int
    """Environment steps of the run when it ended."""
    reward: float
    """Sum of its unscaled rewards."""
    length: int
    """Policy steps of 50 ms."""
    success: int
    """1 when the task was done."""
    contact_force_max: float
    """Largest contact force [N]."""
    wall_time: float
    """Training time of the run when it ended [s]."""


class TrainingStatus(NamedTuple):
    """Progress of a run."""

    step: int
    """Environment steps done."""
    success: float
    """Success rate of the last `WINDOW` episodes; nan before the first."""
    reward: float
    """Mean unscaled reward of the same; nan before the first."""
    rate: float
    """Environment steps per second, lately."""
    stage: str = ""
    """Stage of the run, in words; empty where only `steps` ends it."""
    phase: str = "training"
    """Phase of the run: pretraining, training, testing, evaluating or done."""
    is_steady: bool = True
    """True once the rate is of steps with updates, so that the time left follows."""


Report = Callable[[TrainingStatus], None]
"""Called now and then with the progress of a run."""


_PROGRESS_BYTES = 10_000_000
"""Largest progress.csv that is read [bytes]: 200,000 episodes; 2 s at worst."""


class EpisodeLog:
    """Appends finished episodes to progress.csv; a kill loses at most the last row."""

    def __init__(self, path: Path, step: int) -> None:
        """Open the file, dropping episodes after `step`: they will be lived again."""
        rows = [row for row in read_progress(path) if row.step <= step]
        self.before = tuple(rows)
        """Episodes of earlier sittings, oldest first."""
        lines = [",".join(EpisodeRow._fields), *(_format(row) for row in rows)]
        write_atomic(path, "\n".join(lines) + "\n")
        self._file = path.open("a", encoding="utf-8", buffering=1)
        self._recent = deque(rows[-WINDOW:], maxlen=WINDOW)

    def add(self, row: EpisodeRow) -> None:
        """Append one finished episode."""
        self._file.write(_format(row) + "\n")
        self._recent.append(row)

    def status(self, step: int, rate: float) -> TrainingStatus:
        """Return where the run stands, by the recent episodes."""
        return summarise(self._recent, step, rate)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def summarise(rows: Iterable[EpisodeRow], step: int, rate: float) -> TrainingStatus:
    """Return success rate and mean reward of the last `WINDOW` rows.

    Args:
        rows: Finished episodes, oldest first.
        step: Environment steps done.
        rate: Environment steps per second.
    """
    last = list(rows)[-WINDOW:]
    if not last:
        return TrainingStatus(step, math.nan, math.nan, rate)
    success = sum(row.success for row in last) / len(last)
    reward = sum(row.reward for row in last) / len(last)
    return TrainingStatus(step, success, reward, rate)


def _format(row: EpisodeRow) -> str:
    return (
        f"{row.step},{row.reward:.5g},{row.length},{row.success},"
        f"{row.contact_force_max:.4g},{row.wall_time:.2f}"
    )


def read_progress(path: Path) -> list[EpisodeRow]:
    """Read progress.csv; a last row that a kill cut short is left out.

    Returns:
        The rows; none when the file does not exist.

    Raises:
        ConfigError: A row before the last is damaged; says which.
    """
    if not path.exists():
        return []
    try:
        lines = read_text(path, _PROGRESS_BYTES).split("\n")[1:]
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(f"cannot read {path}: {reason}") from error
    if lines and not lines[-1]:
        lines.pop()
    rows: list[EpisodeRow] = []
    for number, line in enumerate(lines, start=2):
        cells = line.rstrip("\r").split(",")
        try:
            step, reward, length, success, force, wall_time = cells
            row = EpisodeRow(
                int(step),
                float(reward),
                int(length),
                int(success),
                float(force),
                float(wall_time),
            )
        except ValueError as error:
            if number == len(lines) + 1:
                break
            raise ConfigError(
                f"{path} line {number} is damaged: {line[:80]!r}"
            ) from error
        rows.append(row)
    return rows


class ProgressBar:
    """One rich bar per run; plain lines where the output is no terminal."""

    def __init__(self, total: int, names: list[str], console: Console) -> None:
        """Lay out the bars.

        Args:
            total: Environment steps of each run.
            names: One per run.
            console: Where to draw.
        """
        self._console = console
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f} steps"),
            TextColumn("{task.fields[text]}"),
            console=console,
            disable=not console.is_terminal,
        )
        self._total = total
        self._names = names
        fixed = f"{max(names, key=len)}  {total}/{total} steps "  # with the gaps
        self._beside = len(fixed) + _SHORTEST_BAR
        self._told: list[tuple[int, str]] = [(0, "")] * len(names)
        self._tasks = [
            self._progress.add_task(name, total=total, text="starting")
            for name in names
        ]

    def __enter__(self) -> "ProgressBar":
        """Show the bars."""
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the bars where they are."""
        self._progress.stop()

    def show(self, index: int, status: TrainingStatus) -> None:
        """Move one bar."""
        is_terminal = self._console.is_terminal
        room = self._console.width - self._beside if is_terminal else None
        text = describe_status(status, self._total, room)
        is_over = status.phase in LEARNED  # perhaps before all steps
        self._progress.update(
            self._tasks[index],
            completed=status.step,
            total=status.step if is_over else self._total,
            text=text,
        )
        if is_terminal:
            return
        step, phase = self._told[index]
        if status.phase != phase or status.step - step >= self._total / 20:
            self._told[index] = (status.step, status.phase)
            self._console.print(
                f"{self._names[index]}: {status.step}/{self._total} steps, {text}",
                highlight=False,
                soft_wrap=True,
            )


def describe_status(status: TrainingStatus, total: int, room: int | None = None) -> str:
    """Return success, reward, speed and time left as a line of text.

    Args:
        status: Progress of the run. The time left is shown once the speed is that of
            steps with updates: those before are many times faster.
        total: Environment steps of the run.
        room: Columns that it should take at most; words are left out for it, the last
            one never.
    """
    words = []
    if not math.isnan(status.success):
        words.append(f"success {100 * status.success:.0f} %")
        words.append(f"reward {status.reward:.1f}")
    if status.stage and status.phase not in LEARNED:
        words.append(status.stage)
    if status.phase != "training":
        words.append(status.phase)
    elif status.rate > 0.0:
        words.append(f"{status.rate:.0f} steps/s")
        if status.is_steady:
            left = round((total - status.step) / status.rate)
            most = "at most " if status.stage else ""
            words.append(f"{most}{left // 60}:{left % 60:02d} min left")
    for dropped in _DROPPED:
        if room is not None and len(", ".join(words)) > room:
            words = [w for w in words[:-1] if dropped not in w] + words[-1:]
    return ", ".join(words) or status.phase


class Stopwatch:
    """Training time over all sittings of a run, and its speed lately."""

    def __init__(
        self, already: float, step: int, num_updates: Callable[[], int]
    ) -> None:
        """Start.

        Args:
            already: Training time of earlier sittings [s].
            step: Environment steps of earlier sittings.
            num_updates: Returns the gradient steps of the run.
        """
        self._already = already
        self._marks = deque([(time.monotonic(), step)], maxlen=20)
        self._start = self._marks[0][0]
        self._num_updates = num_updates
        self._updates = num_updates()
        self._seen = 0

    def elapsed(self) -> float:
        """Return the training time, earlier sittings included [s]."""
        return self._already + time.monotonic() - self._start

    def speed(self, step: int) -> tuple[float, bool]:
        """Return environment steps per second over the last 20 calls, and if it lasts.

        It lasts from the second call on that finds updates: steps before the first are
        faster, and that is compiled first, which takes seconds.

        Args:
            step: Environment steps of the run.
        """
        updates = self._num_updates()
        now = time.monotonic()
        then, before = self._marks[0]
        if updates > self._updates:
            self._updates = updates
            self._seen += 1
            if self._seen == 1:
                self._marks.clear()
        self._marks.append((now, step))
        return (step - before) / max(now - then, 1e-9), self._seen > 1
