"""The session's states and transitions over real UDP on 127.0.0.1."""

import time

import pytest

from dovetail import _core
from dovetail.cabinet.protocol import Quality, SessionState

from .client import Client, mirror, wait_until

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState
UP = [WAIT, READY, C_WAIT, ACTIVE]


@pytest.mark.parametrize("version", ["1.15", "2.5", "2.7"])
def test_a_client_that_mirrors_gets_to_commanding_active(make, client, version):
    client.version = _core.fri_version(version)
    client.start()
    with make(version=version):
        client.wait_for(ACTIVE)
    client.wait_for(IDLE)
    assert client.states == [*UP, IDLE]
    assert client.undecodable == 0
    counters = [message.sequence for message in client.messages]
    assert counters == list(range(len(counters)))


def test_messages_say_what_a_real_cabinet_says(make, client):
    client.start()
    with make(receive_multiplier=1, period=0.002):
        client.wait_for(ACTIVE)
    client.wait_for(IDLE)
    by_state = {int(message.state): message for message in client.messages}
    first, active = client.messages[0], by_state[ACTIVE]
    assert first.num_joints == active.num_joints == 7
    assert (first.send_period_ms, first.receive_multiplier) == (2, 1)
    assert int(first.quality) == Quality.POOR
    assert [int(d) for d in first.drive_states] == [0] * 7
    assert int(first.control_mode) == 3
    assert first.ipo_q is None
    assert int(first.command_mode) == int(first.overlay) == 0
    assert first.tracking == 0.0
    assert abs(first.stamp[0] - time.time()) < 60.0
    assert [int(d) for d in active.drive_states] == [2] * 7
    assert int(active.control_mode) == 2
    assert int(active.command_mode) == 3
    assert int(active.overlay) == 1
    assert active.ipo_q is not None
    assert by_state[C_WAIT].ipo_q is not None
    assert int(by_state[C_WAIT].command_mode) == 3
    for message in client.messages:
        for name in ("q_measured", "tau_measured", "q_commanded", "tau_external"):
            assert getattr(message, name).shape == (7,)


def test_reflected_counters_are_those_of_the_commands(make, client):
    client.start()
    with make():
        client.wait_for(ACTIVE)
    reflected = [message.reflected for message in client.messages]
    assert reflected[:5] == [0, 0, 1, 2, 3]


def test_the_client_may_start_late(make, client):
    with make() as cabinet:
        wait_until(lambda: cabinet.status()["sequence"] > 5)
        assert cabinet.status()["state"] == "MONITORING_WAIT"
        assert cabinet.status()["quality"] == "POOR"
        client.start()
        client.wait_for(ACTIVE)


def test_nobody_at_the_clients_address_is_no_error(make):
    absent = Client()
    absent.close()
    with make(to=absent.address, clock="wall") as cabinet:
        wait_until(lambda: cabinet.status()["counts"]["sent"] > 20)
        wait_until(lambda: cabinet.status()["counts"].get("refused", 0) > 5)
        assert cabinet.status()["state"] == "MONITORING_WAIT"


def test_wall_clock_paces_the_messages(make, client):
    client.start()
    with make(clock="wall", period=0.010) as cabinet:
        client.wait_for(ACTIVE)
        first, start = client.messages[-1].sequence, time.monotonic()
        wait_until(lambda: client.messages[-1].sequence >= first + 30)
        elapsed = time.monotonic() - start
    # Never faster than the clock; slower where the machine is busy.
    assert elapsed > 0.95 * 0.3
    assert cabinet.controller.counts["sent"] >= 130


def test_quality_lost_in_commanding_active_leads_back_and_up_again(make, client):
    client.start()
    with make() as cabinet:
        client.wait_for(ACTIVE)
        client.states.clear()
        cabinet.request({"do": "fault", "text": "quality=fair"})
        client.wait_for(WAIT)
        assert cabinet.status()["stop_reason"] == "connection quality lost"
        cabinet.request({"do": "fault", "text": "none"})
        client.wait_for(ACTIVE)
        assert client.states[-4:] == UP
        assert cabinet.status()["motion"] == 2


