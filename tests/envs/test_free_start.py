"""Starts inside the fixture: refused where given, drawn again where drawn."""

from typing import ClassVar

import gymnasium as gym
import numpy as np
import pytest

from dovetail.envs.free_start import OVERLAP_MAX, OverlapError, StartError
from dovetail.envs.registered import make_env
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.workcell.workcell import START_MARGIN
from extras import need

HOLE = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
BESIDE = np.array([0.03, 0.0, 0.0])
"""From the hole's middle to the block's top face [m]."""


def start_at(env, offset):
    """The configuration with the peg's end at an offset from the hole's mouth."""
    robot = env.unwrapped.arm.facts.robot
    pose = Pose(HOLE.position + offset, tool_down(0.0))
    return robot.inverse_kinematics(pose, robot.posture("down"))


@pytest.fixture(params=["mujoco", "bullet"])
def env(request):
    if request.param == "bullet":
        need("pybullet")
    env = gym.make("dovetail/PegInHole-v0", plant=request.param)
    yield env
    env.close()


@pytest.mark.parametrize("depth", [0.0005, 0.012])
def test_a_start_in_the_block_is_refused_by_its_depth(env, depth):
    q = start_at(env, BESIDE - [0.0, 0.0, depth])
    with pytest.raises(OverlapError) as error:
        env.reset(seed=0, options={"fixture": HOLE, "start": q})
    assert error.value.overlap.depth == pytest.approx(depth, abs=1e-5)
    assert error.value.overlap.part == "peg"
    assert "of the " in error.value.overlap.other


@pytest.mark.parametrize(
    "offset", [(0.03, 0.0, 1e-4), (0.03, 0.0, -1e-4), (0.0, 0.0, -0.02)]
)
def test_a_start_that_touches_or_is_in_the_hole_is_free(env, offset):
    env.reset(seed=0, options={"fixture": HOLE, "start": start_at(env, offset)})
    force = env.step(np.zeros(4, dtype=np.float32))[4]["contact_force_max"]
    assert force < 60.0


class Careless(PegInHole):
    """Draws every second start from inside of the block."""

    count: ClassVar[list[int]] = [0]
    every: ClassVar[int] = 2

    def draw_start(self, rng, fixture):
        self.count[0] += 1
        is_bad = self.count[0] % self.every != 0
        z = -0.011 if is_bad else 0.03
        return Pose(fixture.position + BESIDE + [0, 0, z], tool_down(0.0))


def test_a_start_is_drawn_again_until_it_is_free():
    env = make_env(Careless)
    for seed in range(3):
        _, info = env.reset(seed=seed)
        assert info["position_error"][2] > 0.05
    env.close()


def test_a_task_that_never_draws_free_air_is_an_error():
    env = make_env(type("Hopeless", (Careless,), {"every": 1_000_000}))
    with pytest.raises(StartError, match="Hopeless") as error:
        env.reset(seed=0)
    cause = error.value.__cause__
    assert isinstance(cause, OverlapError)
    assert cause.overlap.depth > 50 * OVERLAP_MAX
    env.close()


@pytest.mark.parametrize("place", [(0.6, 0.12, 0.1), (0.72, 0.0, 0.1)])
def test_a_start_behind_a_wall_or_out_of_reach_is_drawn_again(place):
    env = gym.make("dovetail/PegInHole-v0")
    low, high = env.unwrapped.cell.walls
    hole = Pose(np.array(place), quat_about_z(0.0))
    for seed in range(30):
        env.reset(seed=seed, options={"fixture": hole})
        at = env.unwrapped.state.tool.position
        assert np.all(at > np.add(low, 0.9 * START_MARGIN))
        assert np.all(at < np.subtract(high, 0.9 * START_MARGIN))
    env.close()
