"""The words of messages, kept in one file: what a person reads after a wrong command.

After a change that is meant, write them anew: `python tests/test_messages.py`.
"""

import contextlib
import io
import os
import shlex
import tempfile
from pathlib import Path

import pytest

from dovetail.cli import run

FILE = Path(__file__).with_name("messages.txt")
COMMANDS = """
evalute peg_square
evaluate peg_square
evaluate peg_squar --twin medium
evaluate peg_square --twin medum
evaluate peg_square --twin medium --plant mujoco
evaluate peg_square --twin medium --tries 0
evaluate peg_square --twin medium --push 200
evaluate peg_square --twin medium --period 3ms
evaluate peg_square --arm fri://127.0.0.1:30200
evaluate nowhere.safetensors --twin medium
compare peg_square --twin medium
compare peg_square peg_square --twin medium
compare peg_square peg_triangle --twin medium
train --config nowhere.toml
train --recipe pegnear
train --config own.toml
train --steps 0
train --part nowhere.toml
train --clearance -1
twin show medum
cabinet --plant gazebo --port 0 --control none
cabinet --plant mujoco --damping 2 --port 0 --control none
identify fit nowhere
replay nowhere.npz
part check nowhere.stl nowhere.stl
part check nowhere.step nowhere.stl
part show nowhere.toml
"""
OWN = """env = "dovetail/PegInHole-v0"\nstep = 1000\nnear_speed = "fast"\n"""


def said(command):
    """Run a command in a folder of its own; return the error that it prints."""
    error = io.StringIO()
    with contextlib.redirect_stderr(error):
        assert run(shlex.split(command)) == 2
    return error.getvalue()


def all_said():
    """Return every command with what it says, as the file has it."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        Path("own.toml").write_text(OWN)
        commands = COMMANDS.strip().splitlines()
        return {command: said(command) for command in commands}


def written(messages):
    parts = (f"$ dovetail {command}\n{text}\n" for command, text in messages.items())
    return "".join(parts)


@pytest.fixture
def plain(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")


def test_messages_are_those_of_the_file(plain):
    assert written(all_said()) == FILE.read_text()


if __name__ == "__main__":
    os.environ["COLUMNS"] = "80"
    FILE.write_text(written(all_said()))
