"""Points of the AI for Industry Challenge, from motions whose points are known."""

import numpy as np
import pytest

from dovetail.evaluation.aic_score import Insertion, Motion, aic_score, mean_jerk

H = 0.005
PLUGGED = Insertion(True, 0.014, 0.0135, True, 0.2)


def steady(seconds, speed=0.02, force=0.0):
    rows = round(seconds / H)
    velocity = np.tile([speed, 0.0, 0.0], (rows, 1))
    return Motion(H, velocity, np.tile([0.0, 0.0, force], (rows, 1)))


def test_a_quick_straight_smooth_insertion_has_every_point():
    assert aic_score(steady(5.0), PLUGGED).total() == pytest.approx(100.0)


def test_jerk_is_that_of_the_velocity_s_parabola():
    time = H * np.arange(400)
    velocity = np.stack([0.1 + 3.0 * time**2, 4.0 * time**2, 0.0 * time], axis=1)
    motion = Motion(H, velocity, np.zeros((400, 3)))
    assert mean_jerk(motion) == pytest.approx(10.0)
    points = aic_score(motion, PLUGGED)
    assert points.smoothness == pytest.approx(6.0 * (1.0 - 10.0 / 50.0))


def test_a_tool_that_stands_still_dilutes_no_jerk():
    time = H * np.arange(200)
    moving = np.stack([0.1 + 5.0 * time**2, 0 * time, 0 * time], axis=1)
    still = np.zeros((1000, 3))
    alone = mean_jerk(Motion(H, moving, moving))
    both = mean_jerk(Motion(H, np.vstack([still, moving]), np.zeros((1200, 3))))
    assert alone == pytest.approx(10.0)
    assert both > 9.0


@pytest.mark.parametrize(("seconds", "points"), [(5.0, 12), (32.5, 6), (61.0, 0)])
def test_time_has_its_points(seconds, points):
    motion = steady(seconds, speed=1e-3)
    assert aic_score(motion, PLUGGED).duration == pytest.approx(points)


@pytest.mark.parametrize(("length", "points"), [(0.2, 6), (0.7, 3), (1.3, 0)])
def test_the_path_is_counted_beyond_the_first_distance(length, points):
    motion = steady(5.0, speed=length / 5.0)
    assert aic_score(motion, PLUGGED).path == pytest.approx(points)


def test_force_costs_only_where_it_lasts():
    assert aic_score(steady(0.99, force=21.0), PLUGGED).force == 0.0
    assert aic_score(steady(1.1, force=21.0), PLUGGED).force == -12.0
    assert aic_score(steady(9.0, force=19.0), PLUGGED).force == 0.0


def test_part_way_in_has_part_of_the_points_and_beside_has_none():
    half = PLUGGED._replace(success=False, depth=0.00675)
    assert aic_score(steady(5.0), half).insertion == pytest.approx(44.0)
    beside = half._replace(is_inside=False)
    points = aic_score(steady(5.0), beside)
    assert points.total() == 1.0
    assert aic_score(steady(5.0), beside._replace(touched=True)).total() == -23.0
