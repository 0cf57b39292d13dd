"""A run ends when it has learned: by tests, after its rate has fallen."""

from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from dovetail.errors import ConfigError
from dovetail.evaluation.transfer import wilson_interval
from dovetail.learn import tester
from dovetail.learn.algorithms import make_vec_env
from dovetail.learn.assess import EpisodeResult, TestEnvs, assess
from dovetail.learn.checkpoint import list_checkpoints
from dovetail.learn.config import TrainConfig
from dovetail.learn.early_stopping import PORTION, EarlyStopping
from dovetail.learn.policy import Policy
from dovetail.learn.progress import WINDOW, EpisodeRow
from dovetail.learn.train import train
from extras import need

START, SETTLE = 1000, 400
CONFIG = TrainConfig(learning_starts=START, settle=SETTLE, until=0.9, test_episodes=100)


def row(step, success):
    return EpisodeRow(step, 0.0, 10, int(success), 1.0, 0.0)


def told(stop, first, successes):
    """Tell of an episode every ten steps; return the last one's step."""
    step = first
    for i, success in enumerate(successes):
        step = first + 10 * i
        stop.note(row(step, success))
    return step


def learned(config=CONFIG):
    """Return a stop whose rate began to fall, and the step where that was."""
    stop = EarlyStopping(config)
    return stop, told(stop, START + 10, [True] * WINDOW)


