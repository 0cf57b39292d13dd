"""In closed loop with the exact arm the adversary breaks no limit (invariant 14)."""

import adversary
import pytest


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("period", [0.001, 0.005])
def test_no_limit_is_broken_in_1e5_adversarial_cycles(period):
    settings = adversary.Settings(period=period, last_line=False)  # it ends attacks
    report = adversary.Adversary(settings, seed=7).run(100_000)
    assert report.cycles == 100_000
    assert report.violations() == 0, report
    assert report.flags["unsafe"] == 0
    assert report.flags["qp_early"] == 0


def test_few_cycles_break_no_limit_with_everything_wrong():
    settings = adversary.Settings(
        mismatch=True, f_star=10.0, push_rise=0.01, last_line=False
    )
    report = adversary.Adversary(settings, seed=7).run(10_000)
    assert report.violations() == 0, report


@pytest.mark.parametrize(
    ("delay", "episode"),
    [(0.005, 74), (0.010, 8), (0.010, 74), (0.010, 109), (0.010, 173)],
)
def test_a_push_that_turns_round_makes_no_joint_too_fast(delay, episode):
    """With everything else wrong it took A6 to 1.07, and A4 to 1.21 of its speed."""
    settings = adversary.Settings(mismatch=True, f_star=10.0, delay=delay)
    attack = adversary.Adversary(settings, seed=0)
    attack.run_episode(episode, 5000)
    assert attack.report.violations() == 0, attack.report


def test_the_count_finds_the_overshoot_of_the_papers_bounds():
    settings = adversary.Settings(
        scheme="paper", bounds="paper-corrected", walls=False, last_line=False
    )
    report = adversary.Adversary(settings, seed=7).run(10_000)
    assert report.position.count > 0
    assert 0.05 < report.position.worst < 0.2  # rad, v^2 / 2A


def test_the_count_finds_walls_that_the_cascade_loses():
    settings = adversary.Settings(scheme="paper", last_line=False)
    report = adversary.Adversary(settings, seed=7).run(10_000)
    assert report.wall.count > 0
    assert report.position.count == 0
