"""progress.csv and the progress bar."""

import math
import time
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from dovetail.learn.one_run import train_one
from dovetail.learn.progress import (
    LEARNED,
    WINDOW,
    EpisodeLog,
    EpisodeRow,
    ProgressBar,
    Stopwatch,
    TrainingStatus,
    describe_status,
    read_progress,
    summarise,
)


def row(step: int, *, success: int = 0, reward: float = -1.0) -> EpisodeRow:
    return EpisodeRow(step, reward, 20, success, 3.5, 0.1 * step)


def test_every_finished_episode_is_on_the_disk_at_once(tmp_path: Path):
    log = EpisodeLog(tmp_path / "progress.csv", 0)
    log.add(row(20))
    log.add(row(40, success=1, reward=45.25))
    assert read_progress(tmp_path / "progress.csv") == [
        row(20),
        row(40, success=1, reward=45.25),
    ]
    log.close()


def test_a_resumed_log_drops_episodes_after_the_checkpoint(tmp_path: Path):
    log = EpisodeLog(tmp_path / "progress.csv", 0)
    for step in (20, 40, 60):
        log.add(row(step))
    log.close()
    again = EpisodeLog(tmp_path / "progress.csv", 40)
    again.add(row(50, success=1))
    again.close()
    steps = [r.step for r in read_progress(tmp_path / "progress.csv")]
    assert steps == [20, 40, 50]


def test_success_and_reward_are_those_of_the_last_episodes():
    assert math.isnan(summarise([], 0, 0.0).success)
    rows = [row(i) for i in range(30)]
    rows += [row(30 + i, success=1, reward=9.0) for i in range(WINDOW // 2)]
    status = summarise(rows, 100, 5.0)
    assert status == TrainingStatus(100, 0.5, 4.0, 5.0)


def test_the_status_line_has_success_reward_speed_and_time_left():
    status = TrainingStatus(4000, 0.25, -12.34, 100.0)
    line = describe_status(status, 16_000)
    assert line == "success 25 %, reward -12.3, 100 steps/s, 2:00 min left"
    assert describe_status(status._replace(phase="evaluating"), 16_000).endswith(
        "evaluating"
    )
    assert describe_status(TrainingStatus(0, math.nan, math.nan, 0.0), 10) == "training"


def test_no_time_left_is_told_before_the_speed_is_that_of_updates(monkeypatch):
    """1000 fast steps, a compilation of 10 s, then 20 steps/s."""
    now, updates = 0.0, 7  # of the sitting before
    monkeypatch.setattr(time, "monotonic", lambda: now)
    watch = Stopwatch(0.0, 0, lambda: updates)
    told = []
    for step in range(100, 3001, 100):
        now += 0.1 if step <= 1000 else 15.0 if step == 1100 else 5.0
        updates = 7 + 2 * max(0, step - 1000)
        rate, is_steady = watch.speed(step)
        line = describe_status(
            TrainingStatus(step, 0.5, 1.0, rate, is_steady=is_steady), 3100
        )
        told.append("min left" in line)
        if is_steady:
            assert rate == pytest.approx(20.0)
    assert told == [step > 1100 for step in range(100, 3001, 100)]
    assert line.endswith("20 steps/s, 0:05 min left")


def test_a_training_tells_no_time_left_before_its_updates(small):
    told = []
    config = replace(small, steps=700, learning_starts=350, eval_episodes=0)
    train_one(config, told.append)
    steady = [s.is_steady for s in told if s.phase == "training"]
    assert steady == [False, False, False, False, True, True, True]
    assert told[-1].phase == "done"  # there is nothing to evaluate


@pytest.mark.parametrize("width", [80, 95, 130])
def test_the_bar_has_room_whatever_the_words(width):
    output = StringIO()
    console = Console(file=output, force_terminal=True, width=width, color_system=None)
    with ProgressBar(60_000, ["seed 0"], console) as bar:
        bar.show(0, TrainingStatus(10_000, 1.0, -1234567.8, 123.0))
    line = output.getvalue().rpartition("\n")[0].rpartition("\x1b[2K")[2]
    assert len(line) <= width
    assert line.index(" 10000/60000 steps") - len("seed 0 ") >= 15
    assert "success 100 %" in line
    assert "6:47 min left" in line
    assert ("steps/s" in line, "reward" in line) == (width > 80, width > 95)


@pytest.mark.parametrize("phase", LEARNED)
def test_the_bar_of_a_run_that_has_learned_is_full(phase):
    output = StringIO()
    console = Console(file=output, force_terminal=True, width=120, color_system=None)
    status = TrainingStatus(400, 1.0, 45.0, 10.0, stage="test 299/300")
    with ProgressBar(1000, ["seed 0"], console) as bar:
        bar.show(0, status)
        assert "400/1000 steps" in describe(bar)
        bar.show(0, status._replace(phase=phase))
        assert "400/400 steps" in describe(bar)


def describe(bar):
    """Return the bar as it is drawn now."""
    console = Console(file=StringIO(), width=120, color_system=None)
    console.print(bar._progress.get_renderable())
    return console.file.getvalue()


def test_the_status_line_says_how_far_the_run_is_from_its_end():
    status = TrainingStatus(4000, 0.95, 40.0, 100.0, stage="settling 40 %")
    line = describe_status(status, 16_000)
    assert line.endswith("settling 40 %, 100 steps/s, at most 2:00 min left")
    testing = describe_status(status._replace(phase="testing", rate=0.0), 16_000)
    assert testing.endswith("settling 40 %, testing")
    for phase in LEARNED:
        over = describe_status(status._replace(phase=phase), 16_000)
        assert over == f"success 95 %, reward 40.0, {phase}"


@pytest.mark.parametrize("is_terminal", [True, False])
def test_the_bar_shows_every_run_on_a_terminal_and_in_a_file(is_terminal):
    output = StringIO()
    console = Console(file=output, force_terminal=is_terminal, width=120)
    with ProgressBar(1000, ["seed 0", "seed 1"], console) as bar:
        for step in range(0, 1001, 10):
            bar.show(0, TrainingStatus(step, 0.5, 1.0, 10.0))
        bar.show(1, TrainingStatus(500, 1.0, 48.0, 10.0))
    text = output.getvalue()
    for words in ("seed 0", "1000/1000 steps", "seed 1", "500/1000 steps", "100 %"):
        assert words in text
    if not is_terminal:
        assert len(text.splitlines()) <= 25
