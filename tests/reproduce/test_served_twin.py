"""The twin behind a cabinet: at the same address in every sitting of a training."""

import json
import socket

import pytest

from dovetail.errors import ConfigError
from dovetail.plants.twin import TWIN_FOLDER
from dovetail.reproduce.served_twin import serve_twin


def serve(folder):
    return serve_twin(
        TWIN_FOLDER / "easy.toml",
        folder,
        hole=(0.6, 0.0, 0.1, 0.0),
        period=0.005,
        peg="square",
        clearance=0.0005,
    )


def test_a_resumed_training_finds_the_twin_where_it_was(tmp_path):
    with serve(tmp_path) as first:
        ports = json.loads((tmp_path / "cabinet.json").read_text())
    with serve(tmp_path) as second:
        assert second == first
    assert first == (
        f"fri://127.0.0.1:{ports['client']}?period=5ms&clock=lockstep"
        f"&control=127.0.0.1:{ports['control']}&timeout=120s"
    )


def test_a_port_that_somebody_took_is_named(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        ports = {"client": 9, "control": taken.getsockname()[1]}
        (tmp_path / "cabinet.json").write_text(json.dumps(ports))
        with pytest.raises(ConfigError) as error, serve(tmp_path):
            pass
    assert f"at the ports 9 and {ports['control']}" in str(error.value)
    assert "end the program that has them, and resume" in str(error.value)
