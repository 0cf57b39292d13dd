"""Datagrams that must change nothing: foreign, garbage, late, doubled."""

import pytest

from dovetail import _core
from dovetail.cabinet.protocol import SessionState

from .client import ZERO, Client, mirror, wait_until
from .conftest import LightPlant

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState
UP = [WAIT, READY, C_WAIT, ACTIVE]


@pytest.mark.parametrize(("ours", "theirs"), [("1.15", "2.7"), ("2.7", "1.15")])
def test_another_version_is_named(make, client, ours, theirs):
    client.version = _core.fri_version(theirs)

    def blind():  # a client that answers what it cannot read
        _data, client.cabinet = client.socket.recvfrom(2000)
        client.send(_core.FriCommand(), 0)

    client.step = blind
    client.start()
    with make(version=ours) as cabinet:
        wait_until(lambda: cabinet.status()["counts"].get("undecodable", 0) > 20)
        assert cabinet.status()["state"] == "MONITORING_WAIT"
        error = cabinet.status()["last_error"]
        assert theirs.removesuffix("5") in error or theirs in error


def test_foreign_datagrams_change_nothing(make, client):
    stranger = Client()
    client.start()
    with make() as cabinet:
        stranger.cabinet = tuple(cabinet.address)
        for i in range(50):
            command = _core.FriCommand()
            command.q = command.tau = ZERO
            stranger.send(command, i)
        wait_until(lambda: cabinet.status()["counts"].get("foreign", 0) == 50)
        client.wait_for(ACTIVE)
        for i in range(50):
            command.tau = [300.0] * 7
            stranger.send(command, client.messages[-1].sequence + i)
        wait_until(lambda: cabinet.status()["counts"]["foreign"] == 100)
        counts = cabinet.status()["counts"]
        assert client.states == UP
        assert (
            counts.get("late", 0) + counts.get("ahead", 0) + counts.get("stops", 0) == 0
        )
    stranger.close()


def test_garbage_from_the_clients_own_address_changes_nothing(make, client, rng):
    client.start()
    with make() as cabinet:
        client.wait_for(ACTIVE)
        for size in (0, 1, 10, 100, 1400, 1501, 3000):
            client.socket.sendto(rng.bytes(size), client.cabinet)
        wait_until(lambda: cabinet.status()["counts"].get("undecodable", 0) >= 7)
        assert client.states == UP


def test_commands_for_other_messages_do_not_count(make, client):
    def confused(message):
        command = mirror(message)
        if int(message.state) == ACTIVE:
            for reflected in (message.sequence - 3, message.sequence + 3):
                wrong = _core.FriCommand()
                wrong.q, wrong.tau = message.q_measured, [300.0] * 7
                client.send(wrong, max(reflected, 0))
        return command

    client.answer = confused
    client.start()
    with make() as cabinet:
        client.wait_for(ACTIVE)
        wait_until(lambda: cabinet.status()["counts"].get("ahead", 0) > 10)
        counts = cabinet.status()["counts"]
        assert counts["late"] > 10
        assert client.state is ACTIVE
        assert counts.get("stops", 0) == 0


def test_a_second_command_in_the_slot_does_not_count(make, client):
    plant = LightPlant()

    def twice(message):
        command = mirror(message)
        if int(message.state) == ACTIVE:
            client.send(command, message.sequence)
            second = _core.FriCommand()
            second.q, second.tau = message.q_measured, [50.0] * 7
            return second
        return command

    client.answer = twice
    client.start()
    with make(plant) as cabinet:
        client.wait_for(ACTIVE)
        wait_until(lambda: len(plant.applied) > 20)
        assert all(not tau.any() for tau, _ in plant.applied)
        counts = cabinet.status()["counts"]
        assert counts.get("duplicates", 0) + counts.get("late", 0) > 5
