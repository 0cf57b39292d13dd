"""Simulated time waits for the wall's, and what was lost is not caught up for ever."""

import pytest

from dovetail.cockpit.pace import LATE_MAX, SPEED_MAX, SPEED_MIN, Pace


class Wall:
    """A clock that only sleeping moves."""

    def __init__(self):
        self.now = 100.0

    def sleep(self, time):
        self.now += time


@pytest.fixture
def wall():
    return Wall()


@pytest.fixture
def pace(wall):
    return Pace(lambda: wall.now, wall.sleep)


@pytest.mark.parametrize("speed", [SPEED_MIN, 0.5, 1.0, SPEED_MAX])
def test_simulated_time_is_as_fast_as_asked(wall, pace, speed):
    pace.speed = speed
    for _ in range(50):
        wall.now += 0.001  # what the slice took
        pace.wait(0.01)
    assert wall.now - 100.0 == pytest.approx(0.5 / speed)
    assert pace.rate == pytest.approx(1.0)


def test_a_short_delay_is_caught_up(wall, pace):
    wall.now += 0.9 * LATE_MAX
    for _ in range(50):
        pace.wait(0.01)
    assert wall.now - 100.0 == pytest.approx(0.5)


def test_of_a_long_delay_only_the_last_of_it_is_caught_up(wall, pace):
    wall.now += 10.0
    for _ in range(100):
        pace.wait(0.01)
    assert wall.now - 100.0 == pytest.approx(10.0 + 1.0 - LATE_MAX, abs=0.011)


def test_what_a_slow_machine_keeps_is_told(wall, pace):
    for _ in range(200):
        wall.now += 0.02
        pace.wait(0.01)
    assert pace.rate == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize(("asked", "given"), [(0.0, SPEED_MIN), (1e9, SPEED_MAX)])
def test_the_speed_stays_in_its_range(pace, asked, given):
    pace.speed = asked
    assert pace.speed == given
