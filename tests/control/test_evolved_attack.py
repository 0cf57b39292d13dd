"""The evolved attack: its loop is the controller, and what it found stays cured."""

import dataclasses
from pathlib import Path

import evolved_attack as evolved
import numpy as np
import pytest
from attacks import episode

from dovetail import _bench, _core
from extras import need

CASES = sorted((Path(__file__).parent / "attack_cases").glob("wall-*.json"))
STEPS = sorted((Path(__file__).parent / "attack_cases").glob("step-*.json"))
LARGEST_STEP = 20.0  # Nm


@pytest.fixture
def search(tmp_path):
    return evolved.Search(
        episode.Settings(period=5e-3), "wall", "true", 10_000, 3, 0, tmp_path
    )


def test_the_loop_is_that_of_controller_and_plant(search, rng):
    """Cycle by cycle in Python: late, repeated, lost and wrong states, too."""
    search = dataclasses.replace(search, states="bad")
    attacked = episode.Attacked(search.settings)
    genes = rng.normal(0.0, 1.0, evolved.GENES + 5 * evolved.EVENT_GENES)
    genes[:7] = 0.0
    attempt = evolved.decode(search, attacked.start(rng), genes)
    attempt.age[30:33], attempt.age[50] = [1, 2, 3], episode.LOST
    attempt.wrong = [(70, 3, 0.02), (71, 9, -0.5), (71, 10, np.nan)]
    worst, trace = attacked.run(attempt, trace=True)
    pose = attacked.robot.tool_pose(attempt.q)
    controller, plant = attacked.controller, attacked.plant
    controller.reset(attempt.q, pose.position, pose.quat_wxyz)
    plant.reset(attempt.q, np.zeros(7))
    past, elapsed, tau = [], 0.0, np.zeros(7)
    for k, age in enumerate(attempt.age[:100]):
        if k % 10 == 0:
            turn = attempt.theta[k // 10]
            target = _core.Target(np.append(attempt.f_star[k // 10], np.zeros(3)))
            target.quat_wxyz_d = episode.quat_multiply(
                episode.quat_about_z(turn), pose.quat_wxyz
            )
        past.append(np.hstack(plant.read()))
        elapsed += 5e-3
        if age >= 0:
            seen = past[k - min(age, k)].copy()
            for cycle, element, error in attempt.wrong:
                if cycle == k:
                    seen[element] += error
            tau = controller.step(seen[:7], seen[7:], target, elapsed).tau
            elapsed = 0.0
        for _ in range(5):
            plant.apply(tau, 1e-3)
        np.testing.assert_allclose(trace[k, :14], past[k], atol=1e-12)
        np.testing.assert_allclose(trace[k, 14:21], tau, atol=1e-9)
    assert worst["step_after_bad"][0] > 0.0
    assert worst["bad_cycles"] == sum(a != 0 for a in attempt.age) + 2


def test_a_search_finds_the_same_again_and_its_file_replays(search):
    value, worst, cycles = evolved.run_search(search)
    assert cycles >= 10_000
    settings, found, before = episode.load_episode(search.path)
    again, _ = episode.Attacked(settings).run(found)
    assert again["wall"] == tuple(before["wall"]) == tuple(worst["wall"])
    assert value == 1e3 * worst["wall"][0]
    search.path.unlink()
    assert evolved.run_search(search)[0] == value


def test_the_attack_sees_walls_that_are_given_up(search):
    """In the cascade joints undo what was done for walls: that must be found."""
    paper = episode.Settings(period=5e-3, limits={"scheme": "paper"})
    value, _, _ = evolved.run_search(dataclasses.replace(search, settings=paper))
    assert value > 50.0  # mm


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.stem)
def test_what_an_evolved_attack_once_broke_holds(case):
    """Each file says in `worst` by how much it was broken."""
    settings, attempt, before = episode.load_episode(case)
    assert max(before[name][0] for name in ("wall", "position", "speed")) > 0.0
    worst, _ = episode.Attacked(settings).run(attempt)
    for name in ("wall", "position", "speed"):
        assert worst[name][0] <= 0.0, name


@pytest.mark.parametrize("case", STEPS, ids=lambda path: path.stem)
def test_no_bad_sample_that_was_found_makes_a_large_step_again(case):
    """Each file says in `worst` how large it was."""
    settings, attempt, before = episode.load_episode(case)
    assert before["step_by_bad"][0] > LARGEST_STEP
    worst, _ = episode.Attacked(settings).run(attempt)
    assert worst["step_by_bad"][0] <= LARGEST_STEP


@pytest.mark.parametrize(
    ("wrong", "named"),
    [([(5, 14, 0.1)], "element 14"), ([(5, 0, 0.1), (4, 0, 0.1)], "cycle 4")],
)
def test_a_wrong_number_that_is_nowhere_is_named(search, wrong, named):
    attacked = episode.Attacked(search.settings)
    with pytest.raises(ValueError, match=named):
        _bench.run_attack(
            attacked.controller, attacked.plant, np.zeros((1, 6)),
            np.array([[1.0, 0.0, 0.0, 0.0]]), 10, [0] * 10, wrong,
        )  # fmt: skip


@pytest.mark.parametrize("change", [{"seed": 4}, {"states": "stale"}])
def test_a_search_that_was_run_is_taken_and_another_is_not(search, capsys, change):
    need("cmaes")
    first = dataclasses.replace(search, cycles=800)
    value, _, cycles = evolved.run_search(first)
    assert evolved.run_search(first)[::2] == (value, cycles)
    assert capsys.readouterr().out == ""
    other = dataclasses.replace(first, **change)
    for text in (first.path.read_text(), '{"settings": '):  # one that was cut, too
        other.path.write_text(text)
        evolved.run_search(other)
        assert "of other options or another build" in capsys.readouterr().out
