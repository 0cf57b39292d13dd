"""Before a report is due the learner wakes the road: seldom, and at no step's cost."""

import math
import threading
import time
from collections import Counter

import grpc
import pytest

from dovetail.errors import ConfigError
from dovetail.rpc.step_stream import (
    WAKE_CALLS,
    WAKE_FROM,
    WAKE_LEAD,
    WAKE_STEPS,
)

from .conftest import HOLE, push

STEP = 0.05


@pytest.fixture
def learner(server, start, connect):
    arm = connect(server)
    arm.reset(start, HOLE)
    return arm


@pytest.fixture
def calls(learner, monkeypatch):
    """When a call that wakes the road began [s], and how long it may take [s]."""
    calls = []
    monkeypatch.setattr(learner._stub, "keep_alive", spied(learner, calls.append))
    return calls


def spied(learner, note):
    call = learner._stub.keep_alive

    def keep_alive(holder, timeout):
        if threading.current_thread() is not learner._keeper:
            note((time.monotonic(), timeout))
        return call(holder, timeout=timeout)

    return keep_alive


def test_a_long_step_wakes_the_road_shortly_before_its_report(learner, calls):
    begins = []
    for _ in range(10):
        begins.append(time.monotonic())
        learner.step(push(), STEP)
    per_step = Counter()
    for at, timeout in calls:  # on a busy machine some come in the step after theirs
        due = at + timeout
        step = sum(begin < due - WAKE_LEAD for begin in begins) - 1
        assert due > begins[step] + WAKE_FROM
        per_step[step] += 1
    assert per_step[0] == 0  # nothing is known yet of how late reports come
    assert 1 <= max(per_step.values()) <= WAKE_CALLS
    assert all(0.0 < timeout <= WAKE_LEAD for _, timeout in calls)


def test_a_short_step_wakes_nobody(learner, calls):
    for _ in range(10):
        learner.step(push(), 0.005)
    assert calls == []


def test_a_simulation_that_answers_at_once_wakes_nobody(learner, builder, calls):
    builder.arm._stop.set()  # its steps take no time
    for _ in range(10):
        learner.step(push(), STEP)
    assert calls == []


def test_a_report_is_expected_as_early_as_any_of_the_last_ones(learner):
    steps = learner._steps
    steps._late.extend([-0.001, 0.004, -0.003])
    assert steps._expected(STEP) == pytest.approx(STEP - 0.003)
    steps._late.extend([0.002] * WAKE_STEPS)
    assert steps._expected(STEP) == pytest.approx(STEP + 0.002)


def test_a_service_that_does_not_answer_in_time_delays_no_step(learner, monkeypatch):
    timeouts = []

    def keep_alive(holder, timeout):
        if threading.current_thread() is not learner._keeper:
            timeouts.append(timeout)
            time.sleep(timeout)
        raise grpc.RpcError

    monkeypatch.setattr(learner._stub, "keep_alive", keep_alive)
    for count in range(1, 11):
        assert learner.step(push(), STEP).stamp == pytest.approx(count * STEP)
    assert 1 <= len(timeouts) < 10  # after one failure nothing more in that step
    assert max(timeouts) <= WAKE_LEAD


@pytest.mark.parametrize("duration", [math.nan, math.inf, 1e300, -1.0, 0.0])
def test_a_wrong_duration_is_refused_and_the_stream_goes_on(learner, duration):
    learner.step(push(), STEP)
    with pytest.raises(ConfigError, match="duration"):
        learner.step(push(), duration)
    learner.step(push(), STEP)
