"""Faults of link and robot, on request, over real UDP."""

import pytest

from dovetail import _core
from dovetail.cabinet.faults import FaultConfig
from dovetail.cabinet.protocol import Quality, SessionState

from .client import wait_until

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState
UP = [WAIT, READY, C_WAIT, ACTIVE]


def test_a_safety_stop_is_shown_and_ends(make, client):
    client.start()
    with make(restart_delay=0.01) as cabinet:
        client.wait_for(ACTIVE)
        cabinet.request({"do": "fault", "text": "stop_at=50ms,stop=3,stop_time=100ms"})
        wait_until(lambda: client.states == [*UP, READY, C_WAIT, ACTIVE])
        assert cabinet.status()["counts"]["stops"] == 1
        stopped = [m for m in client.messages if int(m.safety)]
        assert len(stopped) > 10
        assert all(int(m.safety) == 3 for m in stopped)
        assert all([int(d) for d in m.drive_states] == [0] * 7 for m in stopped)


def test_a_frozen_cabinet_goes_on(make, client):
    client.start()
    with make() as cabinet:
        client.wait_for(ACTIVE)
        cabinet.request({"do": "fault", "text": "freeze=200ms"})
        seen = len(client.messages)
        wait_until(lambda: len(client.messages) > seen + 10)
        assert client.state is ACTIVE
        assert cabinet.status()["counts"].get("stops", 0) == 0


@pytest.mark.parametrize(
    "text",
    [
        "loss=0.03",
        "duplicate=0.1",
        "reorder=0.03",
        "corrupt=0.02",
        "truncate=0.02",
        "delay=1ms,jitter=1ms",
        "loss=0.01,duplicate=0.05,reorder=0.01",
    ],
)
def test_a_somewhat_faulty_link_is_survived(make, client, text):
    client.version = _core.fri_version("2.7")  # whose checksum finds what corrupt does
    client.start()
    with make(version="2.7") as cabinet:
        client.wait_for(ACTIVE)
        cabinet.request({"do": "fault", "text": text})
        seen = len(client.messages)
        wait_until(lambda: len(client.messages) > seen + 300)
        status = cabinet.status()
        assert status["state"] == "COMMANDING_ACTIVE"
        assert status["counts"].get("stops", 0) == 0
        if "delay" not in text and "duplicate=0.1" not in text:
            assert status["counts"]["missed"] > 0
        assert cabinet.status()["faults"] != "none"


def test_a_link_slower_than_the_period_never_gets_ready(make, client):
    client.start()
    with make(faults=FaultConfig(delay=0.003)) as cabinet:
        wait_until(lambda: cabinet.status()["sequence"] > 150)
        assert cabinet.status()["state"] == "MONITORING_WAIT"
        assert cabinet.status()["counts"]["late"] > 100
        cabinet.request({"do": "fault", "text": "none"})
        client.wait_for(ACTIVE)


def test_a_script_brings_faults_in_time(make, client):
    client.start()
    script = [(1.0, FaultConfig(quality=Quality.POOR)), (1.5, FaultConfig())]
    with make(script=script) as cabinet:
        wait_until(lambda: client.states == [*UP, *UP], describe=lambda: client.states)
        stopped = [m.sequence for m in client.messages if int(m.state) == WAIT][-1]
        assert 0.005 * stopped == pytest.approx(1.5, abs=0.02)
        assert cabinet.status()["faults"] == "none"
