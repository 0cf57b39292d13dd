"""A fixture that is tilted, or in a wall: its goal, depth, starts and what is seen."""

import math

import numpy as np
import pytest

from dovetail.envs.free_start import OVERLAP_MAX, StartCheck
from dovetail.envs.registered import make
from dovetail.envs.workspace import require_inside
from dovetail.errors import ConfigError
from dovetail.evaluation.config import EvaluationConfig, fixture_poses
from dovetail.learn.config import TrainConfig
from dovetail.poses import matrix_from_quat
from dovetail.tasks.drawn_opening import with_tilt
from dovetail.tasks.facing import FACINGS, find_facing
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.rail_clip.task import RailClip
from dovetail.tasks.reward import distance_reward
from dovetail.tasks.starts import RandomisationConfig, is_clear

TILT = 0.2
PLACES = ((0.0, TILT, 0.0), (0.3, 0.0, -TILT), (-0.2, 0.15, 0.1))
"""Turns A B C [rad] of a fixture."""


def turn(axis, angle):
    """Return the matrix of a rotation about x, y or z (0, 1, 2)."""
    i, j = [k for k in range(3) if k != axis]
    sign = -1.0 if axis == 1 else 1.0
    R = np.eye(3)
    R[i, i] = R[j, j] = math.cos(angle)
    R[j, i], R[i, j] = sign * math.sin(angle), -sign * math.sin(angle)
    return R


def kuka(a, b, c):
    """Return KUKA's rotation A B C, about z, then the new y, then the new x."""
    return turn(2, a) @ turn(1, b) @ turn(0, c)


def rotation_vector(R):
    """Return the rotation vector [rad] of a turn that is small or large."""
    angle = math.acos(min(1.0, (np.trace(R) - 1.0) / 2.0))
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return axis * angle / max(2.0 * math.sin(angle), 1e-12)


def placed(turns, facing=FACINGS["up"]):
    return FixturePose.given((0.6, 0.02, 0.11, *turns), facing.quat_wxyz).pose()


@pytest.mark.parametrize("turns", PLACES)
@pytest.mark.parametrize("name", FACINGS)
def test_a_place_turns_its_facing_as_kuka_turns_a_frame(turns, name):
    facing = find_facing(name)
    R = matrix_from_quat(placed(turns, facing).quat_wxyz)
    expected = kuka(*turns) @ matrix_from_quat(np.array(facing.quat_wxyz))
    np.testing.assert_allclose(R, expected, atol=1e-12)


@pytest.mark.parametrize("numbers", [(0.6, 0, 0.1), (0.6, 0, 0.1, 0, 0.2), (0,) * 7])
def test_a_place_is_four_or_six_numbers(numbers):
    with pytest.raises(ConfigError):
        FixturePose.given(numbers)


def test_a_place_says_the_numbers_that_it_was_given():
    for numbers in ((0.6, 0.0, 0.1, 0.3), (0.6, 0.0, 0.1, 0.3, 0.0, -0.2)):
        assert FixturePose.given(numbers).numbers == numbers


@pytest.mark.parametrize("turns", PLACES)
def test_the_tool_goes_in_against_the_tilted_axis(turns):
    task, fixture = PegInHole(tilt=TILT), placed(turns)
    goal, out = task.goal(fixture), kuka(*turns)[:, 2]
    np.testing.assert_allclose(goal.normal, out, atol=1e-12)
    np.testing.assert_allclose(matrix_from_quat(goal.quat_wxyz)[:, 2], -out, atol=1e-12)
    np.testing.assert_allclose(fixture.position - goal.position, task.block.depth * out)
    assert goal.surface == pytest.approx(out @ fixture.position)


@pytest.mark.parametrize("turns", PLACES)
def test_depth_counts_along_the_tilted_axis_and_distance_from_it(turns):
    task, R = PegInHole(tilt=TILT), kuka(*turns)
    goal = task.goal(placed(turns))
    for height, beside, is_in in ((0.001, 0.0, True), (0.003, 0.0, False)):
        depth, success = task.judge(R @ [beside, 0.0, height], goal, None)
        assert depth == pytest.approx(task.block.depth - height)
        assert success is is_in
    # As deep as before, but so far beside as only another hole is.
    depth, success = task.judge(R @ [0.004, 0.0, 0.001], goal, None)
    assert depth == pytest.approx(task.block.depth - 0.001)
    assert not success
    # Straight above the floor the world's z would see no distance from the axis.
    lean = math.acos(R[2, 2])
    assert not task.judge(np.array([0.0, 0.0, 0.03]), goal, None).success
    assert task.judge(np.array([0.0, 0.0, 0.03]), goal, None).depth == pytest.approx(
        task.block.depth - 0.03 * math.cos(lean)
    )


def test_fixtures_fill_the_range_of_tilts_and_no_more():
    task, rng = PegInHole(tilt=TILT), np.random.default_rng(0)
    normals = []
    for _ in range(400):
        R = matrix_from_quat(task.draw_fixture(rng).quat_wxyz)
        # Seen with the turn about its own axis taken out.
        yaw = math.atan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
        normals.append(turn(2, -yaw) @ R[:, 2])
    most = np.abs(np.arcsin(np.array(normals)[:, :2])).max(axis=0)
    assert np.all(most > 0.9 * TILT)
    assert np.all(most < 1.05 * TILT)


