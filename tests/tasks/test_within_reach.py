"""Fixtures stand where an arm reaches them: a short arm's are nearer, others' stay."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.envs.registered import find_cell, make_env
from dovetail.errors import ConfigError
from dovetail.robots.find import find_robot
from dovetail.robots.iiwa14 import iiwa14
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.rail_clip.task import RailClip
from dovetail.workcell.cell_config import CellConfig

TASKS = [PegInHole(), PegInHole(tilt=0.2), PegInHole(facing="robot"), RailClip()]


def short(share):
    """An iiwa whose links have this share of their length."""
    robot = iiwa14()
    at = replace(robot.geometry, origin_position=share * robot.geometry.origin_position)
    return replace(robot, name="short", geometry=at)


def short_own():
    return short(0.75)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("name", ["iiwa14", "fr3"])
def test_arms_that_reach_farther_have_the_tasks_own_places(task, name):
    cell = task.workcell(find_robot(name))
    assert cell.fixtures is None
    assert cell.walls == task.walls
    assert not cell.note
    assert task.trial_poses_in(cell) == task.trial_poses


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("share", [0.8, 0.75, 0.7, 0.6])
def test_a_short_arm_reaches_every_place_where_it_is_tried(task, share):
    cell = task.workcell(short(share))
    for place in task.trial_poses_in(cell):
        assert cell.out_of_reach(place.pose()) <= -0.06
    if cell.fixtures is None:
        return
    assert "short" in cell.note
    low, high = np.array(cell.fixtures[0]), np.array(cell.fixtures[1])
    moved = np.array(cell.walls) - task.walls
    assert moved[0] == pytest.approx(moved[1], abs=1e-9)
    assert moved[0][0] < 0.0  # towards the robot, along x alone
    assert moved[0][1:] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert (low > cell.walls[0]).all()
    assert (high < cell.walls[1]).all()


def test_a_file_that_gives_a_region_or_walls_is_kept():
    task, walls = PegInHole(), ((0.30, -0.22, 0.03), (0.70, 0.22, 0.30))
    region = CellConfig(
        fixture_low=(0.40, 0.0, 0.1),
        fixture_high=(0.42, 0.0, 0.1),
        fixture_yaw=(0.0, 0.0),
    )
    cell = task.workcell(short(0.75), region)
    assert cell.fixtures == (region.fixture_low, region.fixture_high, (0.0, 0.0))
    assert cell.walls == task.walls
    walled = CellConfig(walls_low=walls[0], walls_high=walls[1])
    cell = task.workcell(short(0.75), walled)
    assert cell.walls == walls
    assert cell.fixtures is not None


def test_an_arm_for_which_no_place_helps_is_refused_as_ever():
    cell = PegInHole().workcell(short(0.2))
    assert cell.fixtures is None
    with pytest.raises(ConfigError):
        cell.require_reachable(PegInHole().trial_poses[0].pose())


def test_fixtures_and_starts_are_drawn_within_reach():
    with make_env(PegInHole, robot=f"{__name__}:short_own", tare=True) as env:
        low, high = env.cell.fixtures[:2]
        for seed in range(10):
            env.reset(seed=seed)
            assert (env.fixture.position >= np.array(low) - 1e-12).all()
            assert (env.fixture.position <= np.array(high) + 1e-12).all()
            assert env.state.tool.position[0] < env.cell.walls[1][0]
    assert find_cell().fixtures is None
