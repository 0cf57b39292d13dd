"""Random datagrams and mutated commands at the cabinet's port: nothing changes."""

import random
import socket

import pytest

from dovetail import _core
from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.protocol import SessionState
from dovetail.cabinet.robot_controller import RobotController
from dovetail.cabinet.wire import Wire

from .client import ZERO, wait_until
from .conftest import LightPlant

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState


def mutated(rng, seeds):
    """Return a datagram: random, or a good one with bytes changed, cut or added."""
    if rng.random() < 0.2:
        return rng.randbytes(rng.randrange(200))
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.randint(1, 4)):
        what = rng.randrange(3)
        at = rng.randrange(len(data) + 1)
        if what == 0 and at < len(data):
            data[at] = rng.randrange(256)
        elif what == 1:
            del data[at : at + rng.randint(1, 20)]
        else:
            data[at:at] = rng.randbytes(rng.randint(1, 10))
    return bytes(data)


def commands(version):
    bare, full = _core.FriCommand(), _core.FriCommand()
    full.q = full.tau = ZERO
    full.wrench = [0.0] * 6
    full.io = [_core.FriIo("FRI.Out", 1, 1, digital=5)]
    full.transformations = [_core.FriTransformation("tool", [0.0] * 7, (1, 2))]
    return [command.encode(_core.fri_version(version)) for command in (bare, full)]


@pytest.mark.parametrize("version", ["1.15", "2.5", "2.7"])
def test_mutated_commands_never_crash_the_controller(version):
    rng = random.Random(5)
    controller = RobotController(LightPlant(), CabinetConfig(version=version))
    wire = Wire(controller)
    seeds = commands(version)
    undecodable = 0
    for _ in range(5000):
        controller.begin()
        try:
            controller.receive(wire.decode(mutated(rng, seeds)))
        except ValueError:
            undecodable += 1
        controller.finish()
        wire.encode((1, 2))
    assert undecodable > 1000
    assert controller.body.is_braked


def test_a_flood_of_foreign_datagrams_leaves_the_motion_running(make, client):
    rng = random.Random(6)
    seeds = commands("1.15")
    client.start()
    with (
        make() as cabinet,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        client.wait_for(ACTIVE)
        before = cabinet.status()["counts"]
        for _ in range(20000):
            stranger.sendto(mutated(rng, seeds), tuple(cabinet.address))
        wait_until(lambda: cabinet.status()["counts"].get("foreign", 0) > 100)
        status = cabinet.status()
        assert client.states[-1] is ACTIVE
        for name in ("undecodable", "late", "ahead", "stops", "duplicates"):
            assert status["counts"].get(name, 0) == before.get(name, 0)


def test_a_flood_from_the_clients_own_address_is_survived(make, client):
    rng = random.Random(7)
    seeds = commands("1.15")
    client.start()
    with make(restart_delay=0.01) as cabinet:
        client.wait_for(ACTIVE)
        for _ in range(5000):
            client.socket.sendto(mutated(rng, seeds), tuple(cabinet.address))
        client.wait_for(ACTIVE)
        assert cabinet.is_running
        assert cabinet.status()["counts"]["undecodable"] > 100