def test_a_fixture_that_does_not_tilt_draws_as_it_did():
    flat, tilted = PegInHole(), PegInHole(tilt=TILT)
    one, two = np.random.default_rng(3), np.random.default_rng(3)
    a, b = flat.draw_fixture(one), tilted.draw_fixture(two)
    np.testing.assert_array_equal(a.position, b.position)
    assert one.bit_generator.state != two.bit_generator.state
    assert (flat.axes, flat.columns) == (PegInHole.axes, PegInHole.columns)


def test_beside_a_tilted_block_the_whole_end_of_the_peg_is_in_free_air():
    config, rng = RandomisationConfig(), np.random.default_rng(0)
    angles = np.linspace(0.0, 2.0 * np.pi, 16)
    circle = config.held_radius * np.stack(
        [np.cos(angles), np.sin(angles), 0.0 * angles], axis=1
    )
    up = 0.05 * np.linspace(0.0, 1.0, 6)
    low = 0
    for _ in range(3000):
        turns = (rng.uniform(-0.3, 0.3), *rng.uniform(-TILT, TILT, 2))
        fixture = placed(turns)
        offset = rng.uniform([-0.12, -0.12, -0.03], [0.12, 0.12, 0.03])
        if not is_clear(offset, fixture.quat_wxyz, config):
            continue
        for height in up:
            ends = (offset + circle + [0.0, 0.0, height]) @ kuka(*turns)
            inside = (np.abs(ends[:, :2]).max(axis=1) < config.fixture_half) & (
                ends[:, 2] < 0.0
            )
            assert not inside.any()
        low += offset[2] < 0.0
    assert low > 200


@pytest.mark.parametrize("facing", FACINGS)
def test_starts_of_a_tilted_task_are_in_free_air_and_point_as_it_faces(facing):
    env = make("dovetail/PegInHole-v0", tilt=TILT, facing=facing)
    core = env.unwrapped
    check = StartCheck(core.cell)
    way = matrix_from_quat(np.array(find_facing(facing).quat_wxyz))[:, 2]
    for seed in range(8):
        env.reset(seed=seed)
        assert check.overlap(core.state.q, core.fixture).depth <= OVERLAP_MAX
        tool = matrix_from_quat(core.state.tool.quat_wxyz)
        np.testing.assert_allclose(tool[:, 2], -way, atol=1e-4)