def test_a_client_that_falls_silent_loses_the_motion_then_the_quality(make, client):
    client.start()
    with make(patience=0.02, restart_delay=None) as cabinet:
        client.wait_for(ACTIVE)
        wait_until(lambda: cabinet.status()["quality"] == "EXCELLENT")
        client.answer = lambda message: None
        client.wait_for(WAIT)
        assert client.states == [*UP, READY, WAIT]
        assert cabinet.status()["stop_reason"] == "10 commands missed in a row"
        assert cabinet.status()["quality"] == "POOR"


def test_a_paused_motion_resumes(make, client):
    client.start()
    with make() as cabinet:
        client.wait_for(ACTIVE)
        answer = cabinet.request({"do": "pause"})
        assert answer["ok"]
        client.wait_for(READY)
        seen = len(client.messages)
        wait_until(lambda: len(client.messages) > seen + 50)
        assert client.state is READY
        assert cabinet.request({"do": "resume"})["ok"]
        client.wait_for(ACTIVE)
        assert client.states == [*UP, READY, C_WAIT, ACTIVE]


def test_a_new_session_needs_no_new_client(make, client):
    client.start()
    with make() as cabinet:
        client.wait_for(ACTIVE)
        assert cabinet.request({"do": "stop"})["ok"]
        client.wait_for(IDLE)
        wait_until(lambda: sum(int(m.state) == IDLE for m in client.messages) == 5)
        silent = len(client.messages)
        time.sleep(0.1)
        assert len(client.messages) == silent
        assert cabinet.request({"do": "resume"})["ok"]
        client.wait_for(ACTIVE)
        assert client.states == [*UP, IDLE, *UP]
        assert cabinet.status()["session"] == 2


def test_closing_sends_a_handful_of_idle_messages(make, client):
    client.start()
    with make():
        client.wait_for(ACTIVE)
    client.wait_for(IDLE)
    wait_until(lambda: sum(int(m.state) == IDLE for m in client.messages) == 5)


def test_a_client_that_does_not_mirror_stays_in_commanding_wait(make, client):
    def far(message):
        command = mirror(message)
        if int(message.state) == C_WAIT:
            command.q = message.ipo_q + 0.2
        return command

    client.answer = far
    client.start()
    with make() as cabinet:
        client.wait_for(C_WAIT)
        seen = len(client.messages)
        wait_until(lambda: len(client.messages) > seen + 50)
        assert client.state is C_WAIT
        assert "A1 commanded +0.2" in cabinet.status()["waits_for"]
        client.answer = mirror
        client.wait_for(ACTIVE)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        ({"q": None}, "without joint position"),
        ({"tau": None}, "without joint torque"),
        ({"tau": [400.0] + [0.0] * 6}, "torque limit: A1"),
        ({"q": [2.0] + [0.0] * 6}, "illegal axis delta: A1"),
    ],
)
def test_an_illegal_command_stops_the_motion(make, client, spoil, reason):
    def spoiled(message):
        command = mirror(message)
        if int(message.state) == ACTIVE:
            for name, value in spoil.items():
                setattr(command, name, value)
        return command

    client.answer = spoiled
    client.start()
    with make(restart_delay=None) as cabinet:
        wait_until(lambda: cabinet.status()["counts"].get("stops"))
        client.wait_for(READY)
        assert reason in cabinet.status()["stop_reason"]
        assert client.states == [*UP, READY]
        client.answer = mirror
        cabinet.request({"do": "resume"})
        client.wait_for(ACTIVE)


def test_a_stopped_motion_starts_again_after_the_delay(make, client):
    client.start()
    with make(restart_delay=0.05) as cabinet:
        client.wait_for(ACTIVE)
        client.answer = lambda message: _core.FriCommand()
        wait_until(lambda: cabinet.status()["counts"].get("stops"))
        client.answer = mirror
        client.wait_for(ACTIVE)
        assert cabinet.status()["motion"] == 2


@pytest.mark.parametrize(
    ("multiplier", "clock"), [*((m, "lockstep") for m in range(1, 6)), (3, "wall")]
)
def test_receive_multipliers(make, client, multiplier, clock):
    client.start()
    with make(receive_multiplier=multiplier, clock=clock) as cabinet:
        client.wait_for(ACTIVE)
        assert client.messages[-1].receive_multiplier == multiplier
        counts = cabinet.status()["counts"]
    assert counts["received"] <= counts["sent"] // multiplier + 2


def test_a_multiplier_is_met_at_any_phase(make, client):
    client._unanswered = 1  # begins to answer one message early
    client.start()
    with make(receive_multiplier=3):
        client.wait_for(ACTIVE)
