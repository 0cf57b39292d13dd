"""`dovetail gripper` from the command line."""

import os
import re
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
    # The program takes a port itself: one found free before may be taken by then.
    words = ["-m", "dovetail.cli", "gripper", "--simulate", "--at", "127.0.0.1:0"]
    # By a shell, which has SIGINT ignored as for a job in the background: code between
    # fork and exec is not safe where other tests left threads.
    ignoring = ["/bin/sh", "-c", 'trap "" INT; exec "$0" "$@"']
    process = subprocess.Popen(
        [*ignoring, sys.executable, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
    )
    told = process.stdout.readline()
    place = re.search(r" at (127\.0\.0\.1:[1-9]\d*);", told)
    assert place is not None, told or process.communicate(timeout=20)[1]
    host, port = place[1].split(":")
    socket.create_connection((host, int(port)), timeout=5.0).close()
    process.send_signal(number)
    out, error = process.communicate(timeout=20)
    assert "ends" in out, error
    assert process.returncode == 0
