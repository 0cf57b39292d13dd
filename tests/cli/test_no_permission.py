"""A port that is not permitted is one message, wherever it is asked for."""

import pytest

from dovetail.cli import run
from extras import need

CABINET = ("cabinet", "--plant", "mujoco")
EVALUATE = ("evaluate", "peg_square", "--fixture", "0.6", "0", "0.1", "0")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            (*CABINET, "--control", "none", "--port", "{port}"),
            "UDP address 127.0.0.1:{port} cannot be opened: no permission: give a port "
            "from 1024 up",
        ),
        (
            (*CABINET, "--port", "0", "--control", "127.0.0.1:{port}"),
            "control port 127.0.0.1:{port} cannot be opened: no permission: give a "
            "port from 1024 up",
        ),
        (
            ("serve", "--arm", "mujoco", "--listen", "127.0.0.1:{port}"),
            "cannot listen at 127.0.0.1:{port}: permission denied; ports below 1024 "
            "need privileges: choose a higher one",
        ),
        (
            (*EVALUATE, "--arm", "fri://127.0.0.1:{port}"),
            "no permission to listen on UDP port {port}: ports below 1024 are the "
            "system's; choose another",
        ),
        (
            ("doctor", "--yes", "--arm", "fri://127.0.0.1:{port}"),
            "no permission to listen on UDP port {port}",
        ),
        (
            ("gripper", "--simulate", "--at", "127.0.0.1:{port}"),
            "cannot listen at 127.0.0.1:{port}: Permission denied; choose another port",
        ),
    ],
    ids=["cabinet", "control port", "serve", "evaluate", "doctor", "gripper"],
)
def test_a_port_that_is_not_permitted_is_one_message(
    words, message, forbidden_port, capsys
):
    if words[0] == "serve":
        need("grpc")
    code = run([word.format(port=forbidden_port) for word in words])
    error = " ".join(capsys.readouterr().err.split())
    assert code == 2, error
    assert error.startswith("dovetail: ")
    assert message.format(port=forbidden_port) in error
    assert "Traceback" not in error
