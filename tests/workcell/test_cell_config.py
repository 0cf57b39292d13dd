"""A cell file: what it gives is the cell's, what it leaves out is the task's own."""

import math
import re
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from dovetail.envs.registered import find_cell, make_env
from dovetail.errors import ConfigError
from dovetail.robots.iiwa14 import iiwa14
from dovetail.settings import names_in
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.rail_clip.task import RailClip
from dovetail.tasks.region import Region
from dovetail.workcell.cell_config import CellConfig, cell_of, load_cell
from dovetail.workcell.tool import Tool

ASIDE = {
    "table_height": 0.05,
    "tool_length": 0.22,
    "walls_low": [0.35, -0.25, 0.08],
    "walls_high": [0.80, 0.32, 0.36],
    "fixture_low": [0.50, 0.10, 0.135],
    "fixture_high": [0.60, 0.18, 0.15],
    "fixture_yaw": [0.2, 0.8],
}
"""A higher table, a longer tool, and holes to the left."""
TODAY = CellConfig(
    fixture_low=(0.55, -0.05, 0.08),
    fixture_high=(0.65, 0.05, 0.12),
    fixture_yaw=(-0.3, 0.3),
)
"""The region from which the peg task draws by itself."""


def placed(task, cell):
    """Return the trial poses of a task as they lie in a cell file's region."""
    return task.trial_poses_in(cell.fit(find_cell()))


def write(folder, text):
    file = folder / "cell.toml"
    file.write_text(text)
    return file


def test_an_empty_file_changes_nothing(tmp_path):
    cell, usual = find_cell(cell=load_cell(write(tmp_path, ""))), find_cell()
    for name in ("name", "walls", "table", "starts", "own"):
        assert vars(cell)[name] == vars(usual)[name], name
    assert cell.payload().mass == usual.payload().mass
    assert cell.tool.length == usual.tool.length


def test_each_key_reaches_the_cell():
    cell, usual = find_cell(cell=cell_of(ASIDE)), find_cell()
    assert cell.table.corners[:, 2].max() == pytest.approx(0.05)
    assert cell.tool.length == 0.22
    assert cell.walls == (tuple(ASIDE["walls_low"]), tuple(ASIDE["walls_high"]))
    assert cell.payload().mass == pytest.approx(usual.payload().mass)
    heavy = find_cell(cell=CellConfig(tool_mass=2.2))
    assert heavy.payload().mass == pytest.approx(usual.payload().mass + 1.0)
    small = find_cell(cell=CellConfig(table_centre=(0.5, 0.1), table_size=(0.4, 0.6)))
    assert small.table.corners.min(axis=0) == pytest.approx([0.3, -0.2, -0.1])
    assert small.table.corners.max(axis=0) == pytest.approx([0.7, 0.4, 0.0])


def test_a_bare_flange_holds_the_part_by_a_holder_of_that_length_and_mass():
    cell = find_cell(cell=CellConfig(tool="none", tool_length=0.10, tool_mass=0.3))
    (holder,) = cell.tool.primitives
    assert holder.mass == 0.3
    assert holder.size[1] * 2.0 == pytest.approx(0.10 - 0.070)  # the peg's length
    arm = cell.loaded_robot()
    flange = cell.robot.tool_pose(arm.posture("down"))
    tip = arm.tool_pose(arm.posture("down"))
    assert np.linalg.norm(tip.position - flange.position) == pytest.approx(0.10)


def test_todays_region_gives_todays_trial_poses_and_holes():
    for task in (PegInHole, RailClip):
        region = task.trial_region
        cell = replace(
            TODAY,
            fixture_low=region.low,
            fixture_high=region.high,
            fixture_yaw=region.yaw,
        )
        for own, there in zip(task.trial_poses, placed(task(), cell), strict=True):
            assert there[1:5] == pytest.approx(own[1:5], abs=1e-12)
            assert there.facing == own.facing
    drawn = PegInHole().draw_fixture(np.random.default_rng(3))
    again = PegInHole().draw_in(
        np.random.default_rng(3), Region.of(TODAY.fit(find_cell()))
    )
    np.testing.assert_allclose(again.position, drawn.position, atol=1e-12)
    np.testing.assert_allclose(again.quat_wxyz, drawn.quat_wxyz, atol=1e-12)


