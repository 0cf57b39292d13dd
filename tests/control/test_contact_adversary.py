"""The adversary in contact: a short run per period, and every case that it ever found.

`contact_cases.json` holds tries that once broke the controller. Those within the proven
range must keep every joint limit and must not grow; the others stay within what holds
out to the full range.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from attacks import contact_attack

CASES = json.loads((Path(__file__).parent / "contact_cases.json").read_text())
PERIODS = [0.001, 0.002, 0.0025, 0.005]
TIED = {"position": 0.0, "speed": 1.1, "contact": 5.0}
"""A spring of up to 1e5 N/m that stops one joint speeds up others quicker than a loop
with delay can see: what holds then, unless the spring is stronger than a motor."""
SOFT = ("stiffness", (400.0, 400.0, 400.0, 200.0, 200.0, 200.0))
INTEGRALS = (("integral_clamp_linear", 0.0), ("integral_clamp_angular", 0.0))
TURNS = (("turn_speed", 1e4), ("error_clamp_rotation", 0.25))
JERKY = (("move_speed", 1e4), *TURNS, SOFT, *INTEGRALS, ("delta_v", 0.45))
"""The law, and the speed, with which cases were found: jumps of a pose saturate."""


def broken(outcome, span, task):
    """Return what was exceeded, with its value."""
    limits = contact_attack.LIMITS[span]
    if task == "spring":
        limits = contact_attack.OVERPOWERED if outcome.worst["load"] > 1.0 else TIED
    return {k: outcome.worst[k] for k, v in limits.items() if outcome.worst[k] > v}


@pytest.mark.parametrize("period", PERIODS)
def test_few_tries_in_the_proven_range_break_no_joint_limit(period):
    attack = contact_attack.Attack(period=period, seed=11)
    for index in range(6):
        outcome, task = attack.run(index), attack.choices(index).task
        assert not broken(outcome, "proven", task), index


@pytest.mark.parametrize("overrides", [(), JERKY], ids=["as it is", "jerky"])
@pytest.mark.parametrize("case", CASES, ids=[case["name"] for case in CASES])
def test_no_case_that_was_found_is_lost_again(case, overrides):
    attack = contact_attack.Attack(
        period=case["period"],
        span=case["span"],
        is_hardware=case["is_hardware"],
        overrides=overrides,
        hold_on=case.get("hold_on", 0.0),
    )
    vector = np.array(case["vector"])
    outcome = attack.run_vector(vector, tuple(case["seed"]))
    task = contact_attack.choose(vector, contact_attack.RANGES[case["span"]]).task
    assert not broken(outcome, case["span"], task), case["cause"]


def test_a_spring_stronger_than_a_motor_excuses_no_arm_that_runs_away():
    worst = {"position": 0.01, "speed": 1.1, "contact": 1.0, "load": 1.2}
    assert contact_attack.is_excused(worst)
    assert not contact_attack.is_excused(worst | {"load": 0.9})
    assert not contact_attack.is_excused(worst | {"position": 1.6})
    assert not contact_attack.is_excused(worst | {"speed": 3.8})


def test_a_try_is_the_same_whatever_ran_before():
    attack = contact_attack.Attack(period=0.005, seed=3)
    attack.run(4)
    first = attack.run(5)
    attack.run(6)
    second = attack.run(5)
    np.testing.assert_array_equal(first.trace, second.trace)
    assert first.worst == second.worst


def test_a_peg_that_leans_as_far_as_its_clearance_allows_finds_a_start():
    """Built with its clearance rounded down, it touched in each of 200 draws."""
    attack = contact_attack.Attack(period=0.005, seed=103)
    assert attack.choices(346).task == "jam"
    assert attack.run(346).cycles == 1000


def test_what_an_earlier_controller_did_is_caught():
    """An estimate far too quick for the delay, limiters that drive, no last line."""
    old = (("estimate_rate", 300.0), ("passive", 0.0), ("last_line", 0.0))
    attack = contact_attack.Attack(period=0.001, seed=3, overrides=old)
    outcomes = [attack.run(index) for index in (0, 3)]
    assert max(o.worst["speed"] for o in outcomes) > 1.0
    assert max(o.worst["sustained"] for o in outcomes) > 0.3  # rad/s


def test_after_an_end_no_wall_is_held_against_a_jam():
    """It drove the joints of a stretched arm, 34 times too fast; now the arm rests."""
    attack = contact_attack.Attack(period=0.005, seed=2, overrides=JERKY, hold_on=3.0)
    outcome = attack.run(553)
    worst, speeds = outcome.worst, outcome.trace[-100:, 8:15]
    assert outcome.counts["ended"]
    assert worst["position"] <= 0.0
    assert worst["speed"] <= 1.0
    assert worst["contact"] <= 5.0
    assert 0.0 < worst["wall"] < 0.03  # m
    assert np.abs(speeds).max() < 0.15  # rad/s, in the last half second: encoder noise


def test_after_an_end_no_other_joint_helps_a_weak_motor():
    """They shook a jammed tool ever harder: 1.56 times too fast, 33 mrad past."""
    worst = contact_attack.Attack(period=0.005, seed=41, overrides=JERKY).run(664).worst
    assert worst["grown"] == 0.0
    assert worst["speed"] < 0.9
    assert worst["position"] < 0.015  # rad: more than the motor's torque is on it


def test_what_only_seemed_to_grow_is_looked_at_for_longer():
    """Of two that rise for a second, one goes down again, and one is ended."""
    grown = {
        index: contact_attack.Attack(period=0.005, seed=seed, overrides=JERKY)
        .run(index)
        .worst["grown"]
        for seed, index in ((34, 536), (40, 397))
    }
    assert grown[536] == 0.0
    assert grown[397] > 0.1  # rad/s


def test_a_jump_of_the_rotation_saturates_no_joint():
    """A strike took a joint to 1.04 of its speed while the tool was thrown round."""
    for period in PERIODS:
        worst = contact_attack.Attack(period=period, seed=34).run(142).worst
        assert worst["speed"] < 0.9
