"""`dovetail serve` as a user starts it."""

import io
import re
import resource
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from rich.console import Console

from arms.loopback import free_port
from dovetail.cli import run
from dovetail.commands.serve import _show_status
from dovetail.errors import ArmError, ConfigError
from dovetail.rpc.token import make_token

from .conftest import HOLE, push


@pytest.fixture
def serve():
    """Start the command; returns the process and the address it printed."""
    processes = []

    def start_one(*words, files=None):
        command = [sys.executable, "-m", "dovetail.cli", "serve", *words]
        if files is not None:  # it inherits this limit, and may raise it
            command = ["sh", "-c", f'ulimit -Sn {files} && exec "$@"', "sh", *command]
        process = subprocess.Popen(
            [*command, "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE, text=True
        )
        processes.append(process)
        process.before, line = "", process.stdout.readline()
        while line.startswith("warning: "):
            process.before, line = process.before + line, process.stdout.readline()
        process.address = re.search(r"grpc://\S+", line)[0]  # as told to learners
        return process, re.search(r"grpc://127\.0\.0\.1:\d+(\?token=[\w-]+)?", line)[0]

    yield start_one
    for process in processes:
        process.kill()
        process.communicate(timeout=20)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_told_to_end(serve, connect, start, cell, number):
    process, address = serve("--arm", "mujoco")
    arm = connect(address, robot=cell.loaded_robot(), cell=cell)
    arm.reset(start, HOLE)
    for _ in range(3):
        arm.step(push(1.0))
    process.send_signal(number)
    text, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    for words in ("holds the arm", "configured: XYZ", "closing", "after 3 steps"):
        assert words in text


def test_a_twin_with_another_peg(serve, connect):
    _, address = serve("--twin", "medium", "--peg", "round")
    arm = connect(address)
    assert arm.info.arm == "twin:medium"
    assert arm.info.cell.name.startswith("round peg")


def test_a_cabinets_period_is_told_to_the_learner(serve, connect):
    process, address = serve("--arm", f"fri://127.0.0.1:{free_port()}?period=1ms")
    assert process.address == f"{address}&period=1ms"
    with pytest.raises(ConfigError) as error:
        connect(address)  # with 5 ms
    for words in ("commanded every 1 ms", "asks for 5 ms", "grpc://HOST:PORT?period="):
        assert words in str(error.value)


def test_a_learner_has_to_declare_what_is_known_of_the_arm(serve, connect):
    process, address = serve("--arm", "mujoco", "--delay", "12ms")
    assert "the loop's delay is 12 ms, for which the limits are" in process.before
    with pytest.raises(ConfigError, match="declare 10 ms: give the learner --delay 12"):
        connect(address)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--listen", "0.0.0.0:50051"], "would let anyone on the network move the arm"),
        (["--cert", "c.pem"], "--key, --client-ca are missing"),
        (["--arm", "grpc://127.0.0.1:50051"], "is served already"),
        (["--arm", "gazebo"], "known addresses: mujoco, bullet"),
        (["--arm", "bullet", "--twin", "medium"], "exclude each other"),
        (["--realtime"], "--realtime is for fri:// arms"),
    ],
)
def test_wrong_settings(words, message, capsys):
    assert run(["serve", *words]) == 2
    assert message in capsys.readouterr().err


def test_the_token_comes_from_the_environment(serve, connect, monkeypatch):
    monkeypatch.setenv("DOVETAIL_TOKEN", "a-token-of-both-ends")
    _, address = serve("--arm", "mujoco")
    assert "token" not in address
    connect(address).close()  # as a learner with that environment
    monkeypatch.delenv("DOVETAIL_TOKEN")
    for wrong in ("", "?token=another-token-than-the-one"):
        with pytest.raises(ArmError, match="wants its token"):
            connect(address + wrong)


def test_a_token_that_can_be_guessed_is_refused(monkeypatch):
    for token in ("short", "with spaces and so on", "ünïcode-ünïcode-ünïcode"):
        monkeypatch.setenv("DOVETAIL_TOKEN", token)
        with pytest.raises(ConfigError, match="DOVETAIL_TOKEN"):
            make_token()


def test_a_new_learner_is_not_kept_waiting_by_silent_connections(serve):
    """Each is an open file, and the service opens as many as it may."""
    process, _ = serve("--arm", "mujoco", files=200)
    soft, most = resource.prlimit(process.pid, resource.RLIMIT_NOFILE)
    assert soft == most > 200


@pytest.mark.parametrize("reason", ["[/x]", "[bold]", "\x1b]0;other title\x07"])
def test_a_stranger_writes_no_markup_into_the_status_line(reason):
    class Once:
        """Ends at the second look."""

        looks = 0

        def wait(self, seconds=None):
            self.looks += 1
            return self.looks > 1

    server = SimpleNamespace(service=SimpleNamespace(status=f"stopped: {reason}"))
    shown = io.StringIO()
    console = Console(file=shown, force_terminal=True, width=80)
    _show_status(console, server, Once())
    assert "stopped: " in shown.getvalue()
    assert "\x1b]0" not in shown.getvalue()
