"""Differences have the intervals that they claim, and the answers follow from them."""

import math

import numpy as np
import pytest

from dovetail.reproduce.design import LAWS, MODELS
from dovetail.reproduce.effects import Effect, Measured, contrast
from dovetail.reproduce.hypotheses import HYPOTHESES, SCALES, amount, answers, judge


def crossed(values):
    return Measured(np.asarray(values, dtype=float), False)


def of_twin(values):
    return Measured(np.asarray([values], dtype=float), True)


def test_a_difference_is_of_the_means_and_paired_by_twins():
    twins = np.array([0.1, 0.5, 0.9, 0.3])
    other = crossed([twins, twins + 0.2, twins - 0.2])
    found = contrast([(1.0, of_twin(twins + 0.3)), (-1.0, other)])
    assert found.value == pytest.approx(0.3)
    # whatever twins are drawn, each differs by 0.3; only the policies' part is left
    assert 0.3 - 0.2 <= found.low < 0.3 < found.high <= 0.3 + 0.2
    same = contrast([(1.0, of_twin(twins + 0.3)), (-1.0, of_twin(twins))])
    assert (same.low, same.high) == (pytest.approx(0.3), pytest.approx(0.3))


def test_a_twin_that_a_cell_lacks_is_left_out_of_all():
    found = contrast(
        [
            (1.0, of_twin([1, 1, 1, 1, math.nan])),
            (-1.0, of_twin([0, 0, 0, math.nan, 0])),
        ]
    )
    assert (found.value, found.twins) == (1.0, 3)


def test_a_policy_that_lacks_a_twin_is_left_out():
    values = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0] * 3, [1.0, math.nan, 1.0]]
    assert contrast([(1.0, crossed(values))]).value == 0.0


@pytest.mark.parametrize(
    "cell", [of_twin([1.0, 0.0]), crossed([[1.0, 0.0, 1.0]] * 2), of_twin([math.nan])]
)
def test_too_few_have_no_interval(cell):
    found = contrast([(1.0, cell)])
    assert math.isnan(found.low)
    assert math.isnan(found.high)
    assert judge(found, HYPOTHESES[0]) == "open"


def drawn(random, policies=8, twins=12):
    """Returns nominal and identified cells whose true difference is 0.2."""
    twin = random.normal(0.0, 0.3, twins)
    seed = random.normal(0.0, 0.2, (policies, 1))
    left = twin + seed + random.normal(0.0, 0.1, (policies, twins))
    right = 0.2 + 0.5 * twin + random.normal(0.0, 0.2, twins)
    return crossed(left), of_twin(right)


def test_intervals_cover_the_truth_as_often_as_they_say():
    random = np.random.default_rng(1)
    hits = 0
    for _ in range(200):
        left, right = drawn(random)
        found = contrast([(1.0, right), (-1.0, left)])
        hits += found.low <= 0.2 <= found.high
    assert hits >= 184  # 92 %; taking tries as facts covers in about half


def test_the_verdict_is_that_of_the_whole_interval():
    better = next(h for h in HYPOTHESES if h.claim == "more")
    less = next(h for h in HYPOTHESES if h.claim == "less")
    near = next(h for h in HYPOTHESES if h.claim == "no worse")
    up, across, down = (Effect(0, *ends, 9) for ends in ((1, 2), (-1, 1), (-2, -1)))
    assert [judge(e, better) for e in (up, across, down)] == ["yes", "open", "no"]
    assert [judge(e, less) for e in (up, across, down)] == ["no", "open", "yes"]
    margin = SCALES[near.measure].margin
    assert judge(Effect(0, -0.9 * margin, 1, 9), near) == "yes"
    assert judge(Effect(0, -1.1 * margin, 1, 9), near) == "open"
    assert judge(Effect(0, -1, -1.1 * margin, 9), near) == "no"


def test_every_question_can_be_answered_either_way():
    for sign in (1.0, -1.0):
        found = answers(
            lambda name, measure, sign=sign: of_twin(
                np.full(5, sign * 100 * list(MODELS).index(name.model))
                * (3 - list(LAWS).index(name.law))
            )
        )
        assert {one.verdict for one in found} >= {"yes", "no"}
    asked = {(one.hypothesis.question, one.hypothesis.law) for one in found}
    assert len(asked) == len(found)


def test_a_difference_has_its_unit():
    assert amount(Effect(0.121, 0.05, 0.2, 9), "success") == (
        "+12.1 points (+5.0 to +20.0)"
    )
    assert amount(Effect(20.0, -20.0, 60.0, 9), "time") == "+1.00 s (-1.00 to +3.00)"
