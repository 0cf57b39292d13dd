"""The sequential test of two policies: its error rate, its tries, its interval."""

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.evaluation import paired_test
from dovetail.evaluation.paired_test import Pairs, difference_interval, judge


def decide(first, second, tries, error_rate=0.05):
    """Compare two rows of successes; return the verdict and the tries it took."""
    pairs, verdict = Pairs(), "undecided"
    for a, b in zip(first, second, strict=True):
        if verdict == "undecided":
            pairs = pairs.add(bool(a), bool(b))
            verdict = judge(pairs, tries, error_rate)
    return verdict, pairs.tries


@pytest.mark.parametrize("tries", [10, 60, 200, 500])
def test_equal_policies_are_told_apart_at_most_as_often_as_allowed(tries):
    """Exactly, by the walk of a fair coin; and the threshold wastes little of it."""
    leads = paired_test._bounds(tries, 0.05)
    assert 0.025 < paired_test.error_of(leads) <= 0.05


def test_the_error_of_a_single_look_is_that_of_the_sign_test():
    """Deciding at 8 of 8 alone: 2 / 2^8."""
    leads = np.full(9, 99.0)
    leads[8] = 8
    assert paired_test.error_of(leads) == pytest.approx(2 / 2**8)


@pytest.mark.parametrize("rate", [0.5, 0.8, 0.95])
def test_200_comparisons_of_equal_policies_give_few_false_alarms(rate):
    random = np.random.default_rng(7)
    alarms = 0
    for _ in range(200):
        first, second = random.random((2, 200)) < rate
        alarms += decide(first, second, 200)[0] in ("first", "second")
    assert alarms <= 0.05 * 200


def test_a_difference_of_ten_percent_is_found_sooner_than_by_a_fixed_number():
    """85 against 95 %: McNemar's test has a power of 80 % with 132 tries."""
    random = np.random.default_rng(3)
    found, took = [], []
    for _ in range(200):
        first, second = random.random((2, 200)) < [[0.95], [0.85]]
        verdict, tries = decide(first, second, 200)
        found.append(verdict)
        took.append(tries)
    assert found.count("first") >= 0.7 * 200
    assert found.count("second") == 0
    assert np.mean(took) < 132


def test_a_policy_that_always_wins_is_found_at_once():
    verdict, tries = decide(np.ones(200), np.zeros(200), 200)
    assert verdict == "first"
    assert tries <= 10


def test_tries_end_when_those_left_can_tell_no_more():
    assert decide(np.ones(40), np.ones(40), 40) == ("no answer", 34)


@pytest.mark.parametrize(("first", "second"), [(9, 0), (0, 9), (30, 12)])
def test_the_verdict_does_not_depend_on_the_order(first, second):
    one = judge(Pairs(5, first, second, 5), 200)
    other = judge(Pairs(5, second, first, 5), 200)
    swapped = {"first": "second", "second": "first"}
    assert other == swapped.get(one, one)


@pytest.mark.parametrize("tries", [0, 2001])
def test_tries_out_of_range_are_refused(tries):
    with pytest.raises(ConfigError) as raised:
        judge(Pairs(1, 0, 0, 0), tries)
    assert raised.value.name == "tries"
    assert raised.value.allowed == (1, 2000)


def test_the_interval_is_newcombes():
    """His example of 50 pairs, 36, 12, 2 and 0: 0.0569 to 0.3404 by method 10."""
    low, high = difference_interval(Pairs(both=36, first=12, second=2, neither=0))
    assert low == pytest.approx(0.0569, abs=5e-5)
    assert high == pytest.approx(0.3404, abs=5e-5)


def test_the_interval_covers_the_true_difference():
    random = np.random.default_rng(5)
    covered = 0
    for _ in range(400):
        counts = random.multinomial(60, [0.6, 0.2, 0.1, 0.1])
        low, high = difference_interval(Pairs(*map(int, counts)))
        covered += low <= 0.1 <= high
    assert covered >= 0.93 * 400
