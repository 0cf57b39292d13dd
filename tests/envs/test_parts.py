import numpy as np
import pytest

from dovetail.control.task_spec import TaskSpec
from dovetail.envs.commands import CommandMap
from dovetail.envs.config import ActionConfig, EnvConfig
from dovetail.envs.observation import (
    USUAL_GROUPS,
    Layout,
)
from dovetail.envs.stacking import History
from dovetail.errors import ConfigError
from dovetail.poses import (
    matrix_from_quat,
    quat_about_z,
    quat_conjugate,
    quat_multiply,
    quat_normalized,
    swing_twist,
    theta_about_vertical,
    tool_down,
)
from dovetail.robots.iiwa14 import iiwa14
from dovetail.settings import ranges_of
from dovetail.tasks.reward import RewardConfig, distance_reward
from dovetail.tasks.starts import (
    RandomisationConfig,
    is_clear,
    sample_fixture,
    sample_start,
)
from dovetail.trackers.truth import Truth


class Recorder:
    f_star = position_d = quat_wxyz_d = None


def fill(task, action, quat=None):
    commands = CommandMap(
        TaskSpec.parse(task),
        f_scale=4.0,
        f_scale_angular=20.0,
        theta_range=0.2,
        position_range=0.05,
    )
    target = Recorder()
    quat = tool_down(0.0) if quat is None else quat
    commands.fill(target, np.asarray(action, dtype=np.float32), np.ones(3), quat)
    return commands, target


def test_actions_come_in_the_order_x_y_z_a_b_c():
    commands, target = fill("XYZ:force ABC:force", [1, 2, 3, 4, 5, 6])
    assert commands.axes == ("X", "Y", "Z", "A", "B", "C")
    np.testing.assert_allclose(target.f_star, [4, 8, 12, 120, 100, 80])  # A is about z


def test_only_commanded_axes_have_an_action():
    commands, target = fill("Z:force A:pose XYBC:hold", [1.0, 0.0])
    assert commands.axes == ("Z", "A")
    np.testing.assert_allclose(target.f_star, [0, 0, 4, 0, 0, 0])


def test_pose_axes_are_relative_to_the_goal():
    _, target = fill("XYZ:pose A:pose BC:hold", [1.0, -0.5, 0.0, 1.0])
    np.testing.assert_allclose(target.position_d, [1.05, 0.975, 1.0])
    np.testing.assert_allclose(target.quat_wxyz_d, tool_down(0.2), atol=1e-12)


def test_pose_rotations_turn_about_the_world_axes():
    goal = quat_normalized(np.array([0.1, 0.9, -0.3, 0.2]))
    for axis, world in (("A", 2), ("B", 1), ("C", 0)):
        _, target = fill(f"{axis}:pose", [1.0], quat=goal)
        turn = np.array([np.cos(0.1), 0.0, 0.0, 0.0])
        turn[1 + world] = np.sin(0.1)
        expected = quat_multiply(turn, goal)
        sign = np.sign(expected @ target.quat_wxyz_d)
        np.testing.assert_allclose(sign * target.quat_wxyz_d, expected, atol=1e-12)


def test_reward_by_hand():
    reward = distance_reward(np.array([0.3, 0.0, -0.4]), 0.5, False, RewardConfig())
    assert reward == pytest.approx(-(0.6 * 0.5 + 0.4 * 0.7 + 0.1 * 0.5))
    assert distance_reward(np.zeros(3), 0.0, True, RewardConfig()) == 50.0


def test_contact_force_costs_nothing_unless_asked_for():
    x = np.zeros(3)
    assert distance_reward(x, 0.0, False, RewardConfig(), 1e3) == 0.0
    config = RewardConfig(force_weight=0.01, force_free=10.0)
    assert distance_reward(x, 0.0, False, config, 9.0) == 0.0
    assert distance_reward(x, 0.0, False, config, 30.0) == pytest.approx(-0.2)


def test_history_appends_past_pairs_newest_first():
    history = History(2, 2, 1)
    obs = [np.array([i, 10 + i], dtype=np.float32) for i in range(4)]
    act = [np.array([100 + i], dtype=np.float32) for i in range(3)]
    np.testing.assert_array_equal(history.reset(obs[0]), [0, 10, 0, 10, 0, 0, 10, 0])
    np.testing.assert_array_equal(
        history.push(act[0], obs[1]), [1, 11, 0, 10, 100, 0, 10, 0]
    )
    np.testing.assert_array_equal(
        history.push(act[1], obs[2]), [2, 12, 1, 11, 101, 0, 10, 100]
    )
    np.testing.assert_array_equal(
        history.push(act[2], obs[3]), [3, 13, 2, 12, 102, 1, 11, 101]
    )
    np.testing.assert_array_equal(history.reset(obs[0]), [0, 10, 0, 10, 0, 0, 10, 0])


def test_what_history_returns_is_not_changed_later():
    history = History(1, 2, 1)
    first = history.reset(np.zeros(2, dtype=np.float32))
    history.push(np.ones(1, dtype=np.float32), np.ones(2, dtype=np.float32))
    np.testing.assert_array_equal(first, np.zeros(5))


