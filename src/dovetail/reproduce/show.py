"""Display of running experiments: a line per stage, and the time left."""

import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from dovetail.reproduce.schedule import last_lines
from dovetail.reproduce.stage import LOG, Stage, stage_folder


def format_time(seconds: float) -> str:
    """Return a duration as 45 s, 12:05 min or 3:07 h."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60}:{whole % 60:02d} min"
    return f"{whole // 3600}:{whole % 3600 // 60:02d} h"


class Forecast:
    """Forecast of the time left, by the time that stages of each kind have taken."""

    def __init__(self, stages: Sequence[Stage], slots: int) -> None:
        """Take what is still to be done, and how many stages run at once."""
        self._left = {stage.name: stage for stage in stages}
        self._slots = slots
        self._taken: dict[str, tuple[float, float]] = {}

    def finished(self, stage: Stage, seconds: float | None) -> None:
        """Take a stage out; None where its time says nothing."""
        self._left.pop(stage.name, None)
        if seconds is not None:
            real, expected = self._taken.get(stage.run, (0.0, 0.0))
            self._taken[stage.run] = (real + seconds, expected + stage.expected)

    def seconds(self, running: dict[str, float]) -> float:
        """Return the time left [s].

        Args:
            running: How long each running stage has been at it [s].
        """
        times = [
            max(0.0, self._expect(stage) - running.get(name, 0.0))
            for name, stage in self._left.items()
        ]
        return max(sum(times) / self._slots, max(times, default=0.0))

    def _expect(self, stage: Stage) -> float:
        totals = self._taken.get(stage.run)
        if totals is None:
            sums = list(zip(*self._taken.values(), strict=True))
            totals = (sum(sums[0]), sum(sums[1])) if sums else (1.0, 1.0)
        return stage.expected * totals[0] / totals[1]


class StageDisplay:
    """Finished stages as lines, running ones below them with their newest words."""

    def __init__(
        self,
        root: Path,
        stages: Sequence[Stage],
        done: set[str],
        slots: int,
        console: Console,
    ) -> None:
        """Take the plan and what is done of it already."""
        self._root = root
        self._console = console
        self._total = len(stages)
        self._count = len(done)
        self._running: dict[str, tuple[Stage, float]] = {}
        left = [stage for stage in stages if stage.name not in done]
        self._forecast = Forecast(left, slots)
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._shown = 0.0

    def __enter__(self) -> "StageDisplay":
        """Show."""
        if self._count:
            self._print(f"{self._count} of {self._total} stages were done before")
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the finished lines where they are."""
        if self._console.is_terminal:
            self._live.stop()

    def started(self, stage: Stage) -> None:
        """Show a stage as running."""
        self._running[stage.name] = (stage, time.monotonic())
        self._shown = 0.0

    def finished(self, stage: Stage, seconds: float) -> None:
        """Print the line of a stage that is done."""
        self._running.pop(stage.name, None)
        self._count += 1
        self._forecast.finished(stage, seconds)
        text = f"done    {stage.name}  {format_time(seconds)}"
        if not self._console.is_terminal:
            text += f"  ({self._summary()})"
        self._print(text)

    def failed(self, stage: Stage, reason: str) -> None:
        """Print the line of a stage that cannot be done now."""
        self._running.pop(stage.name, None)
        self._forecast.finished(stage, None)
        self._print(f"FAILED  {stage.name}  {reason}")

    def tick(self) -> None:
        """Show the running stages, once a second."""
        now = time.monotonic()
        if not self._console.is_terminal or now - self._shown < 1.0:
            return
        self._shown = now
        table = Table.grid(padding=(0, 2), expand=True)
        for _ in range(2):
            table.add_column(no_wrap=True)
        table.add_column(no_wrap=True, overflow="ellipsis", ratio=1)
        for stage, start in self._running.values():
            words = last_lines(stage_folder(self._root, stage.name) / LOG)
            newest = Text(words[0] if words else "starting", style="dim")
            table.add_row(f"running {stage.name}", format_time(now - start), newest)
        self._live.update(Group(table, Text(self._summary())), refresh=True)

    def _summary(self) -> str:
        now = time.monotonic()
        running = {name: now - start for name, (_, start) in self._running.items()}
        left = format_time(self._forecast.seconds(running))
        return f"{self._count} of {self._total} stages done, about {left} left"

    def _print(self, text: str) -> None:
        self._console.print(text, soft_wrap=True, highlight=False, markup=False)
