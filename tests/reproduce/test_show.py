"""What is seen while stages run, and how the time left is guessed."""

from io import StringIO

import pytest
from rich.console import Console

from dovetail.reproduce.schedule import last_lines
from dovetail.reproduce.show import Forecast, StageDisplay, format_time


@pytest.mark.parametrize(
    ("seconds", "text"), [(45.2, "45 s"), (725, "12:05 min"), (11_220, "3:07 h")]
)
def test_times_have_their_unit(seconds, text):
    assert format_time(seconds) == text


def test_the_time_left_follows_how_long_stages_of_the_kind_took(toys):
    stages = [toys(name, expected=10.0) for name in "abcd"]
    forecast = Forecast(stages, slots=2)
    assert forecast.seconds({}) == 20.0
    forecast.finished(stages[0], 30.0)  # three times as long as expected
    assert forecast.seconds({}) == pytest.approx(45.0)
    assert forecast.seconds({"b": 15.0}) == pytest.approx(37.5)


def test_the_time_left_is_at_least_that_of_the_longest_stage(toys):
    stages = [toys("long", expected=100.0), toys("short", expected=1.0)]
    assert Forecast(stages, slots=8).seconds({}) == 100.0


def test_a_line_for_each_stage_that_ended(tmp_path, toys):
    stages = [toys(name) for name in ("old", "good", "bad")]
    out = StringIO()
    console = Console(file=out, width=200)
    with StageDisplay(tmp_path, stages, {"old"}, 2, console) as display:
        for stage in stages[1:]:
            display.started(stage)
        display.tick()
        display.finished(stages[1], 61.0)
        display.failed(stages[2], "a bolt came off")
    assert "1 of 3 stages were done before" in out.getvalue()
    assert "done    good  1:01 min  (2 of 3 stages done, about" in out.getvalue()
    assert "FAILED  bad  a bolt came off" in out.getvalue()


def test_a_terminal_shows_the_newest_words_of_running_stages(tmp_path, toys):
    stage = toys("slow")
    (tmp_path / "stages" / "slow").mkdir(parents=True)
    (tmp_path / "stages" / "slow" / "log.txt").write_text("10/400\r20/400 steps\n\n")
    out = StringIO()
    console = Console(file=out, width=100, force_terminal=True)
    with StageDisplay(tmp_path, [stage], set(), 1, console) as display:
        display.started(stage)
        display.tick()
    assert "running slow" in out.getvalue()
    assert "20/400 steps" in out.getvalue()


def test_a_stage_without_a_log_has_no_words(tmp_path):
    assert last_lines(tmp_path / "log.txt") == []
