"""Hooked over one lip, turned and pushed, the component snaps on, and stays on."""

from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from rich.console import Console

from cockpit.conftest import from_benchmarks
from dovetail.envs.log_facts import part_columns
from dovetail.envs.registered import make
from dovetail.episode import Episode
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.plants.plant import DynamicsConfig
from dovetail.poses import Pose
from dovetail.tasks.rail_clip.din_rail import (
    HOLD,
    HOOK,
    OUTER,
    OVERLAP,
    SHEET,
    SLOPE_IN,
    SLOPE_OUT,
    WIDTH,
)
from dovetail.tasks.rail_clip.task import RailClip
from dovetail.tasks.rail_clip.way import (
    AROUND,
    BEHIND,
    TURNED_IN,
    hook_edge,
    is_hooked,
    left_on_the_way,
)
from extras import need
from wedge import snap_force

clip_pull = from_benchmarks("clip_pull")

GAIN = 60.0  # action per metre


def snap_on(info, theta_range):
    """The whole motion as a law of where the component is."""
    error, theta = info["position_error"], info["theta_error"]
    aside, depth = hook_edge(error, theta)
    if depth > SHEET and aside < WIDTH / 2.0 + 0.0002:
        is_beside = error[1] > 0.0008 and theta < -0.12
        push = GAIN * (0.0017 - depth) if is_beside else 1.0
        back = -GAIN * error[1] - (0.3 if error[1] > 0.0 else 0.0)
        action = push, back, -TURNED_IN if is_beside else 0.0
    elif depth > SHEET:
        action = GAIN * (0.0019 - depth), -0.4, -TURNED_IN
    else:
        beside = AROUND[0] - aside
        into = AROUND[1] if abs(beside) < 0.0005 else -0.006
        action = GAIN * (into - depth), GAIN * beside, -TURNED_IN
    x, y, turn = action
    return np.clip([x, y, turn / theta_range], -1.0, 1.0).astype(np.float32)


def play(env, seed, law):
    """Return the last info of a try, and the latch's position after each step."""
    _, info = env.reset(seed=seed)
    core, moved = env.unwrapped, []
    while True:
        _, _, ended, cut, info = env.step(law(info, core.config.theta_range))
        moved.append(float(core.state.parts[0]))
        if ended or cut:
            return info, np.array(moved)


def pull(env, force):
    """Return what the rail bears [N] and how far out the component comes [m]."""
    core = env.unwrapped
    return clip_pull.pull(core, core.arm.plant, force)


def latch_of(env):
    """Return the latch's position now [m]."""
    return env.unwrapped.arm.plant.part_positions()[0]


@pytest.fixture
def env():
    with closing(make("dovetail/RailClip-v0", max_steps=120)) as made:
        yield made


def test_gymnasium_makes_the_rail_clip_and_it_passes_check_env():
    env = gym.make("dovetail/RailClip-v0")
    check_env(env.unwrapped)
    assert env.action_space.shape == (3,)
    assert part_columns(env) == ("slide_latch",)
    env.close()


@pytest.mark.parametrize(
    ("engine", "seeds"),
    [
        ("mujoco", (0, 1, 2, 3)),
        pytest.param("bullet", (0,), marks=pytest.mark.bullet),
    ],
)
def test_a_component_snaps_on_and_bears_a_pull_of_20_newton(engine, seeds):
    if engine == "bullet":
        need("pybullet")
    made = make("dovetail/RailClip-v0", max_steps=120, plant=engine)
    with closing(made) as env:
        for seed in seeds:
            info, latch = play(env, seed, snap_on)
            assert info["success"], seed
            assert latch.max() > 0.5 * OVERLAP  # it was pushed aside, and came back
            assert latch[-1] < 0.25 * OVERLAP
            assert info["limit_violations"] == 0
            borne, out = pull(env, 20.0)
            assert borne == pytest.approx(20.0, abs=2.0)
            assert out < clip_pull.OFF
            assert latch_of(env) < 0.6 * OVERLAP


def test_it_comes_off_at_the_force_of_its_spring(env):
    """Half of a pull in the middle is at the latch, half at the hook."""
    off = 2.0 * snap_force(DynamicsConfig().contact_friction, SLOPE_OUT)
    for share, comes_off in ((0.85, False), (1.15, True)):
        assert play(env, 0, snap_on)[0]["success"]
        assert (pull(env, share * off)[1] > clip_pull.OFF) is comes_off


