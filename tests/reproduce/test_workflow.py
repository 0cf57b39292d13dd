"""Stages run in order, once, and a failed one does not take the others with it."""

import os
import signal
import socket
import subprocess
import sys
import time
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console
from toy_workflow import SNAKEFILE, toy, write

from dovetail.errors import ConfigError, DovetailError
from dovetail.plants.twin import load_twin
from dovetail.reproduce import workflow
from dovetail.reproduce.budget import SMOKE
from dovetail.reproduce.design import Design
from dovetail.reproduce.folder import is_done, stage_folder, write_twins
from dovetail.reproduce.plan import SCRATCH, plan
from dovetail.reproduce.workflow import last_lines, run_stages, summarise
from extras import need

HERE = Path(__file__).parent


@pytest.fixture
def snakefile(tmp_path_factory, monkeypatch):
    """The rule of the toys in place of the experiments'."""
    need("snakemake")
    path = tmp_path_factory.mktemp("toys") / "Snakefile"
    path.write_text(SNAKEFILE)
    monkeypatch.setattr(workflow, "SNAKEFILE", path)
    return path


def run(root, stages, words=("--cores", "2")):
    """Returns what became of the stages, and what was shown."""
    out = StringIO()
    write(root, stages)
    summary = run_stages(root, stages, words, Console(file=out, width=200))
    return summary, out.getvalue()


def times_run(root, name):
    return len((stage_folder(root, name) / "ran").read_text().split())


def test_stages_run_in_order_and_what_is_done_is_not_done_again(tmp_path, snakefile):
    first = toy("first", "echo x >> ran")
    then = toy("then", "cat ../first/ran; echo x >> ran", needs=("first",))
    summary, shown = run(tmp_path, [first, then])
    assert summary.done == {"first", "then"}
    assert "done    then  (2 of 2 stages done" in shown
    (stage_folder(tmp_path, "then") / "done").unlink()
    summary, shown = run(tmp_path, [first, then])
    assert summary.done == {"first", "then"}
    assert "1 of 2 stages were done before" in shown
    assert (times_run(tmp_path, "first"), times_run(tmp_path, "then")) == (1, 2)


def test_a_failed_stage_is_named_and_tried_again_and_the_others_go_on(
    tmp_path, snakefile
):
    stages = [
        toy("good"),
        toy("refuses", "echo 'dovetail: the toy is broken'; exit 2"),
        toy("moody", "[ -e tried ] || { touch tried; echo not yet; exit 1; }"),
        toy("after", needs=("refuses",)),
        toy("later", needs=("after", "good")),
    ]
    summary, shown = run(tmp_path, stages)
    assert summary.done == {"good"}
    assert "FAILED  refuses  the toy is broken" in shown
    assert summary.failed == {"refuses": "the toy is broken", "moody": "not yet"}
    assert summary.left_out == {"after": "refuses", "later": "refuses"}
    summary, _ = run(tmp_path, stages)
    assert summary.done == {"good", "moody"}
    assert times_run(tmp_path, "good") == 1


def test_a_stage_cut_short_finds_what_it_had_made(tmp_path, snakefile):
    stages = [toy("moody", "[ -e checkpoint ] || { touch checkpoint; kill -9 $$; }")]
    assert run(tmp_path, stages)[0].failed.keys() == {"moody"}
    assert run(tmp_path, stages)[0].done == {"moody"}


def test_a_snakemake_that_runs_nothing_says_why(tmp_path, snakefile):
    with pytest.raises(DovetailError, match="no-such-profile"):
        run(tmp_path, [toy("a")], ["--profile", "no-such-profile"])
    assert not is_done(tmp_path, "a")


def test_a_profile_says_where_the_stages_run(tmp_path, snakefile):
    profile = snakefile.parent / "profile.yaml"
    profile.write_text("cores: 1\n")
    summary, _ = run(tmp_path, [toy("a")], ["--profile", str(profile.parent)])
    assert summary.done == {"a"}


def test_nothing_in_the_folder_is_executed(tmp_path, snakefile):
    profile = tmp_path / "profiles" / "default"
    profile.mkdir(parents=True)
    evil = {"precommand": "touch evil", "snakefile": "Snakefile"}
    (profile / "config.yaml").write_text("".join(f"{k}: {evil[k]}\n" for k in evil))
    (tmp_path / "Snakefile").write_text("open('evil', 'w')\n")
    for name in ("json", "snakemake", "dovetail"):
        (tmp_path / f"{name}.py").write_text("open('evil', 'w')\n")
    (tmp_path / "evil-too").touch()
    (tmp_path / workflow.OUTPUT).symlink_to("evil-too")
    with pytest.raises(ConfigError):
        run(tmp_path, [toy("a")])
    (tmp_path / workflow.OUTPUT).unlink()
    assert run(tmp_path, [toy("a")])[0].done == {"a"}
    assert not list(tmp_path.rglob("evil"))
    assert not (tmp_path / "evil-too").read_bytes()


def test_a_port_of_the_cabinet_that_is_taken_is_named(tmp_path):
    need("snakemake")
    twins = {"medium": load_twin("medium")}
    design = Design(budget=SMOKE, twins=tuple(twins))
    stages = [s for s in plan(design) if s.name == SCRATCH]
    write_twins(tmp_path, twins)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        summary, _ = run(
            tmp_path, stages, ["--cores", "1", "--config", f"control_port={port}"]
        )
    (reason,) = summary.failed.values()
    assert f"127.0.0.1:{port}" in reason
    assert not (stage_folder(tmp_path, stages[0].name) / "run").exists()


DRIVER = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
from pathlib import Path
sys.path.insert(0, {tests!r})
from rich.console import Console
from toy_workflow import toy
from dovetail.reproduce import workflow
workflow.SNAKEFILE = Path({snakefile!r})
workflow.run_stages(Path({root!r}), [toy("slow")], ["--cores", "2"], Console())
"""
SLOW = "echo x >> ran; echo $$ > pid; while [ ! -e ../../go ]; do sleep 0.05; done"


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


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_when_it_is_ended_no_stage_goes_on_alone_and_the_next_run_finishes(
    tmp_path, snakefile, how
):
    stages = write(tmp_path, [toy("slow", SLOW)])
    script = DRIVER.format(
        tests=str(HERE), root=str(tmp_path), snakefile=str(snakefile)
    )
    driver = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE)
    pid_file = stage_folder(tmp_path, "slow") / "pid"
    wait_for(lambda: pid_file.exists() and pid_file.read_text().strip())
    pid = int(pid_file.read_text())
    driver.send_signal(how)
    _, error = driver.communicate()
    assert (b"KeyboardInterrupt" in error) == (how == signal.SIGINT)
    wait_for(lambda: not is_alive(pid))
    assert not is_done(tmp_path, "slow")
    (tmp_path / "go").touch()
    assert run(tmp_path, stages)[0].done == {"slow"}
    assert times_run(tmp_path, "slow") == 2


def test_a_stage_that_said_nothing_has_failed_too(tmp_path):
    summary = summarise(tmp_path, [toy("a"), toy("b", needs=("a",))])
    assert summary.failed.keys() == {"a"}
    assert summary.left_out == {"b": "a"}
    assert last_lines(tmp_path / "log.txt") == []