@pytest.mark.parametrize("task", [PegInHole, RailClip])
def test_trial_poses_and_draws_lie_in_the_region(task):
    region = Region((0.5, 0.1, 0.135), (0.6, 0.18, 0.15), (0.2, 0.8))
    cell = cell_of({k: v for k, v in ASIDE.items() if k.startswith("fixture")})
    poses = placed(task(), cell)
    assert len({pose[1:5] for pose in poses}) == 3
    low, high = (*region.low, region.yaw[0]), (*region.high, region.yaw[1])
    for pose in poses:
        assert all(a <= x <= b for a, x, b in zip(low, pose[1:5], high, strict=True))
    rng, facing = np.random.default_rng(0), poses[0].facing
    turns = []
    for _ in range(200):
        position, quat = task().draw_in(rng, region)
        assert (position >= region.low).all()
        assert (position <= region.high).all()
        if facing == (1.0, 0.0, 0.0, 0.0):
            turns.append(2.0 * math.atan2(quat[3], quat[0]))
    assert not turns or (0.2 <= min(turns) < 0.25 and 0.75 < max(turns) <= 0.8)


def test_a_region_of_one_place_is_one_place():
    place = {"fixture_low": [0.55, 0.0, 0.1], "fixture_high": [0.55, 0.0, 0.1]}
    cell = cell_of({**place, "fixture_yaw": [0.4, 0.4]})
    region = Region.of(cell.fit(find_cell()))
    assert region.is_one_place
    assert {p[1:5] for p in placed(PegInHole(), cell)} == {(0.55, 0.0, 0.1, 0.4)}
    np.testing.assert_allclose(find_cell(cell=cell).place.position, [0.55, 0.0, 0.1])
    assert len(region.corners((1.0, 0.0, 0.0, 0.0))) == 1


def test_what_is_written_is_what_is_read():
    cell = cell_of(ASIDE)
    assert cell_of(cell.table()) == cell
    assert set(cell.table()) == set(ASIDE)
    assert CellConfig().table() == {}
    assert all(name in cell.describe() for name in ASIDE)


BAD = [
    ({"table_hight": 0.1}, "table_hight"),
    ({"table_height": "50 mm"}, "table_height"),
    ({"table_height": float("nan")}, "table_height"),
    ({"table_height": 50}, "table_height"),
    ({"table_height": True}, "table_height"),
    ({"walls_low": 0.3}, "walls_low"),
    ({"walls_low": [0.3, 0.0]}, "walls_low"),
    ({"walls_low": [0.3, 0.0, "0.1"]}, "walls_low[z]"),
    ({"walls_low": [0.3, 0.0, float("inf")]}, "walls_low[z]"),
    ({"walls_low": [0.9, -0.1, 0.1], "walls_high": [0.8, 0.1, 0.3]}, "walls_low[x]"),
    ({"walls_low": [0.8, -0.1, 0.1], "walls_high": [0.8, 0.1, 0.3]}, "walls_low[x]"),
    ({"tool": "schunk"}, "tool"),
    ({"tool": "none"}, "tool_length"),
    ({"tool": "none", "tool_length": 0.1}, "tool_mass"),
    ({"tool_length": 2.0}, "tool_length"),
    ({"tool_opening": 0.2}, "tool_opening"),
    ({"fixture_low": [0.5, 0.0, 0.1]}, "fixture_high"),
    ({"fixture_yaw": [0.0, 0.1]}, "fixture_low"),
    (
        {
            "fixture_low": [0.5, 0.0, 0.1],
            "fixture_high": [0.6, 0.0, 0.1],
            "fixture_yaw": [0.3, -0.3],
        },
        "fixture_yaw",
    ),
    ({"start_low": [0.5, 0.0, 0.1]}, "start_high"),
]
"""Files that are wrong by themselves, and the key that the error names."""


@pytest.mark.parametrize(("table", "name"), BAD)
def test_a_wrong_key_or_value_is_named(table, name):
    with pytest.raises(ConfigError) as error:
        cell_of(table)
    assert error.value.name == name


