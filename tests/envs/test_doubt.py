"""A camera that is covered, and a fixture that is moved by chance."""

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z
from dovetail.trackers.find import find_tracker

FIXTURE = Pose(np.array([0.6, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))


def shifts(doubt, count=2000):
    tracker = find_tracker(f"covered?doubt={doubt}")
    found = []
    for seed in range(count):
        tracker.reset(FIXTURE, seed)
        found.append(FIXTURE.position - tracker.estimate().pose.position)
    return np.array(found)


@pytest.mark.parametrize("doubt", [0.001, 0.05])
def test_the_shift_is_level_and_anywhere_in_the_circle_alike(doubt):
    away = shifts(doubt)
    radius = np.hypot(away[:, 0], away[:, 1])
    assert (away[:, 2] == 0.0).all()
    assert radius.max() <= doubt
    # A quarter of the circle lies within half its radius; 2000 draws, 4 sigma.
    assert np.mean(radius < doubt / 2.0) == pytest.approx(0.25, abs=0.04)
    np.testing.assert_allclose(away.mean(axis=0) / doubt, 0.0, atol=0.05)


def test_a_seed_gives_the_same_shift_again():
    np.testing.assert_array_equal(shifts(0.02, 5), shifts(0.02, 5))


@pytest.mark.parametrize("doubt", [-0.001, 0.051, float("nan")])
def test_a_doubt_out_of_range_is_refused(doubt):
    with pytest.raises(ConfigError, match="doubt"):
        find_tracker(f"covered?doubt={doubt}")


def test_the_turn_is_about_the_vertical_and_in_every_episode_another():
    tracker = find_tracker("covered?turn=0.06")
    true = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.3))
    turns = []
    for seed in range(1000):
        tracker.reset(true, seed)
        seen = tracker.estimate().pose
        np.testing.assert_array_equal(seen.position, true.position)
        w, x, y, z = seen.quat_wxyz
        assert x == y == 0.0
        turns.append(2.0 * np.arctan2(z, w) - 0.3)
    assert np.abs(turns).max() <= 0.06
    assert np.std(turns) == pytest.approx(0.06 / np.sqrt(3.0), rel=0.05)


@pytest.mark.parametrize("turn", [-0.001, 0.51, float("inf")])
def test_a_turn_out_of_range_is_refused(turn):
    with pytest.raises(ConfigError, match="tracker turn"):
        find_tracker(f"covered?turn={turn}")
