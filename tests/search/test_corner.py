"""The corner search: it finds what nobody sees, and asks for what it needs."""

import numpy as np
import pytest

from dovetail.envs import registered
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.poses import matrix_from_quat
from dovetail.search.corner import SEARCH_AXES, CornerSearch
from dovetail.search.corner_config import CornerSearchConfig
from dovetail.trackers.covered import Covered


def make(shift, **settings):
    """The environment of a search, its fixture moved by `shift` [m] unseen."""
    tracker = Covered()
    tracker.shift = np.array([*shift, 0.0])
    options = {
        "task": SEARCH_AXES,
        "near_speed": 0.05,
        "theta_range": 0.3,
        "max_steps": 300,
        "tracker": tracker,
    } | settings
    env = registered.make("dovetail/PegInHole-v0", **options)
    return env, require_contact_env(env)


def search(env, core, seed=3):
    """Search once; return the last info and the phases gone through."""
    actor = CornerSearch(core)
    observation, info = env.reset(seed=seed)
    phases = []
    while True:
        observation, _, ended, cut, info = env.step(actor(observation))
        phases.append(actor.phase)
        if ended or cut:
            return info, phases


@pytest.mark.parametrize("peg", ["square", "triangle", "round"])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.012, -0.016)])
def test_it_finds_a_fixture_that_was_moved_unseen(peg, shift):
    info, phases = search(*make(shift, peg=peg))
    assert info["success"]
    assert phases[0] == "go over"
    assert phases[-1] == "push"
    assert ("slide" in phases) == any(shift)


@pytest.mark.parametrize("peg", ["square", "triangle"])
@pytest.mark.parametrize("seed", [1, 5])  # the one turned left, the other right
def test_it_finds_a_fixture_that_is_turned_too(peg, seed):
    where = "late?delay=0.05&bias=0.005&turn=0.05"
    made = make((0.0, 0.0), peg=peg, tracker=where, twin="medium", tare=True)
    info, _ = search(*made, seed)
    assert info["success"]


def test_where_the_arm_may_not_be_quick_it_does_not_push_instead():
    env, core = make((0.012, -0.016), near_speed=0.02, max_steps=400)
    actor = CornerSearch(core)
    observation, _ = env.reset(seed=3)
    level = []  # f* while the corner slides, of 4 m/s2
    ended = cut = False
    while not (ended or cut):
        action = actor(observation)
        if actor.phase == "slide":
            level.append(np.hypot(action[0], action[1]))
        observation, _, ended, cut, _ = env.step(action)
    assert ended
    assert np.median(level) < 0.5  # 0.02 m/s needs 0.2, friction the rest


@pytest.mark.parametrize("clearance", [0.00006, 0.004])
def test_the_clearance_is_not_what_it_searches_for(clearance):
    info, _ = search(*make((0.0, 0.005), clearance=clearance, twin="medium", tare=True))
    assert info["success"]


def test_it_does_not_look_at_where_the_fixture_is():
    _, core = make((0.02, 0.0))
    env, _ = make((0.02, 0.0))
    del env
    actions = []
    for shift in ((0.02, 0.0), (0.0, 0.02)):
        env, core = make((0.0, 0.0))
        core.tracker.shift = np.array([*shift, 0.0])
        actor = CornerSearch(core)
        # The same fixture as seen, another true one, and nothing touched yet.
        seen = core.task.draw_fixture(np.random.default_rng(0))
        true = seen._replace(position=seen.position + core.tracker.shift)
        start = np.array([0.0, 0.5, 0.0, -1.2, 0.0, 1.4, 0.0])
        env.reset(seed=1, options={"fixture": true, "start": start})
        steps = []
        for _ in range(5):
            action = actor(np.zeros(0))
            steps.append(action)
            env.step(action)
        actions.append(steps)
    np.testing.assert_allclose(actions[0], actions[1], atol=1e-6)


@pytest.mark.parametrize("facing", ["up", "robot"])
def test_it_goes_in_along_the_axis_of_a_tilted_hole_and_turns_about_it(facing):
    env, core = make((0.0, -0.01), facing=facing, tilt=0.2)
    info, _ = search(env, core, seed=0)
    assert core.task.goal(core.fixture).normal[2] < 0.99
    assert info["success"]
    # Turned as for the mouth, the tool would be turned by as much about the vertical.
    actor = CornerSearch(core)
    actor._look()
    scale = np.array(core.commands.scale)
    angles = actor._action(np.zeros(3), 0.0, 0.1)[3:] * scale[3:]
    vector = [np.sin(angles[2]), np.sin(angles[1]), np.sin(angles[0])]
    normal = matrix_from_quat(core.fixture.quat_wxyz)[:, 2]
    np.testing.assert_allclose(vector, 0.1 * normal, atol=0.006)


def test_it_goes_on_when_the_first_path_finds_nothing():
    env, core = make((0.0, 0.0), max_steps=400)
    actor = CornerSearch(core, CornerSearchConfig(drop=0.01, rings=(0.004,)))
    observation, _ = env.reset(seed=3)
    begun = 0
    for _ in range(400):
        before = actor.phase
        observation, _, ended, cut, _ = env.step(actor(observation))
        begun += (before, actor.phase) == ("slide", "go over")
        if ended or cut:
            break
    assert begun >= 1


def test_axes_that_do_not_tilt_are_refused_with_what_to_give():
    _, core = make((0.0, 0.0), task="XYZ:force A:pose BC:hold")
    with pytest.raises(ConfigError, match="add --task 'XYZ:force ABC:pose'"):
        CornerSearch(core)


@pytest.mark.parametrize(
    "wrong",
    [{"tilt": 0.6}, {"rings": ()}, {"rings": (0.2,)}, {"press": float("nan")}],
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        CornerSearchConfig(**wrong)


def test_what_is_pushed_off_the_fixture_goes_back_to_it():
    """It searched on beside the block, ever deeper."""
    env, core = make((0.0, 0.0), max_steps=200)
    actor = CornerSearch(core)
    observation, _ = env.reset(seed=3)
    success = ended = cut = is_pushed = False
    while not (ended or cut):
        if actor.phase in ("touch", "slide", "seat") and not is_pushed:
            is_pushed = True
            core.arm.push(np.array([40.0, 20.0, 20.0]), 0.6)
        observation, _, ended, cut, info = env.step(actor(observation))
        success = info["success"]
    assert is_pushed
    assert success
