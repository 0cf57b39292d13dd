"""Wilson intervals against scipy, and rows against hand counts."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from dovetail.errors import ConfigError
from dovetail.evaluation.outcome import Outcome
from dovetail.evaluation.transfer import COLUMNS, cells, summarise, wilson_interval


def outcome(pose=0, success=True, **changes):
    numbers = {
        "pose": pose,
        "attempt": 0,
        "seed": 1,
        "success": success,
        "steps": 40,
        "depth": 0.028,
        "force_mean": 2.0,
        "force_peak": 10.0,
        "force_step": 5.0,
        "contact_cycles": 100,
        "violations": 0,
        "stopped": "",
        "log": "",
    }
    return Outcome.from_numbers(numbers | changes)


@pytest.mark.parametrize(
    ("successes", "tries"), [(0, 1), (0, 20), (10, 20), (18, 20), (57, 60), (60, 60)]
)
def test_wilson_interval_equals_scipy(successes, tries):
    peer = binomtest(successes, tries).proportion_ci(0.95, method="wilson")
    interval = wilson_interval(successes, tries)
    assert interval == pytest.approx((peer.low, peer.high), abs=1e-7)


@given(st.integers(1, 500), st.data())
def test_wilson_interval_holds_the_rate_and_stays_inside_0_to_1(tries, data):
    successes = data.draw(st.integers(0, tries))
    low, high = wilson_interval(successes, tries)
    assert 0.0 <= low <= successes / tries <= high <= 1.0


@given(st.integers(1, 200), st.data())
def test_wilson_interval_is_symmetric_in_success_and_failure(tries, data):
    successes = data.draw(st.integers(0, tries))
    low, high = wilson_interval(successes, tries)
    mirrored = wilson_interval(tries - successes, tries)
    assert (1 - high, 1 - low) == pytest.approx(mirrored, abs=1e-12)


@pytest.mark.parametrize(("successes", "tries"), [(1, 0), (-1, 5), (6, 5)])
def test_impossible_counts_are_refused(successes, tries):
    with pytest.raises(ConfigError, match=f"{successes} successes of {tries}"):
        wilson_interval(successes, tries)


def test_rows_count_each_pose_and_all():
    outcomes = [
        outcome(0, steps=30, violations=2, force_peak=5.0),
        outcome(0, steps=50, force_peak=15.0),
        outcome(1, success=False, steps=200, force_peak=40.0),
    ]
    first, second, total = summarise(outcomes, ["A", "B"])
    assert (first.successes, first.tries, first.violations) == (2, 2, 2)
    assert (first.steps.median, first.steps.max) == (40.0, 50.0)
    assert math.isnan(second.steps.median)
    assert (total.successes, total.tries, total.force.peak) == (2, 3, 40.0)


def test_mean_force_weighs_each_try_by_its_time_in_contact():
    outcomes = [
        outcome(force_mean=10.0, contact_cycles=300),
        outcome(force_mean=2.0, contact_cycles=100),
        outcome(force_mean=0.0, contact_cycles=0),
    ]
    assert summarise(outcomes, ["A"])[0].force.mean == pytest.approx(8.0)


def test_no_contact_at_all_gives_no_force():
    silent = outcome(force_mean=0.0, force_peak=0.0, contact_cycles=0)
    assert summarise([silent], ["A"])[0].force.mean == 0.0


def test_a_pose_without_tries_is_refused_by_name():
    with pytest.raises(ConfigError, match="fixture pose B has no try"):
        summarise([outcome(0)], ["A", "B"])


def test_a_row_fills_every_column():
    for row in summarise([outcome(success=False)], ["A"]):
        assert len(cells(row)) == len(COLUMNS)
        assert "nan" not in " ".join(cells(row))
