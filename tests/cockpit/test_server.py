"""Where the page listens, and who of its viewers drives."""

import socket
import time

import numpy as np
import pytest

from dovetail.cockpit.page import PATIENCE, DriverLock
from dovetail.cockpit.server import HOST, open_server
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.view.cell_model import cell_spec
from extras import need

from .conftest import wait_until


@pytest.mark.parametrize("port", [-1, 65536])
def test_a_port_that_is_none_is_refused(port):
    need("viser")
    with pytest.raises(ConfigError, match="allowed: 0 to 65535"):
        open_server(port)


def test_a_port_in_use_is_told(port_in_use):
    need("viser")
    with pytest.raises(ConfigError, match=f"port {port_in_use} is in use"):
        open_server(port_in_use)


@pytest.fixture
def port_in_use():
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        yield taken.getsockname()[1]


def test_the_page_listens_on_this_machine_alone():
    need("viser")
    server = open_server(0)
    try:
        assert server.viser.get_host() == "127.0.0.1"
        assert server.port > 0
    finally:
        server.stop()


def test_one_drives_and_the_lock_is_free_when_that_one_leaves():
    lock = DriverLock()
    assert lock.acquire(3)
    assert lock.acquire(3)
    assert not lock.acquire(4)
    assert not lock.release(4)
    assert lock.driver == 3
    assert lock.release(3)
    assert lock.driver is None
    assert lock.acquire(4)


def test_who_has_done_nothing_for_a_minute_while_the_arm_stands_has_left():
    now = 100.0
    lock = DriverLock(lambda: now)
    assert lock.acquire(3)
    now += PATIENCE - 1.0
    assert not lock.acquire(4, is_standing=True)
    assert lock.acquire(3)  # does something again
    now += PATIENCE - 1.0
    assert not lock.acquire(4, is_standing=True)
    now += 2.0
    assert not lock.acquire(4)  # it moves: the driver may be watching
    assert lock.acquire(4, is_standing=True)
    assert not lock.release(3)
    assert not lock.acquire(3, is_standing=True)


@pytest.mark.parametrize("env", ["dovetail/PegInHole-v0", "dovetail/RailClip-v0"])
def test_what_the_browser_draws_is_as_large_as_what_the_plant_has(env):
    """Each geom's triangles against MuJoCo's own box around it."""
    need("viser")
    import mujoco

    from dovetail.cockpit.scene import triangles

    model = cell_spec(find_cell(env)).compile()
    assert model.ngeom > 10
    for geom in range(model.ngeom):
        vertices, faces, _ = triangles(mujoco, model, geom)
        assert faces.max() < len(vertices)
        middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        slack = 0.03 * half.max()  # round bodies are cut into flat ones
        np.testing.assert_allclose(vertices.max(axis=0), middle + half, atol=slack)
        np.testing.assert_allclose(vertices.min(axis=0), middle - half, atol=slack)


def test_what_no_browser_sends_is_a_line_and_no_traceback(caplog):
    need("viser")
    server = open_server(0)
    try:

        def is_said():  # at most once a second
            with socket.create_connection((HOST, server.port)) as scan:
                scan.sendall(b"GET / HT")
            time.sleep(0.1)
            return caplog.records

        wait_until(is_said)
    finally:
        server.stop()
    record = caplog.records[0]
    assert record.getMessage().startswith("page: opening handshake failed (")
    assert "Traceback" not in caplog.text
