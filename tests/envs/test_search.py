"""The spiral search: where it leads, when it waits, and that a policy finds by it."""

import math

import numpy as np
import pytest

from dovetail.arms.arm import ArmState
from dovetail.poses import (
    TOOL_DOWN,
    Pose,
    quat_about_z,
    quat_multiply,
    theta_about_vertical,
)
from dovetail.trackers.covered import Covered
from dovetail.trackers.spiral import SearchConfig, SpiralSearch
from dovetail.trackers.truth import Truth

HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.4))


def state(stamp, position):
    nothing = np.zeros(7)
    quat = quat_multiply(HOLE.quat_wxyz, TOOL_DOWN)
    return ArmState(
        stamp, nothing, nothing, np.asarray(position), quat,
        np.zeros(6), np.zeros(3), 0, np.empty((0, 0)),
    )  # fmt: skip


def follow(search, steps, height=0.0, start=0.0):
    """A peg that is always at the spiral's point, at a height; return the points."""
    points = []
    for i in range(1, steps + 1):
        local = search.point() * [1, 1, 0] + [0, 0, height]
        c, s = math.cos(0.4), math.sin(0.4)
        turned = [c * local[0] - s * local[1], s * local[0] + c * local[1], local[2]]
        world = HOLE.position + np.array(turned)
        search.update(HOLE, state(start + 0.05 * i, world))
        points.append(search.point())
    return np.array(points)


@pytest.fixture
def search():
    search = SpiralSearch(Covered(), SearchConfig(reach=0.01))
    search.reset(HOLE, 0)
    return search


def test_the_spiral_comes_closer_to_every_place_than_the_clearance(search):
    points = follow(search, 1980)[:, :2]  # 0.2 mm each: as far as 10 mm away
    rng = np.random.default_rng(0)
    for _ in range(200):
        angle, r = rng.uniform(-np.pi, np.pi), 0.0093 * math.sqrt(rng.uniform())
        place = r * np.array([math.cos(angle), math.sin(angle)])
        nearest = np.linalg.norm(points - place, axis=1).min()
        assert nearest <= 0.00045


def test_the_spiral_keeps_its_speed(search):
    points = follow(search, 1000)[100:, :2]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(steps, 0.05 * search.config.speed, rtol=0.05)


def test_beyond_its_reach_it_begins_again_between_the_turns(search):
    points = follow(search, 2100)[:, :2]
    radius = np.linalg.norm(points, axis=1)
    assert radius.max() <= 0.01 + 1e-9
    again = int(np.argmax(np.diff(radius) < -0.005)) + 1
    first, second = points[0], points[again + 1]
    np.testing.assert_allclose(second, -first, atol=2e-4)


def test_nothing_moves_before_the_peg_stands_on_the_surface(search):
    follow(search, 50, height=0.02)
    np.testing.assert_array_equal(search.point()[:2], np.zeros(2))
    believed = search.estimate().pose.position - HOLE.position
    np.testing.assert_allclose(believed, [0.0, 0.0, -search.config.press])
    follow(search, 5, start=2.5)
    assert np.linalg.norm(search.point()[:2]) > 1e-4


def test_a_start_beside_the_block_is_not_the_hole(search):
    beside = HOLE.position + np.array([0.09, 0.0, -0.02])
    search.update(HOLE, state(0.05, beside))
    believed = search.estimate().pose.position - HOLE.position
    np.testing.assert_allclose(believed, [0.0, 0.0, -search.config.press])


def test_where_the_peg_drops_the_hole_is_believed_and_stays(search):
    points = follow(search, 200)
    tip = HOLE.position + np.array([0.002, 0.001, -0.001])
    search.update(HOLE, state(10.05, tip))
    np.testing.assert_allclose(search.estimate().pose.position[:2], tip[:2])
    deep = tip - [0.0, 0.0, 0.005]
    for i in range(100):
        search.update(HOLE, state(10.1 + 0.05 * i, deep))
    np.testing.assert_allclose(search.estimate().pose.position[:2], deep[:2])
    np.testing.assert_array_equal(search.point(), points[-1])


def test_a_dent_that_is_no_hole_is_left_after_a_second(search):
    follow(search, 200)
    before = search.point()
    tip = HOLE.position + np.array([0.0, 0.0, -0.0005])
    for i in range(20):
        search.update(HOLE, state(10.05 + 0.05 * i, tip))
    np.testing.assert_array_equal(search.point(), before)
    for i in range(20):
        search.update(HOLE, state(11.05 + 0.05 * i, tip))
    assert np.linalg.norm(search.point() - before) > 1e-4


def test_a_peg_that_does_not_follow_is_waited_for_and_then_not(search):
    follow(search, 400)
    before = search.point()
    stuck = HOLE.position + np.array([0.009, 0.009, 0.0])
    for i in range(10):
        search.update(HOLE, state(20.05 + 0.05 * i, stuck))
    np.testing.assert_array_equal(search.point(), before)
    for i in range(10):
        search.update(HOLE, state(20.55 + 0.05 * i, stuck))
    assert np.linalg.norm(search.point() - before) > 1e-4


def test_the_believed_hole_turns_against_what_the_peg_is_turned_by(search):
    turned = quat_multiply(quat_about_z(0.02), quat_multiply(HOLE.quat_wxyz, TOOL_DOWN))
    for i in range(40):
        search.update(
            HOLE, state(0.05 * (i + 1), HOLE.position)._replace(quat_wxyz=turned)
        )
    believed = search.estimate().pose.quat_wxyz
    turn = theta_about_vertical(believed, HOLE.quat_wxyz)
    assert turn == pytest.approx(-0.02 * 40 * 0.05, abs=2e-3)
    for i in range(100):
        search.update(
            HOLE, state(0.05 * (i + 41), HOLE.position)._replace(quat_wxyz=turned)
        )
    believed = search.estimate().pose.quat_wxyz
    turn = theta_about_vertical(believed, HOLE.quat_wxyz)
    assert turn == pytest.approx(-search.config.turn_max)


def test_a_tracker_that_sees_is_left_alone():
    search = SpiralSearch(Truth())
    search.reset(HOLE, 0)
    follow(search, 50)
    np.testing.assert_array_equal(search.estimate().pose.position, HOLE.position)
    assert search.estimate().age == 0.0


def test_reset_begins_in_the_middle(search):
    follow(search, 100)
    search.reset(HOLE, 0)
    np.testing.assert_array_equal(search.point()[:2], np.zeros(2))
    np.testing.assert_array_equal(search.estimate().pose.position, HOLE.position)


def test_less_clearance_is_searched_more_finely():
    fine, usual = SearchConfig.for_clearance(0.00025), SearchConfig.for_clearance(5e-4)
    assert usual == SearchConfig()
    assert (fine.speed, fine.pitch) == (usual.speed / 2, usual.pitch / 2)