@pytest.mark.parametrize("table", [None, 3, "cell.toml", [1, 2], [["a", 1]]])
def test_a_file_of_another_kind_is_refused(table):
    with pytest.raises(ConfigError):
        cell_of(table)


BESIDE_THE_TASK = [
    ({"walls_low": [0.85, -0.2, 0.03]}, "walls_low[x]"),  # beyond the task's own
    ({"table_height": 0.2}, "walls_low[z]"),
    ({"walls_low": [0.62, -0.22, 0.03]}, "walls_low[x]"),  # without its trial poses
    ({"start_low": [0.3, 0.0, 0.1], "start_high": [0.7, 0.1, 0.2]}, "start_low[x]"),
    ({"tool_opening": 0.02}, "tool_opening"),  # of a peg of 30 mm
    ({"tool_length": 0.10}, "tool_length"),
    ({"tool_mass": 0.05}, "tool_mass"),
    ({"tool": "none", "tool_length": 0.06, "tool_mass": 0.1}, "tool_length"),
]
"""Cells in which the peg task cannot be done, and the key that the error names."""


@pytest.mark.parametrize(("table", "name"), BESIDE_THE_TASK)
def test_a_cell_that_excludes_the_task_is_refused(table, name):
    with pytest.raises(ConfigError) as error:
        find_cell(cell=cell_of(table))
    assert error.value.name == name


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"table_height": 0.1, "walls_low": [0.38, -0.22, 0.13]}, "inside the table"),
        ({"tool_length": 0.9}, "tool of 0.9 m"),  # longer than the reach
        (
            {
                "fixture_low": [0.9, 0.0, 0.1],
                "fixture_high": [0.95, 0.0, 0.1],
                "fixture_yaw": [0.0, 0.0],
                "walls_high": [1.2, 0.22, 0.3],
            },
            "too far",
        ),
    ],
)
def test_fixtures_in_the_table_or_out_of_reach_are_refused(table, words):
    with pytest.raises(ConfigError, match=words):
        find_cell(cell=cell_of(table))


def test_a_tool_too_heavy_for_the_arm_is_refused_with_the_joint():
    cell = CellConfig(tool_length=0.20, tool_mass=28.0)
    with pytest.raises(ConfigError, match=r"A\d"):
        make_env(PegInHole, cell=cell)


@dataclass(frozen=True, kw_only=True)
class Magnet(PegInHole):
    """A task with a tool of its own."""

    done_word: ClassVar[str] = "held"

    def tool(self):
        own = super().tool()
        return Tool(
            name="magnet",
            primitives=own.primitives,
            length=own.length,
            rotation=own.rotation,
        )


def test_the_tool_of_a_tasks_own_is_kept_or_replaced_but_not_bent():
    robot = iiwa14()
    kept = Magnet().workcell(robot, TODAY)
    assert kept.tool.name == "magnet"
    with pytest.raises(ConfigError, match="magnet"):
        Magnet().workcell(robot, CellConfig(tool_length=0.2))
    bare = CellConfig(tool="none", tool_length=0.12, tool_mass=0.4)
    assert Magnet().workcell(robot, bare).tool.name == "bare flange"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("table_height = ", "TOML"),
        ("a" * 400_000, "bytes"),
        ("[table]\nz = 1", "table"),
    ],
)
def test_an_unreadable_file_is_named(content, words, tmp_path):
    file = write(tmp_path, content)
    with pytest.raises(ConfigError, match=words) as error:
        load_cell(file)
    assert str(file) in str(error.value)
    with pytest.raises(ConfigError, match="no cell file"):
        load_cell(tmp_path / "missing.toml")


def test_the_page_has_the_example_and_every_key():
    root = Path(__file__).parents[2]
    page = (root / "docs" / "your-own-cell.md").read_text()
    (block,) = re.findall(r"```toml\n(.*?)```", page, re.S)
    example = load_cell(root / "examples" / "cell.toml")
    assert cell_of(tomllib.loads(block)) == example
    rows = re.findall(r"^\| (`.*?) \|", page, re.M)
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == set(
        names_in(CellConfig)
    )
    find_cell(cell=example)
