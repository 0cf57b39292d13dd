"""The session's states and transitions over real UDP on 127.0.0.1."""

from dovetail.cabinet.protocol import SessionState

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState


def test_a_client_that_mirrors_gets_to_commanding_active(make, client):
    client.start()
    with make():
        client.wait_for(ACTIVE)
        assert client.states == [WAIT, READY, C_WAIT, ACTIVE]