def test_the_rate_falls_once_nine_of_ten_tries_succeed():
    stop = EarlyStopping(CONFIG)
    step = told(stop, START + 10, [True] * 44 + [False] * 6)
    step = told(stop, step + 10, [True] * 44)  # 44 of 50 all the time
    assert stop.rate(step) == stop.rate(step + 10 * SETTLE) == 1.0
    begun = told(stop, step + 10, [True])
    told(stop, begun + 10, [True] * 5)
    assert stop.rate(begun) == 1.0
    assert stop.rate(begun + SETTLE // 2) == pytest.approx(0.55)
    assert stop.rate(begun + SETTLE) == stop.rate(begun + 9 * SETTLE)
    assert stop.rate(begun + SETTLE) == pytest.approx(0.1)
    assert not stop.is_due(begun + SETTLE - 1)
    assert stop.is_due(begun + SETTLE)


def test_tries_of_chance_or_a_teacher_are_not_the_learners():
    stop = EarlyStopping(CONFIG)
    step = told(stop, START - 10 * (WINDOW - 1), [True] * WINDOW)
    assert step == START
    step = told(stop, START + 10, [True] * (WINDOW - 1))
    assert stop.rate(step + SETTLE) == 1.0
    told(stop, step + 10, [True])
    assert stop.rate(step + 10 + SETTLE) < 1.0


def test_a_run_that_unlearns_learns_at_the_full_rate_again():
    stop, step = learned()
    step = told(stop, step + 10, [False] * 15)  # 35 of 50 are not below seven of ten
    assert stop.is_due(step + SETTLE)
    step = told(stop, step + 10, [False])
    assert not stop.is_due(step + SETTLE)
    assert stop.rate(step + SETTLE) == 1.0


TESTS = [(count, until) for count in (1, 50, 120, 300) for until in (0.0, 0.5, 0.98)]
"""Episodes of a test, and the success that it must show."""
PASSABLE = [test for test in TESTS if wilson_interval(test[0], test[0])[0] >= test[1]]


@pytest.mark.parametrize(("count", "until"), sorted({*TESTS} - {*PASSABLE}))
def test_a_test_that_nothing_could_pass_is_refused(count, until):
    with pytest.raises(ConfigError, match="raise --test-episodes"):
        replace(CONFIG, test_episodes=count, until=until)


@pytest.mark.parametrize(("count", "until"), PASSABLE)
def test_a_test_is_passed_where_wilsons_bound_is_reached(count, until):
    config = replace(CONFIG, test_episodes=count, until=until)
    for failures in {0, 1, min(2, count), count // 3, count}:
        successes = np.ones(count, dtype=bool)
        successes[:failures] = False
        portions, taken = [], 0
        for seeds in EarlyStopping(config).seeds(7):
            portions.append(successes[taken : taken + len(seeds)].tolist())
            taken += len(seeds)
        assert taken == count
        passed = EarlyStopping(config).is_passed(7, portions)
        assert passed == (wilson_interval(count - failures, count)[0] >= until)


def history(stop, step, counts):
    """Make tests with so many successes of 300; return which of them ended the run."""
    for number, succeeded in enumerate(counts):
        tries = [True] * succeeded + [False] * (300 - succeeded)
        portions = [tries[i : i + PORTION] for i in range(0, 300, PORTION)]
        if stop.is_passed(step, portions):
            return number
        step += SETTLE
    return None


@pytest.mark.parametrize(
    ("counts", "last"),
    [
        ([299], 0),  # proven: 298 of 300 are not
        ([298], None),
        ([298, 298], 1),
        ([294, 297, 296], 2),  # the second was better
        ([294, 295, 296, 297, 298, 300], 5),
        ([298, 293, 298, 293], None),  # not two in a row
        ([293] * 20, None),  # 97.7 %: the steps end it
        ([296, 294], 1),
        ([290, 285, 299], 2),
    ],
)
def test_a_run_ends_where_success_is_proven_or_shown_twice(counts, last):
    stop, step = learned(replace(CONFIG, until=0.98, test_episodes=300))
    assert history(stop, step, counts) == last
    assert bool(stop.end) == (last is not None)


@pytest.mark.parametrize(("rate", "least"), [(0.95, 25), (0.987, 0)])
def test_a_policy_at_987_permille_ends_and_one_at_950_goes_on(rate, least):
    rng, lengths = np.random.default_rng(0), []
    for _ in range(40):
        stop, step = learned(replace(CONFIG, until=0.98, test_episodes=300))
        counts = rng.binomial(300, rate, 30)
        last = history(stop, step, counts.tolist())
        lengths.append(30 if last is None else last + 1)
    assert np.mean(lengths) > least
    assert least or np.percentile(lengths, 90) <= 8


def test_a_shown_success_is_forgotten_when_the_run_unlearns():
    stop, step = learned(replace(CONFIG, until=0.98, test_episodes=300))
    assert history(stop, step, [298]) is None
    step = told(stop, step + 10, [False] * 16)
    told(stop, step + 10, [True] * WINDOW)
    assert history(stop, step, [297]) is None


def test_a_test_that_can_show_nothing_any_more_ends():
    stop, step = learned()

    def portions():
        yield [False] * PORTION
        raise AssertionError("a second portion was played")

    assert not stop.is_passed(step, portions())
    assert stop.stage(step) == "test 0/50"


def test_after_a_failed_test_the_rate_falls_from_half_to_the_next():
    stop, step = learned()
    step += SETTLE
    assert not stop.is_passed(step, [[False] * PORTION])
    pause = SETTLE // 2
    shares = [stop.rate(step + i * pause // 4) for i in range(6)]
    assert shares == pytest.approx([0.5, 0.4, 0.3, 0.2, 0.1, 0.1])
    assert [stop.is_due(step + i) for i in (1, pause - 1, pause)] == [0, 0, 1]
    step = told(stop, step + 10, [False] * 16)
    assert stop.rate(step) == 1.0
    step = told(stop, step + 10, [True] * WINDOW)
    assert stop.rate(step + pause) < 0.6
    assert not stop.is_due(step + pause)


def test_every_test_has_tries_of_its_own():
    stop, other = EarlyStopping(CONFIG), EarlyStopping(replace(CONFIG, seed=1))
    tests = stop.seeds(1), stop.seeds(2), other.seeds(1)
    tries = {seed for test in tests for portion in test for seed in portion}
    assert len(tries) == 3 * CONFIG.test_episodes
    assert EarlyStopping(CONFIG).seeds(1) == stop.seeds(1)


def test_all_steps_can_be_asked_for():
    stop, step = learned(replace(CONFIG, until=1.0))
    assert stop.rate(step + SETTLE) == 1.0
    assert not stop.is_due(step + 10 * SETTLE)
    assert stop.stage(step) == ""


def test_a_resumed_run_is_in_the_same_stage():
    rng = np.random.default_rng(0)
    rows = [row(20 * i, rng.random() < min(1.0, i / 150)) for i in range(300)]
    stop, later = EarlyStopping(CONFIG), 0
    for i, episode in enumerate(rows):
        stop.note(episode)
        again = EarlyStopping(CONFIG)
        for before in rows[: i + 1]:
            again.note(before)
        later = episode.step + SETTLE // 2
        assert again.rate(later) == stop.rate(later)
        assert again.stage(later) == stop.stage(later)
    assert stop.is_due(later)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"until": 0.99}, r"until is 0.99, but 300 episodes of 300 show only 0.9874"),
        ({"until": 1.1}, "until is 1.1; allowed: 0 to 1"),
        ({"test_episodes": 0}, "test_episodes is 0; allowed: 1 to"),
        ({"until": 0.5, "arm": "grpc://localhost:1"}, "there is one arm at grpc://"),
    ],
)
def test_a_test_that_cannot_be_made_or_passed_is_refused(settings, words):
    with pytest.raises(ConfigError, match=words):
        TrainConfig(**settings)