def test_theta_equals_the_swing_twist_of_poses():
    rng = np.random.default_rng(0)
    for _ in range(200):
        goal = quat_normalized(rng.normal(size=4))
        tilt = quat_normalized(np.array([1.0, *(0.1 * rng.normal(size=3))]))
        quat = quat_multiply(
            quat_about_z(rng.uniform(-3, 3)), quat_multiply(tilt, goal)
        )
        _, (w, _, _, z) = swing_twist(quat_multiply(quat, quat_conjugate(goal)))
        expected = np.angle(complex(w, z) ** 2)
        assert theta_about_vertical(quat, goal) == pytest.approx(expected, abs=1e-9)
        assert theta_about_vertical(-quat, goal) == pytest.approx(expected, abs=1e-9)


def test_scaling_is_monotone_and_inside_its_bounds():
    scaling = Layout(USUAL_GROUPS, iiwa14(), np.array([0.0, 0.0, 0.03]))
    values = [scaling.scale(np.full(14, v)) for v in np.linspace(-2.0, 2.0, 401)]
    assert (np.diff(values, axis=0) >= 0.0).all()
    assert (np.diff(values, axis=0)[100:300, 7:] > 0.0).all()
    extreme = scaling.scale(np.full(14, 1e6))
    high = np.array([1.1] * 7 + [7.0] * 3 + [5.1] + [5.0] * 3, dtype=np.float32)
    np.testing.assert_array_equal(extreme, high)


def test_the_scaled_position_is_zero_at_the_mouth():
    scaling = Layout(USUAL_GROUPS, iiwa14(), np.array([0.0, 0.0, 0.03]))
    raw = np.zeros(14)
    raw[9] = 0.03
    np.testing.assert_array_equal(scaling.scale(raw), np.zeros(14))
    assert scaling.describe()["zero"][7:10] == [0.0, 0.0, 0.03]


def test_holes_and_starts_fill_their_ranges_and_stay_inside():
    rng = np.random.default_rng(0)
    config = RandomisationConfig()
    holes, offsets, turns, below = [], [], [], 0
    for _ in range(3000):
        hole = sample_fixture(rng, config)
        yaw = theta_about_vertical(hole.quat_wxyz, np.array([1.0, 0.0, 0.0, 0.0]))
        start = sample_start(rng, hole, yaw, config)
        offset = start.position - hole.position
        holes.append([*hole.position, yaw])
        offsets.append(offset)
        turns.append(theta_about_vertical(start.quat_wxyz, tool_down(yaw)))
        assert is_clear(offset, hole.quat_wxyz, config)
        below += offset[2] < 0.0
    centre, half = [0.60, 0.0, 0.10, 0.0], [0.05, 0.05, 0.02, 0.3]
    np.testing.assert_allclose(np.min(holes, 0), np.subtract(centre, half), atol=2e-3)
    np.testing.assert_allclose(np.max(holes, 0), np.add(centre, half), atol=2e-3)
    np.testing.assert_allclose(np.min(offsets, 0), [-0.12, -0.12, -0.03], atol=2e-3)
    np.testing.assert_allclose(np.max(offsets, 0), [0.12, 0.12, 0.12], atol=2e-3)
    assert max(np.abs(turns)) == pytest.approx(0.2, abs=2e-3)
    assert below > 100  # starts below the surface, beside the block


def test_below_the_surface_only_what_lies_beside_the_turned_block_is_free():
    config = RandomisationConfig()
    assert is_clear(np.array([0.0, 0.0, 0.005]), quat_about_z(0.3), config)
    assert not is_clear(np.array([0.0, 0.0, 0.004]), quat_about_z(0.3), config)
    assert is_clear(np.array([0.08, 0.0, -0.02]), quat_about_z(0.0), config)
    assert not is_clear(np.array([0.07, 0.0, -0.02]), quat_about_z(0.0), config)
    corner = matrix_from_quat(quat_about_z(0.3)) @ np.array([0.075, 0.075, -0.02])
    assert not is_clear(corner, quat_about_z(0.3), config)


def test_ranges_without_a_free_start_are_an_error():
    config = RandomisationConfig(aside=0.01, height=(-0.03, 0.0))
    rng = np.random.default_rng(0)
    hole = sample_fixture(rng, config)
    with pytest.raises(ConfigError, match="no start in free air"):
        sample_start(rng, hole, 0.0, config)


def test_the_true_hole_is_never_late():
    tracker = Truth()
    with pytest.raises(RuntimeError, match="call reset"):
        tracker.estimate()
    hole = sample_fixture(np.random.default_rng(0), RandomisationConfig())
    tracker.reset(hole, 0)
    assert tracker.estimate() == (hole, 0.0, None)


@pytest.mark.parametrize("name", ["f_scale_angular", "theta_range", "position_range"])
def test_a_scale_is_checked_before_there_is_an_arm(name):
    allowed = ranges_of(ActionConfig)[name]
    with pytest.raises(ConfigError, match=rf"{name} is .* {allowed.unit}; allowed: 0"):
        EnvConfig(**{name: 2.0 * allowed.high})
