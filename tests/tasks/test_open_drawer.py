"""The example's drawer: success by its joint, and by the tool's pose alone."""

import importlib.util
import math
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from dovetail import Pose, quat_about_z
from dovetail.poses import matrix_from_quat
from extras import need

EXAMPLE = Path(__file__).parents[2] / "examples" / "09_open_a_drawer.py"
FIXTURE = Pose(np.array([0.6, 0.01, 0.11]), quat_about_z(0.25))


@pytest.fixture(scope="module")
def drawer():
    """The example's module."""
    spec = importlib.util.spec_from_file_location("open_drawer", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def judged(task, error, parts=()):
    """Return progress with the TCP at an error [m] in the fixture's axes."""
    world = matrix_from_quat(FIXTURE.quat_wxyz) @ error
    state = SimpleNamespace(parts=np.array(parts))
    return task.judge(world, task.goal(FIXTURE), state)


def is_in_closed_plate(task, point):
    """Say whether a point of the fixture's frame lies in the closed drawer's plate."""
    boxes = task.fixture(0.0).moving[0].primitives
    return any((np.abs(point - box.position) < box.size).all() for box in boxes)


def test_where_the_tool_must_be_on_a_robot_a_closed_drawer_has_its_plate(drawer):
    task = drawer.OpenDrawer()
    rng, found = np.random.default_rng(0), 0
    for _ in range(5000):
        error = rng.uniform((-0.1, -0.1, -0.001), (0.1, 0.1, 0.02))
        if judged(task, error).success:
            found += 1
            assert is_in_closed_plate(task, error - [0.0, 0.0, drawer.DEEP])
    assert found > 50


@pytest.mark.parametrize(
    ("error", "parts", "success"),
    [
        ((-0.043, 0.0, 0.0), (), True),
        ((-0.039, 0.0, 0.0), (), False),
        ((-0.043, 0.0, 0.006), (), False),  # on the plate
        ((-0.070, 0.0, 0.0), (), False),  # beside it
        ((-0.043, 0.0, 0.0), (0.041,), True),
        ((-0.043, 0.0, 0.0), (0.039,), False),
        ((-0.043, 0.0, 0.006), (0.041,), False),  # dragged along
    ],
)
def test_success_is_an_open_drawer_with_the_bar_in_its_hole(
    drawer, error, parts, success
):
    assert judged(drawer.OpenDrawer(), error, parts).success is success


def test_the_reward_grows_on_the_way_into_the_hole_and_then_along(drawer):
    task = drawer.OpenDrawer()
    way = [(0.03, 0.02, 0.05), (0.0, 0.0, 0.02), (0.0, 0.0, 0.0), (-0.03, 0.0, 0.0)]
    rewards = [task.weigh(np.array(at), 0.0, False, 0.0) for at in way]
    assert rewards == sorted(rewards)
    assert task.weigh(np.array((-0.042, 0.0, 0.0)), 0.0, True, 0.0) == 50.0


@pytest.mark.parametrize(
    "plant", ["mujoco", pytest.param("bullet", marks=pytest.mark.bullet), "drake"]
)
def test_a_drawer_that_is_pulled_is_open_by_joint_and_by_pose(drawer, plant):
    if plant != "mujoco":
        need({"bullet": "pybullet", "drake": "pydrake"}[plant])
    with closing(gym.make("OpenDrawer-v0", plant=plant)) as env:
        core = env.unwrapped
        _, info = env.reset(seed=3)
        for _ in range(200):
            x, y, z = info["position_error"]
            is_in = z < drawer.DEEP - drawer.IN
            down = -0.3 if math.hypot(x, y) < 0.001 or z > 0.02 else 0.3
            action = [-1.0, 0.0, -0.1] if is_in else [-20.0 * x, -20.0 * y, down]
            *_, ended, cut, info = env.step(np.clip(action, -1, 1).astype(np.float32))
            if ended or cut:
                break
        assert info["success"]
        assert core.state.parts[0] == pytest.approx(info["depth"])
        told = core.task.judge(
            info["position_error"],
            core.task.goal(core.fixture),
            core.state._replace(parts=np.zeros(0)),
        )
        gap = 2.0 * core.task.clearance + 1e-3
        assert told.depth == pytest.approx(info["depth"], abs=gap)
