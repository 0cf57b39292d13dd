"""A run that starts from a policy keeps the actor whose episodes went best."""

from types import SimpleNamespace

import numpy as np
import pytest

from dovetail.learn.best_actor import GROUP, BestActor

FROZEN = 100


@pytest.fixture
def model():
    """An algorithm of which only the actor matters: here a name."""
    return SimpleNamespace(policy=SimpleNamespace(actor_state="start"))


@pytest.fixture
def best(model):
    """Judges a policy whose own episodes gave 9, 10 and 11: 10 +- 0.82."""
    best = BestActor(model, FROZEN)
    for reward in (9.0, 10.0, 11.0):
        best.add(reward)
    model.policy.actor_state = "taught by critics that know nothing"
    best.judge(FROZEN)
    return best


def play(model, best, actor, rewards, step=FROZEN + 1):
    model.policy.actor_state = actor
    best.judge(step)
    for reward in rewards:
        best.add(reward)
        best.judge(step)


def test_while_it_is_frozen_the_actor_stays_and_is_measured(model, best):
    assert model.policy.actor_state == best.kept.actor == "start"
    assert best.kept.reward == 10.0
    assert best.kept.spread == pytest.approx(np.std([9.0, 10.0, 11.0]))


def test_a_group_that_is_better_is_kept(model, best):
    play(model, best, "better", [10.0, 11.0, 11.0, 10.0, 12.0])
    assert (best.kept.actor, best.kept.reward) == ("better", 10.8)
    play(model, best, "worse", [10.5] * GROUP)
    best.finish()
    assert model.policy.actor_state == "better"


def test_a_group_that_is_a_little_worse_goes_on_learning(model, best):
    play(model, best, "learning", [9.0] * GROUP)
    assert model.policy.actor_state == "learning"
    assert best.kept.actor == "start"


def test_one_failed_episode_of_a_reliable_policy_is_enough_to_go_back(model, best):
    play(model, best, "forgetful", [-60.0])
    assert model.policy.actor_state == "start"


def test_after_going_back_the_judgement_begins_again(model, best):
    play(model, best, "forgetful", [-60.0])
    play(model, best, "better", [12.0] * GROUP)
    assert best.kept.actor == "better"


def test_a_policy_that_always_failed_is_left_for_one_that_does_not(model):
    best = BestActor(model, FROZEN)
    for reward in (-60.0, -20.0, -40.0):
        best.add(reward)
    best.judge(FROZEN)
    play(model, best, "tries", [-45.0, -50.0, -40.0, -48.0, -45.0])
    assert model.policy.actor_state == "tries"
    play(model, best, "inserts", [-40.0, 45.0, -40.0, 45.0, 45.0])
    assert best.kept.actor == "inserts"


def test_the_episode_at_the_end_of_the_freeze_counts_for_nobody(model, best):
    best.add(-60.0)
    play(model, best, "better", [11.0] * GROUP)
    assert best.kept.actor == "better"


def test_without_an_episode_to_compare_with_the_first_group_is_the_measure(model):
    best = BestActor(model, 0)
    play(model, best, "first", [1.0, 2.0, 3.0, 2.0, 2.0], step=1)
    assert (best.kept.actor, best.kept.reward) == ("first", 2.0)
    assert best.kept.spread > 0.0


def test_who_was_never_judged_ends_as_it_is(model):
    best = BestActor(model, 0)
    play(model, best, "last", [1.0], step=1)
    best.finish()
    assert model.policy.actor_state == "last"


def test_what_is_tested_is_the_actor_that_the_run_would_end_with(model, best):
    assert best.chosen == "start"
    play(model, best, "better", [12.0] * GROUP)
    play(model, best, "learning", [11.0])
    assert (model.policy.actor_state, best.chosen) == ("learning", "better")
    assert BestActor(model, FROZEN).chosen == "learning"  # none is judged yet