@pytest.mark.parametrize("facing", FACINGS)
def test_the_policy_sees_how_the_tool_is_turned_from_the_goal(facing):
    env = make("dovetail/PegInHole-v0", tilt=TILT, facing=facing)
    core = env.unwrapped
    _, info = env.reset(seed=1)
    names = [column.name for column in core.columns]
    seen = dict(zip(names, info["observation_raw"], strict=True))
    goal = matrix_from_quat(core.task.goal(core.fixture).quat_wxyz)
    vector = rotation_vector(matrix_from_quat(core.state.tool.quat_wxyz) @ goal.T)
    assert np.abs(vector[:2]).max() > 0.02
    told = [seen["obs_tilt_x"], seen["obs_tilt_y"]]
    np.testing.assert_allclose(told, vector[:2], atol=1e-9)
    mouth = [seen[f"obs_mouth_{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(mouth, core.state.tool.position - core.fixture.position)


@pytest.mark.parametrize("facing", FACINGS)
@pytest.mark.parametrize("tilts", [(TILT, 0.0), (0.0, -TILT)])
def test_an_action_of_zeros_turns_the_tool_to_the_tilt_and_holds_it(facing, tilts):
    env = make("dovetail/PegInHole-v0", tilt=TILT, facing=facing)
    core = env.unwrapped
    place = core.task.trial_poses[0]._replace(b=tilts[0], c=tilts[1])
    env.reset(seed=2, options={"fixture": place.pose()})
    for _ in range(30):
        _, _, _, _, info = env.step(np.zeros(6, dtype=np.float32))
        assert info["limit_violations"] == 0
    goal = matrix_from_quat(core.task.goal(core.fixture).quat_wxyz)
    left = rotation_vector(matrix_from_quat(core.state.tool.quat_wxyz) @ goal.T)
    assert np.linalg.norm(left) < 0.002


def test_what_was_held_goes_to_the_goal_and_the_rest_stays():
    assert with_tilt("XYZ:force A:pose BC:hold") == "XYZ:force ABC:pose"
    assert with_tilt("XYZ:force A:pose B:force") == "XYZB:force A:pose"
    assert with_tilt("X:force A:pose YZBC:hold") == "X:force ABC:pose YZ:hold"


def test_also_may_name_what_the_task_shows_already():
    env = make("dovetail/PegInHole-v0", tilt=TILT, also=("tilt", "spin"))
    names = [column.name for column in env.unwrapped.columns]
    assert names.count("obs_tilt_x") == 1
    assert names[-1] == "obs_wz"


def test_a_training_knows_what_the_tilt_makes_of_the_axes():
    config = TrainConfig(task_options={"tilt": TILT})
    assert config.env_options()["task"] == "XYZ:force ABC:pose"
    assert TrainConfig().env_options()["task"] == PegInHole.axes


def test_a_fixed_place_of_a_training_keeps_its_tilt():
    config = TrainConfig(task_options={"tilt": TILT}, fixed_goal=True)
    usual = PegInHole(tilt=TILT).trial_poses[0]
    np.testing.assert_allclose(
        config.fixed_place.pose().quat_wxyz, usual.pose().quat_wxyz
    )
    given = TrainConfig(fixed_goal=True, fixture=(0.6, 0.0, 0.1, 0.0, 0.1, -0.2))
    assert given.fixed_place.numbers == (0.6, 0.0, 0.1, 0.0, 0.1, -0.2)


def test_a_policy_for_tilted_holes_is_tried_at_tilted_holes():
    policy = {"env_id": "dovetail/PegInHole-v0", "env": {"tilt": TILT}}
    config = EvaluationConfig(policy="peg_square")
    tilts = [(pose.b, pose.c) for pose in fixture_poses(config, policy)]
    assert tilts[:2] == [(TILT, 0.0), (0.0, TILT)]
    policy["env"] = {}
    assert fixture_poses(config, policy) == PegInHole.trial_poses


def test_a_tilted_place_is_for_a_policy_that_can_turn_the_tool():
    given = EvaluationConfig(policy="peg_square", fixture=(0.6, 0, 0.1, 0, 0.1, 0.2))
    policy = {"env_id": "dovetail/PegInHole-v0", "env": {}}
    with pytest.raises(ConfigError):
        fixture_poses(given, policy)
    policy["env"] = {"task": "XYZ:force ABC:pose"}
    (pose,) = fixture_poses(given, policy)
    assert (pose.b, pose.c) == (0.1, 0.2)
    # Its starts are as the rail is, so that what is held is right.
    policy = {"env_id": "dovetail/RailClip-v0", "env": {}}
    rail = EvaluationConfig(policy="peg_square", fixture=(0.87, 0, 0.4, 0, 0.1, 0.2))
    assert len(fixture_poses(rail, policy)) == 1


@pytest.mark.parametrize(
    "options", [{"tilt": 0.21}, {"tilt": -0.1}, {"tilt": math.nan}, {"facing": "left"}]
)
def test_a_tilt_or_facing_that_is_not_there_is_refused(options):
    with pytest.raises(ConfigError):
        PegInHole(**options)


def test_a_tilted_block_needs_more_height_over_the_table():
    cell = PegInHole(tilt=TILT).workcell(
        make("dovetail/PegInHole-v0").unwrapped.cell.robot
    )
    low = placed((0.0, TILT, 0.0))
    lowest = 0.03 * math.cos(TILT) + 0.05 * math.sin(TILT)
    cell.require_reachable(low._replace(position=np.array([0.6, 0.0, lowest + 1e-6])))
    with pytest.raises(ConfigError) as refused:
        cell.require_reachable(low._replace(position=np.array([0.6, 0.0, 0.031])))
    assert f"{lowest:.4f} m" in str(refused.value)


def test_a_fixture_to_which_no_joint_can_turn_the_tool_names_the_joint():
    core = make("dovetail/PegInHole-v0", facing="robot").unwrapped
    out = FixturePose.given((0.62, 0.0, 0.32, 0.0), FACINGS["robot"].quat_wxyz).pose()
    with pytest.raises(ConfigError):
        require_inside(core.task, core.cell, core.arm, out)


def test_the_rail_clip_is_as_it_was():
    task = RailClip()
    assert (task.axes, task.columns) == (RailClip.axes, RailClip.columns)
    assert vars(task).get("trial_poses") is None


@pytest.mark.parametrize(
    ("settings", "is_whole"),
    [
        ({"tilt": TILT}, True),
        ({"task": "XYZ:force ABC:pose", "also": ("tilt",)}, False),
    ],
)
def test_the_reward_charges_the_whole_angle_where_the_task_tilts(settings, is_whole):
    core = make("dovetail/PegInHole-v0", **settings).unwrapped
    place = FixturePose.given((0.6, 0.0, 0.1, 0.1, TILT, 0.0))
    core.reset(seed=0, options={"fixture": place.pose()})
    _, reward, _, _, info = core.step(np.zeros(6, dtype=np.float32))
    goal = matrix_from_quat(core.task.goal(core.fixture).quat_wxyz)
    vector = rotation_vector(matrix_from_quat(core.state.tool.quat_wxyz) @ goal.T)
    turn = np.linalg.norm(vector) if is_whole else info["theta_error"]
    assert np.linalg.norm(vector) > abs(info["theta_error"]) + 0.01
    expected = distance_reward(info["position_error"], turn, False, core.task.reward)
    assert reward == pytest.approx(expected, abs=1e-9)