def test_an_arms_time_goes_into_no_test_unless_asked_for():
    assert TrainConfig().asked_success == 0.98
    assert TrainConfig(arm="twin:easy").asked_success == 1.0
    assert TrainConfig(arm="twin:easy", until=0.5).asked_success == 0.5


def test_how_many_environments_play_changes_nothing(small, policy):
    need("sbx")
    config = replace(small, num_envs=3, threads=2)
    env, alone = make_vec_env(config), make_vec_env(replace(config, num_envs=1))
    wanted = assess(policy, 7, tester.stage_of(alone))
    assert assess(policy, 7, tester.stage_of(env)) == wanted
    assert assess(policy, 2, TestEnvs(env.envs)) == assess(
        policy, 2, TestEnvs(alone.envs)
    )
    env.close()
    alone.close()


@pytest.fixture
def eager(small, monkeypatch):
    """A run that thinks that it has learned as soon as 50 tries have ended."""
    need("sbx")
    monkeypatch.setattr("dovetail.learn.early_stopping.BEGIN", 0.0)
    monkeypatch.setattr("dovetail.learn.early_stopping.LOST", 0.0)
    changes = {"algorithm": "ppo", "steps": 900, "max_steps": 5, "settle": 40}
    return replace(small, until=0.3, test_episodes=6, **changes)


def test_a_run_ends_with_the_test_that_it_passes(eager, monkeypatch):
    results = iter([[True] * 2 + [False] * 4, [True] * 6, [True] * 6])

    def play(policy, seeds, stage):
        assert isinstance(policy, Policy)
        assert len(seeds) == 6
        return [EpisodeResult(ok, 1, 0.0, 0) for ok in next(results)]

    monkeypatch.setattr(tester, "play", play)
    output = StringIO()
    (result,) = train(eager, Console(file=output))
    words = output.getvalue()
    assert "testing" in words
    assert "test 2/6" in words
    assert 40 + WINDOW * 5 + 40 <= result.steps < 900
    newest = list_checkpoints(eager.out / "checkpoints")[-1]
    assert newest.stem == f"step-{result.steps:010d}"
    weights = result.policy.read_bytes()
    (again,) = train(replace(eager, resume=True), Console(file=StringIO()))
    assert again.steps == result.steps  # by the third test, without a step
    assert again.policy.read_bytes() == weights
