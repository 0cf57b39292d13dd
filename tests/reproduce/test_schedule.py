"""Stages run in order, once, and a failed one does not take the others with it."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dovetail.errors import ConfigError
from dovetail.reproduce.executor import LocalExecutor
from dovetail.reproduce.schedule import check_plan, find_done, ranks, run_stages
from dovetail.reproduce.stage import read_done, stage_folder


def run(root, stages, notes, workers=2):
    return run_stages(root, stages, LocalExecutor(workers), notes)


def result(root, stage):
    return read_done(root, stage)["result"]["sum"]


def times_run(root, name):
    return len((stage_folder(root, name) / "ran").read_text())


def test_a_stage_reads_what_the_stages_before_it_left(tmp_path, toys, notes):
    a, b = toys("a", value=2), toys("b", value=3)
    both = toys("both", needs=("a", "b"), of=["a", "b"])
    tally = run(tmp_path, [both, a, b], notes)
    assert tally.done == {"a", "b", "both"}
    assert result(tmp_path, both) == 5


def test_what_is_done_is_not_done_again(tmp_path, toys, notes):
    stages = [toys("a", value=1), toys("b", needs=("a",), of=["a"])]
    run(tmp_path, stages[:1], notes)
    run(tmp_path, stages, notes)
    assert times_run(tmp_path, "a") == times_run(tmp_path, "b") == 1


def test_the_longest_chain_goes_first(tmp_path, toys, notes):
    stages = [
        toys("short", expected=5.0),
        toys("first", expected=1.0),
        toys("last", expected=9.0, needs=("first",)),
    ]
    run(tmp_path, stages, notes, workers=1)
    assert notes.order == ["first", "last", "short"]
    assert ranks(stages) == {"short": 5.0, "first": 10.0, "last": 9.0}


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        ("refuse", "the toy is broken; take another"),
        ("crash", "RuntimeError: a bolt came off"),
        ("die", "its process was ended by signal 9 (killed, or out of memory?)"),
        ("missing", "AttributeError: module 'toy_stages' has no attribute 'missing'"),
    ],
)
def test_a_failed_stage_is_named_and_the_others_go_on(
    tmp_path, toys, notes, function, reason
):
    bad, good = toys("bad", function), toys("good", value=1)
    after = toys("after", needs=("bad",))
    later = toys("later", needs=("after", "good"))
    tally = run(tmp_path, [bad, after, later, good], notes)
    assert tally.done == {"good"}
    assert tally.failed == {"bad": reason}
    assert tally.left_out == {"after": "bad", "later": "bad"}
    assert notes.lost["later"] == "left out: it needs bad, which failed"


def test_a_failed_stage_is_tried_again_the_next_time(tmp_path, toys, notes):
    stage = toys("moody", "fail_once")
    assert run(tmp_path, [stage], notes).failed
    assert run(tmp_path, [stage], notes).done == {"moody"}


def test_a_folder_of_other_settings_is_refused_and_not_changed(tmp_path, toys, notes):
    run(tmp_path, [toys("a", value=1)], notes)
    before = (stage_folder(tmp_path, "a") / "done.json").read_bytes()
    with pytest.raises(
        ConfigError, match=r"settings\.value 1, this command asks for 2"
    ):
        run(tmp_path, [toys("a", value=2)], notes)
    assert (stage_folder(tmp_path, "a") / "done.json").read_bytes() == before


def test_a_begun_stage_of_other_settings_is_refused_too(tmp_path, toys, notes):
    run(tmp_path, [toys("a", "crash", value=1)], notes)
    with pytest.raises(ConfigError, match="choose another --out"):
        find_done(tmp_path, [toys("a", "crash", value=2)])


def test_a_damaged_marker_is_named(tmp_path, toys, notes):
    stage = toys("a", value=1)
    run(tmp_path, [stage], notes)
    (stage_folder(tmp_path, "a") / "done.json").write_text('{"name":')
    with pytest.raises(ConfigError, match=r"done\.json is damaged"):
        run(tmp_path, [stage], notes)


@pytest.mark.parametrize(
    ("needs", "message"),
    [
        ({"a": ("b",), "b": ("a",)}, "in a circle: a, b"),
        ({"a": ("c",)}, "stage a needs c, which is not planned"),
    ],
)
def test_a_plan_that_no_order_satisfies_is_refused(toys, needs, message):
    stages = [toys(name, needs=names) for name, names in needs.items()]
    with pytest.raises(ConfigError) as error:
        check_plan(stages)
    assert message in str(error.value)


def test_a_stage_planned_twice_is_refused(toys):
    with pytest.raises(ConfigError, match="stage a is planned twice"):
        check_plan([toys("a"), toys("a")])


def test_no_workers_are_refused():
    with pytest.raises(ConfigError, match="workers is 0; needs at least 1"):
        LocalExecutor(0)


DRIVER = """
import json, sys
from pathlib import Path
from dovetail.reproduce.executor import LocalExecutor
from dovetail.reproduce.schedule import run_stages
from dovetail.reproduce.stage import Stage
sys.path.insert(0, {tests!r})
from conftest import Notes
stages = [Stage(name="slow", run="toy_stages:wait"),
          Stage(name="next", run="toy_stages:count", needs=("slow",))]
run_stages(Path({root!r}), stages, LocalExecutor(2), Notes())
"""


def is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"


def wait_for(condition, seconds=120.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_after_a_kill_no_stage_goes_on_alone_and_the_next_run_finishes(
    tmp_path, toys, notes
):
    folder = str(Path(__file__).parent)
    script = DRIVER.format(tests=folder, root=str(tmp_path))
    driver = subprocess.Popen([sys.executable, "-c", script])
    pid_file = stage_folder(tmp_path, "slow") / "pid"
    wait_for(lambda: pid_file.exists() and pid_file.read_text())
    pid = int(pid_file.read_text())
    driver.send_signal(signal.SIGKILL)
    driver.wait()
    wait_for(lambda: not is_alive(pid))
    (tmp_path / "go").touch()
    stages = [toys("slow", "wait"), toys("next", needs=("slow",))]
    assert run(tmp_path, stages, notes).done == {"slow", "next"}
    assert times_run(tmp_path, "slow") == 2
    done = json.loads((stage_folder(tmp_path, "slow") / "done.json").read_text())
    assert done["result"] == {"sum": 0}
