"""Every state and transition of the session, and the application that moves it."""

import itertools

import pytest

from dovetail.cabinet.protocol import Quality, SessionState
from dovetail.cabinet.session import Application, SessionInputs, next_state
from dovetail.errors import ConfigError

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState
ALL = list(
    itertools.product(
        [True, False], Quality, [True, False], [True, False], [True, False]
    )
)


def situation(is_open=True, quality=Quality.GOOD, motion=True, sync=True, drives=True):
    return SessionInputs(is_open, quality, motion, sync, drives)


def expected(state, now):
    """Return docs/cabinet.md's transitions, written as a table."""
    is_good = now.quality >= Quality.GOOD
    table = {
        IDLE: [(True, WAIT)],
        WAIT: [(is_good, READY), (True, WAIT)],
        READY: [(not is_good, WAIT), (now.has_motion, C_WAIT), (True, READY)],
        C_WAIT: [
            (not is_good, WAIT),
            (not now.has_motion, READY),
            (now.is_synchronised and now.are_drives_active, ACTIVE),
            (True, C_WAIT),
        ],
        ACTIVE: [(not is_good, WAIT), (not now.has_motion, READY), (True, ACTIVE)],
    }
    if not now.is_open:
        return IDLE
    return next(target for holds, target in table[state] if holds)


@pytest.mark.parametrize("state", SessionState)
def test_full_transition_table(state):
    for values in ALL:
        now = SessionInputs(*values)
        assert next_state(state, now) is expected(state, now), (state, now)


def test_a_good_client_walks_up_one_state_at_a_time():
    state, seen = IDLE, []
    for _ in range(5):
        state = next_state(state, situation())
        seen.append(state)
    assert seen == [WAIT, READY, C_WAIT, ACTIVE, ACTIVE]


@pytest.mark.parametrize("missing", ["sync", "drives"])
def test_commanding_waits_for_synchronisation_and_drives(missing):
    assert next_state(C_WAIT, situation(**{missing: False})) is C_WAIT


@pytest.mark.parametrize("quality", [Quality.POOR, Quality.FAIR])
@pytest.mark.parametrize("state", [WAIT, READY, C_WAIT, ACTIVE])
def test_quality_below_good_leads_back_to_monitoring_wait(state, quality):
    assert next_state(state, situation(quality=quality)) is WAIT


@pytest.mark.parametrize("state", SessionState)
def test_closing_leads_to_idle_from_everywhere(state):
    assert next_state(state, situation(is_open=False)) is IDLE


def test_the_application_starts_a_motion_after_enough_ready_messages():
    application = Application(3, 10)
    application.open()
    for _ in range(2):
        application.tick(READY)
        assert not application.has_motion
    application.tick(READY)
    assert application.has_motion
    assert application.motions == 1


def test_readiness_starts_again_when_the_link_was_lost():
    application = Application(3, 10)
    application.open()
    for state in (READY, READY, WAIT, READY, READY):
        application.tick(state)
    assert not application.has_motion


def start(application):
    application.open()
    while not application.has_motion:
        application.tick(READY)


def test_a_motion_that_ended_well_starts_again_as_soon_as_ready():
    application = Application(1, 50)
    start(application)
    application.restart()
    assert not application.has_motion
    application.tick(READY)
    assert application.motions == 2


def test_a_motion_that_ended_with_an_error_waits_longer():
    application = Application(1, 50)
    start(application)
    application.end_motion("torque limit", is_error=True)
    assert application.stop_reason == "torque limit"
    for _ in range(49):
        application.tick(READY)
    assert not application.has_motion
    application.tick(READY)
    assert application.has_motion
    assert application.stop_reason == ""


def test_without_a_restart_delay_an_error_waits_for_resume():
    application = Application(0, None)
    start(application)
    application.end_motion("torque limit", is_error=True)
    for _ in range(1000):
        application.tick(READY)
    assert not application.has_motion
    application.resume()
    application.tick(READY)
    assert application.has_motion


def test_pause_holds_until_resume():
    application = Application(0, 0)
    start(application)
    application.pause()
    for _ in range(100):
        application.tick(READY)
    assert not application.has_motion
    application.resume()
    application.tick(READY)
    assert application.has_motion


def test_quality_loss_ends_the_motion():
    application = Application(0, 0)
    start(application)
    application.tick(WAIT)
    assert not application.has_motion
    assert "quality" in application.stop_reason


def test_close_ends_motion_and_session_and_resume_opens_a_new_one():
    application = Application(0, 0)
    start(application)
    application.close()
    assert not application.is_open
    assert not application.has_motion
    application.resume()
    assert application.is_open
    assert application.sessions == 2


def test_a_second_session_is_refused():
    application = Application(0, 0)
    application.open()
    with pytest.raises(ConfigError, match="a session is open"):
        application.open()