def test_a_straight_push_does_not_snap_it_on(env):
    def push(info, theta_range):
        beside = GAIN * info["position_error"][1]
        return np.clip([1.0, -beside, 0.0], -1.0, 1.0).astype(np.float32)

    info, latch = play(env, 0, push)
    assert not info["success"]
    assert info["depth"] < -0.002
    assert latch.max() < 0.5 * OVERLAP


def test_the_shipped_policy_snaps_it_on_and_the_log_shows_it(tmp_path):
    config = EvaluationConfig(
        policy="rail_clip", plant="mujoco", period=0.005, tries=1, out=tmp_path / "out"
    )
    result = evaluate(config, Console(quiet=True))
    assert [outcome.success for outcome in result.outcomes] == [True] * 3
    for outcome in result.outcomes:
        log = Episode.load(result.folder / "logs" / outcome.files.log)
        latch = log["slide_latch"]
        over = int(latch.argmax())
        assert latch[over] > 0.7 * OVERLAP  # its nose goes over the lip
        assert latch[-1] < 0.25 * OVERLAP
        force = np.stack([log[name] for name in ("fx", "fy", "fz")], axis=1)
        assert np.linalg.norm(force[over]) > 0.5 * snap_force(0.0, SLOPE_IN)


@pytest.mark.parametrize(
    ("moved", "latch", "is_on"),
    [
        ((0.0, 0.0, 0.0), 0.0, True),
        ((0.0, 0.0, 0.0), OVERLAP, False),  # its nose lies on the lip
        ((-0.002, 0.0, 0.0), 0.0, False),
        ((0.0, 0.002, 0.0), 0.0, False),
        ((0.0, 0.0, 0.002), 0.0, False),
    ],
)
def test_it_is_on_where_it_is_seated_and_the_latch_is_behind_its_lip(
    env, moved, latch, is_on
):
    env.reset(seed=0)
    core, task = env.unwrapped, RailClip()
    goal = task.goal(core.fixture)
    tool = core.state.tool._replace(quat_wxyz=goal.quat_wxyz)
    state = core.state._replace(tool=tool, parts=np.array([latch]))
    assert task.judge(np.array(moved), goal, state).success is is_on
    unknown = state._replace(parts=np.zeros(0))
    assert task.judge(np.array(moved), goal, unknown).success == (not any(moved))


def test_on_the_rail_the_hook_is_behind_its_lip():
    aside, depth = hook_edge(np.zeros(3), 0.0)
    assert (aside, depth) == pytest.approx((OUTER - HOOK, HOLD))
    assert is_hooked(np.zeros(3), 0.0)
    assert not is_hooked(np.array([-0.004, 0.0, 0.0]), 0.0)  # it stands on the lip
    assert not is_hooked(np.array([0.0, 0.003, 0.0]), 0.0)  # it is beside the lip


def test_the_way_leads_around_the_lip_and_then_to_the_goal():
    at = np.array([-0.03, 0.004, 0.0])
    left, turn = left_on_the_way(at, -0.1)
    assert turn == pytest.approx(TURNED_IN - 0.1)
    aside, depth = hook_edge(at, -0.1)
    way = np.array([depth - AROUND[1], aside - AROUND[0], 0.0])
    assert np.linalg.norm(left) == pytest.approx(np.linalg.norm(way) + BEHIND)
    assert np.linalg.norm(np.cross(left, way)) == pytest.approx(0.0, abs=1e-12)
    hooked = np.array([-0.004, 0.0008, 0.0])
    assert is_hooked(hooked, -TURNED_IN)
    left, turn = left_on_the_way(hooked, -TURNED_IN)
    np.testing.assert_array_equal(left, hooked)
    assert turn == -TURNED_IN


def test_the_reward_is_for_the_hook_and_not_for_the_goals_distance(env):
    task = RailClip()
    nearer = np.array([-0.0039, 0.0, 0.0])  # straight, its hook stands on the lip
    hooked = np.array([-0.0042, 0.0008, 0.0])
    assert np.linalg.norm(nearer) < np.linalg.norm(hooked)
    on_lip = task.weigh(nearer, 0.0, False, 0.0)
    assert on_lip < task.weigh(hooked, -TURNED_IN, False, 0.0)


def test_a_rail_in_a_cells_region_faces_the_robot(env):
    fixture = RailClip().draw_fixture(np.random.default_rng(0))
    start = RailClip().draw_start(np.random.default_rng(0), fixture)
    assert isinstance(start, Pose)
    away = fixture.position - start.position
    assert away[0] > 0.0
    assert away[2] == 0.0
