"""A camera on the flange looks from above the fixture, and the arm then goes on."""

from pathlib import Path

import numpy as np
import pytest

from dovetail.envs.pre_grasp_view import LOOKOUT
from dovetail.envs.registered import make_env
from dovetail.errors import TrackerError
from dovetail.perceive.camera import load_camera
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.trackers.marker import MarkerTracker

EXAMPLE = Path(__file__).parents[2] / "examples" / "flange.toml"


def test_the_arm_looks_from_above_before_it_goes_to_its_start(opengl, monkeypatch):
    env = make_env(PegInHole, tracker=str(EXAMPLE))
    robot, resets, go = env.arm.facts.robot, [], env.arm.reset

    def reset(q, fixture):
        resets.append(robot.tool_pose(q).position)
        return go(q, fixture)

    monkeypatch.setattr(env.arm, "reset", reset)
    for seed in (3, 4):
        env.reset(seed=seed)
        lookout, start = resets[-2:]
        above = lookout - env.fixture.position
        assert np.abs(above[:2]).max() < 1e-3
        assert 0.12 < above[2] <= LOOKOUT + 1e-3
        assert start[2] < lookout[2]
        gap = env.believed.position - env.fixture.position
        assert np.linalg.norm(gap) < 1e-3
        for _ in range(3):
            env.step(np.zeros(4, dtype=np.float32))
        assert np.linalg.norm(env.believed.position - env.fixture.position) < 1e-3
        assert 0.05 <= env.tracker.estimate().age < 1.0
    env.close()


def test_where_the_board_is_hidden_at_the_start_the_look_from_above_counts(
    opengl, monkeypatch
):
    env = make_env(PegInHole, tracker=str(EXAMPLE))
    rewind = env.tracker.rewind

    def blind(fixture):
        rewind(fixture)
        monkeypatch.setattr(env.tracker.source, "look", lambda fixture, state: None)

    monkeypatch.setattr(env.tracker, "rewind", blind)
    env.reset(seed=5)
    for _ in range(4):
        env.step(np.zeros(4, dtype=np.float32))
    assert np.linalg.norm(env.believed.position - env.fixture.position) < 1e-3
    assert env.tracker.estimate().age >= 0.2
    env.close()


def test_a_camera_that_is_unplugged_while_it_looks_stops_the_arm(monkeypatch):
    class Unplugged:
        def reset(self, fixture, seed):
            return None

        def look(self, fixture, state):
            raise TrackerError("unplugged")

        def close(self):
            pass

    env = make_env(PegInHole)
    env.tracker = MarkerTracker(load_camera(EXAMPLE), Unplugged(), env.cell.robot)
    stopped = []
    monkeypatch.setattr(env.arm, "stop", lambda: stopped.append(True))
    with pytest.raises(TrackerError, match="unplugged"):
        env.reset(seed=0)
    assert stopped == [True]
    env.close()
