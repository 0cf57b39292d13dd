"""The day that docs/real-robot.md describes, played from its own start pose.

A simulated cabinet stands for the robot: in lockstep, which is quicker, and in the
place of the page's ports.
"""

import re
import shlex
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from arms.loopback import LOOPBACK, free_port, make_cabinet
from dovetail.arms import fri_arm
from dovetail.arms.address import parse_address
from dovetail.arms.start_distance import FARTHEST, FARTHEST_TURN
from dovetail.cli import run
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.envs.registered import find_cell
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z, tool_down

PAGE = (Path(__file__).parents[1] / "docs" / "real-robot.md").read_text()
_START = re.search(r"tool down over the table, for example ([-\d, ]+) deg", PAGE)


def commands(name):
    """Yield the words of each such command on the page, in their order."""
    for block in re.findall(r"```bash\n(.*?)```", PAGE, re.S):
        for line in re.sub(r"\\\n\s*", " ", block).splitlines():
            words = shlex.split(line)
            if words[:2] == ["dovetail", name]:
                yield words[1:]


@pytest.fixture
def ways(monkeypatch):
    """How far each start was from where the arm stood: tool [m], joints [rad]."""
    found, check = [], fri_arm.require_near

    def record(robot, q, q_start, left):
        here, there = (robot.tool_pose(each).position for each in (q, q_start))
        found.append((np.linalg.norm(here - there), np.abs(q - q_start).max()))
        check(robot, q, q_start, left)

    monkeypatch.setattr(fri_arm, "require_near", record)
    return found


def assert_near(ways):
    """The first start is as near as the page says."""
    if ways:  # a simulated arm may be placed instead
        near = re.search(r"at most ([\d.]+) m and ([\d.]+) rad of any joint away", PAGE)
        assert ways[0][0] <= float(near[1])
        assert ways[0][1] <= float(near[2])


def start_pose():
    """The page's start pose [rad]."""
    return np.deg2rad([float(part) for part in _START[1].split(",")])


@contextmanager
def robot(words):
    """Run a cabinet at the start pose; yields the command's words with its address."""
    index = words.index("--arm") + 1
    address = parse_address(words[index])
    period = address.period or DEFAULT_PERIOD
    plant = make_twin(load_twin("medium"), find_cell())
    # the hole of the page's commands; a robot's is where it is
    hole = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
    plant.reset(start_pose(), hole)
    port = free_port()
    with make_cabinet(plant, port, period, clock="lockstep") as cabinet:
        text = f"fri://{LOOPBACK}:{port}?period={1e3 * period:g}ms&clock=lockstep"
        if address.control is not None:
            text += f"&control={cabinet.control_address}"
        text += f"&reset={address.reset}"
        yield [*words[:index], text, *words[index + 1 :]]
    plant.close()


def test_the_start_pose_holds_the_tool_down_and_free_over_the_hole():
    pose = find_cell().loaded_robot().tool_pose(start_pose())
    assert abs(pose.quat_wxyz @ tool_down(0.0)) > 0.9999
    assert pose.position[2] > 0.1 + 0.05


@pytest.mark.slow
@pytest.mark.parametrize("words", list(commands("doctor")), ids=" ".join)
def test_the_doctor_finds_nothing_wrong(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with robot([*words, *([] if "--yes" in words else ["--yes"])]) as played:
        assert run(played) == 0, capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [words for words in commands("evaluate") if "grpc://" not in " ".join(words)],
    ids=" ".join,
)
def test_an_evaluation_reaches_its_starts_and_inserts(
    words, ways, tmp_path, monkeypatch, capsys
):
    """The first start was farther away than a robot moves without being asked."""
    monkeypatch.chdir(tmp_path)
    few = [] if "--tries" in words else ["--tries", "3"]
    with robot([*words, *few]) as played:
        assert run(played) == 0
    assert re.search(r" (\d+)/\1 \1 inserted", capsys.readouterr().out)
    assert_near(ways)


@pytest.mark.slow
@pytest.mark.parametrize("words", list(commands("train")), ids=" ".join)
def test_training_reaches_its_first_start(words, ways, tmp_path, monkeypatch):
    pytest.importorskip("sbx")
    monkeypatch.chdir(tmp_path)
    few = {"--steps": "20", "--eval-episodes": "1"}
    pairs = zip(["", *words[:-1]], words, strict=True)
    words = [few.get(before, word) for before, word in pairs]
    with robot(words) as played:
        assert run(played) == 0
    assert_near(ways)


def test_the_distances_that_the_page_names_are_those_that_are_checked():
    assert f"{FARTHEST:g} m and {FARTHEST_TURN:g} rad of every joint" in PAGE
