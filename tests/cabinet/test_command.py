"""`dovetail cabinet`: its errors, its status line, and how it ends."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dovetail.cabinet.protocol import SessionState
from dovetail.cli import run
from dovetail.commands.cabinet import Cabinet, describe_status

from .client import wait_until
from .conftest import LightPlant
from .test_control_port import Line

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState
FREE = ["--port", "0", "--control", "127.0.0.1:0", "--plant", "mujoco"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--period", "0ms"], "send period is 0 ms; allowed are whole ms, 1 to 100"),
        (["--period", "5"], "--period is '5'; give a number and its unit"),
        (["--version", "3.0"], "known versions: 1.15, 2.5, 2.7"),
        (["--twin", "unreal"], "shipped twins: easy, hard, medium"),
        (["--plant", "gazebo"], "known plants: mujoco, bullet"),
        (["--plant", "mujoco", "--twin", "easy"], "exclude each other"),
        (["--client", "somewhere"], "--client is 'somewhere'; give HOST:PORT"),
        (["--client", "no.such.host.invalid:30200"], "has no IPv4 address"),
        (["--control", "30301"], "--control is '30301'; give HOST:PORT"),
        (["--port", "70000"], "port 70000; allowed is 0 to 65535"),
        (["--bind", "192.0.2.1"], "this machine has no such address"),
        (["--stiffness", "1,2"], "give one number for all joints, or seven"),
        (["--damping", "2"], "damping[A1] is 2"),
        (["--fault", "los=1"], "known faults: loss, duplicate"),
        (["--script", "nowhere.txt"], "fault script nowhere.txt cannot be read"),
        (["--log", "/nowhere/at/all.jsonl"], "cannot be written"),
        (["--io", "FRI.Out"], "give NAME:TYPE:DIRECTION"),
        (["--receive-multiplier", "0"], "receive_multiplier is 0"),
        (["--hold-slots", "9", "--stop-slots", "3"], "stop_slots is 3, less than hold"),
        (["--restart-delay", "soon"], "--restart-delay is 'soon'"),
        (["--good-from", "1.1"], "must rise within 0 to 1"),
        (["--peg", "square", "--clearance", "-1"], "clearance"),
    ],
)
def test_wrong_settings_are_one_message(words, message, capsys):
    given = {"--plant", "--twin"} & set(words)
    plant = [] if given else ["--plant", "mujoco"]
    ports = [] if "--port" in words else ["--port", "0"]
    control = [] if "--control" in words else ["--control", "none"]
    assert run(["cabinet", *plant, *ports, *control, *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith("dovetail: ")
    assert message in error
    assert "Traceback" not in error


def test_a_port_in_use_is_said(capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
        words = ["cabinet", "--plant", "mujoco", "--control", "none", "--port", port]
        assert run(words) == 2
    error = capsys.readouterr().err
    assert f"UDP address 127.0.0.1:{port} cannot be opened" in error
    assert "give another port" in error


def test_settings_reach_the_cabinet():
    command = Cabinet(
        version="2.7",
        period=0.002,
        stiffness="200",
        damping="0,0,0,0,0,0,0.7",
        restart_delay="never",
        good_from=0.2,
        hold_slots=4,
        stop_slots=20,
        control="none",
        io=("FRI.Out:digital:output",),
    )
    config = command.settings()
    assert (config.version, config.period_ms) == ("2.7", 2)
    assert config.stiffness == (200.0,) * 7
    assert config.damping[6] == 0.7
    assert (config.held_misses, config.stop_misses) == (4, 20)
    assert config.restart_delay is None
    assert config.good_from == config.fair_from == 0.2
    assert config.control is None
    assert config.io[0].name == "FRI.Out"


def test_the_status_line_tells_state_quality_rate_and_misses():
    status = {
        "state": "COMMANDING_WAIT",
        "quality": "GOOD",
        "rate": 199.9,
        "time": 1.25,
        "counts": {"active_missed": 3, "active_due": 300, "foreign": 7},
        "stop_reason": "",
        "waits_for": "4 more mirrored commands",
        "last_error": "",
    }
    line = describe_status(status)
    for part in (
        "COMMANDING_WAIT",
        "GOOD",
        "199.9/s",
        "3 of 300",
        "foreign 7",
        "4 more",
    ):
        assert part in line


def test_periods_that_begin_too_late_are_counted_and_shown(make, client):
    class SlowPlant(LightPlant):
        duration = 0.0

        def read(self):
            time.sleep(self.duration)
            return super().read()

    plant = SlowPlant()
    cabinet = make(plant, clock="wall")
    cabinet.start()
    client.start()
    client.wait_for(ACTIVE, timeout=90.0)  # an arm behind its brakes is not simulated
    plant.duration = 0.05  # ten periods
    deadline = time.monotonic() + 20.0
    while (status := cabinet.status())["counts"]["overruns"] < 2:
        assert time.monotonic() < deadline, status
        time.sleep(0.05)
    assert f"overruns {status['counts']['overruns']}" in describe_status(status)


def test_the_status_line_says_when_no_client_has_answered():
    status = {
        "state": "MONITORING_WAIT",
        "quality": "POOR",
        "rate": 200.0,
        "time": 0.0,
        "counts": {"sent": 100},
    }
    assert "nothing heard from the client yet" in describe_status(status)


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_says_idle_to_the_client(client, tmp_path, ending):
    client.start()
    log = tmp_path / "events.jsonl"
    command = [sys.executable, "-m", "dovetail.cli", "cabinet", *FREE]
    command += ["--client", f"127.0.0.1:{client.address[1]}", "--log", str(log)]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    try:
        client.wait_for(ACTIVE, timeout=90.0)
        time.sleep(0.5)
        process.send_signal(ending)
        output, _ = process.communicate(timeout=30.0)
    finally:
        process.kill()
    assert process.returncode == 0, output
    assert "Traceback" not in output
    assert "leaked" not in output
    assert "FRI 1.15, 5 ms, clock wall" in output
    assert "COMMANDING_ACTIVE" in output
    wait_until(lambda: sum(int(m.state) == IDLE for m in client.messages) == 5)
    events = [json.loads(line) for line in log.read_text().splitlines()]
    assert [e["event"] for e in events][:2] == ["faults", "start"]
    assert events[-1]["event"] == "end"
    states = [e["state"] for e in events if e["event"] == "state"]
    assert states[:2] == ["MONITORING_WAIT", "MONITORING_READY"]
    assert states[-1] == "IDLE"


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("times", [1, 2])
def test_its_end_leaves_nothing_of_nanobind(ending, times):
    """`timeout` sends two: the second one cut the end short, "leaked 5 instances!"."""
    words = ["--clock", "lockstep", "--twin", "medium", "--port", "0"]
    process = subprocess.Popen(
        [sys.executable, "-m", "dovetail", "cabinet", *words, "--control", "none"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        process.stdout.readline()
        assert "MONITORING_WAIT" in process.stdout.readline()
        for _ in range(times):
            process.send_signal(ending)
        output, error = process.communicate(timeout=60.0)
    finally:
        process.kill()
    assert "nanobind" not in error
    assert "interrupted" not in error
    assert output.endswith("cabinet: ends, says IDLE to the client\n")
    if times == 1:  # another one may come when Python has taken the handlers away
        assert process.returncode == 0
        assert not error


def test_the_log_tells_requests_stops_and_faults(make, client, tmp_path):
    client.start()
    log = tmp_path / "events.jsonl"
    with make(log=log) as cabinet:
        client.wait_for(ACTIVE)
        line = Line(cabinet.control_address)
        line.ask(do="fault", text="loss=1,direction=from_client")
        client.wait_for(WAIT)
        line.close()
    events = [json.loads(line) for line in log.read_text().splitlines()]
    kinds = [e["event"] for e in events]
    assert "request" in kinds
    faults = [e["faults"] for e in events if e["event"] == "faults"]
    assert faults == ["none", "loss=1.0,direction=from_client"]
    stop = events[kinds.index("stop")]
    assert stop["reason"] == "10 commands missed in a row"
    assert all(e["since_start"] >= 0.0 for e in events)


def test_a_full_disk_ends_the_log_and_not_the_cabinet(make, client):
    client.start()
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("needs /dev/full, a disk that is always full: run on Linux")
    with make(log=full) as cabinet:
        client.wait_for(ACTIVE)
        assert "No space left" in cabinet.log.failure
        assert "No space left" in cabinet.status()["log_failure"]
