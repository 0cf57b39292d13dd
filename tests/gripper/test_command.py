"""`dovetail gripper` from the command line."""

import os
import signal
import socket
import subprocess
import sys

import pytest

from dovetail.cli import run


@pytest.fixture
def do(server, capsys):
    """Runs one command and returns exit code and output."""

    def do(*words):
        code = run(["gripper", "--at", f"{server.host}:{server.port}", "--do", *words])
        out, err = capsys.readouterr()
        return code, out + err

    return do


def test_a_peg_is_gripped_and_released_by_commands(do):
    assert "width 110.00 mm" in do("home")[1]
    assert "holding" in do("grip", "--width", "0.03", "--force", "40")[1]
    assert "force 40.0 N" in do("state")[1]
    assert "width 50.00 mm" in do("release", "--width", "0.02")[1]
    assert "width 80.00 mm" in do("move", "--width", "0.08")[1]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["move"], "needs --width"),
        (["move", "--width", "0.2"], "allowed: 0 to 0.11 m"),
        (["move", "--width", "0.05"], "home it first"),
        (["grip", "--force", "100"], "allowed: 5 to 80 N"),
    ],
)
def test_an_error_is_one_message(do, words, message):
    code, text = do(*words)
    assert code == 2
    assert message in text
    assert "Traceback" not in text


def test_a_wrong_address_is_said(capsys):
    assert run(["gripper", "--at", "nowhere"]) == 2
    assert "HOST:PORT" in capsys.readouterr().err


def test_a_port_in_use_is_said(server, capsys):
    words = ["gripper", "--simulate", "--at", f"{server.host}:{server.port}"]
    assert run(words) == 2
    assert "choose another port" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_simulated_gripper_runs_as_a_program_until_interrupted(number):
    with socket.create_server(("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    words = ["-m", "dovetail.cli", "gripper", "--simulate", "--at", place]
    process = subprocess.Popen(
        [sys.executable, *words],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )
    assert place in process.stdout.readline()
    process.send_signal(number)
    assert "ends" in process.communicate(timeout=20)[0]
    assert process.returncode == 0
