"""Control periods: which there are, and how any other is refused."""

import math

import pytest

from dovetail.control.config import PERIOD_MAX, PERIOD_MIN
from dovetail.control.period import (
    FRI_PERIODS,
    PERIODS,
    POLICY_PERIOD,
    require_period,
)
from dovetail.durations import format_ms, parse_duration
from dovetail.errors import ConfigError


def test_a_policy_step_is_a_whole_number_of_every_period():
    for period in PERIODS:
        cycles = POLICY_PERIOD / period
        assert cycles == pytest.approx(round(cycles), abs=1e-12)
        assert PERIOD_MIN <= period <= PERIOD_MAX
        assert parse_duration(format_ms(period), "x") == pytest.approx(period)
    assert set(FRI_PERIODS) == {p for p in PERIODS if (1e3 * p).is_integer()}


@pytest.mark.parametrize("period", PERIODS)
def test_a_period_that_is_nearly_one_of_them_is_that_one(period):
    assert require_period(period * (1.0 + 1e-12)) == period
    assert require_period(1e-3 * (1e3 * period)) == period


@pytest.mark.parametrize(
    ("period", "message"),
    [
        (0.003, "is 3 ms; a policy step, 50 ms, is no multiple of it; allowed: "),
        (0.004, "allowed: 1, 2, 2.5 and 5 ms; take 2.5ms"),
        (0.00125, "is 1.25 ms, at which the limits were not tested; allowed: 1, 2"),
        (0.006, "is 6 ms; allowed: 1, 2, 2.5 and 5 ms; take 5ms"),
        (0.0005, "is 0.5 ms; allowed: 1, 2, 2.5 and 5 ms; take 1ms"),
        (5.0, "is 5000 ms; allowed"),
        (0.0, "is 0 ms; allowed"),
        (-0.005, "is -5 ms; allowed"),
        (math.nan, "is nan, no number of seconds; allowed"),
        (math.inf, "is inf, no number of seconds; allowed"),
        ("5ms", "is '5ms', no number of seconds; allowed"),
    ],
)
def test_any_other_is_refused_with_the_list_and_the_next_one(period, message):
    with pytest.raises(ConfigError, match=r"^period ") as error:
        require_period(period, "period")
    assert message in str(error.value)


def test_fri_knows_whole_milliseconds_only():
    with pytest.raises(ConfigError, match=r"2\.5 ms, and FRI knows whole milliseconds"):
        require_period(0.0025, allowed=FRI_PERIODS)
