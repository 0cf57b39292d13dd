"""How hard the shipped policies were tried: a table for each, none left out."""

import pytest

from dovetail.evaluation.config import EvaluationConfig
from dovetail.evaluation.measured import DISTURBANCES, measured_ranges, outside_measured
from dovetail.learn.policy import find_policy, list_policies


@pytest.mark.parametrize("policy", list_policies())
def test_a_shipped_policy_has_a_range_for_every_disturbance_of_its_task(policy):
    known = set(measured_ranges()[policy])
    assert set(DISTURBANCES) - known <= {"clearance"}
    assert known <= set(DISTURBANCES)


@pytest.mark.parametrize(
    ("policy", "push", "is_outside"),
    [("peg_square", 30.0, False), ("peg_square", 60.0, True), ("rail_clip", 5.0, True)],
)
def test_what_is_harder_than_measured_is_said(policy, push, is_outside):
    config = EvaluationConfig(policy=policy, push=push)
    said = outside_measured(find_policy(policy), config, {})
    assert (f"{push:g} N" in said) == is_outside
