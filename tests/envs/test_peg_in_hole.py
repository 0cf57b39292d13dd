from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import make_env
from dovetail.envs.violations import count_bad_input
from dovetail.errors import ConfigError, MissingDependencyError
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.poses import Pose, quat_about_z
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.starts import RandomisationConfig, tool_down
from extras import need

from .fake_arm import FakeArm

HOLE = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
TARGET = np.array([0.6, 0.0, 0.07])


@pytest.fixture
def fake():
    """Environment over a fake arm, the hole at HOLE."""
    arm = FakeArm()
    env = make_env(PegInHole, arm)
    env.reset(seed=0, options={"fixture": HOLE, "start": np.zeros(7)})
    return env, arm


@pytest.fixture(scope="module")
def real():
    env = make_env(PegInHole)
    yield env
    env.close()


def act(env, *action):
    return env.step(np.array(action or [0.0] * 4, dtype=np.float32))


def test_gymnasium_makes_it_by_name_and_it_passes_check_env():
    env = gym.make(
        "dovetail/PegInHole-v0",
        plant="mujoco",
        peg="square",
        clearance=0.001,
        task="XYZ:force A:pose BC:hold",
        stack=0,
    )
    check_env(env.unwrapped)
    env.close()


def test_check_env_passes_with_stacking():
    env = make_env(PegInHole, stack=4)
    check_env(env)
    assert env.observation_space.shape == (14 + 4 * 18,)
    env.close()


def test_the_same_seed_gives_the_same_episode(real):
    rng = np.random.default_rng(1)
    actions = rng.uniform(-1, 1, (30, 4)).astype(np.float32)

    def roll():
        seen = [real.reset(seed=3)[0]]
        seen += [real.step(action)[0] for action in actions]
        return np.array(seen)

    first = roll()
    np.testing.assert_array_equal(first, roll())
    assert not np.array_equal(first[0], real.reset(seed=4)[0])


def test_observation_is_measured_joints_tool_minus_target_theta_and_velocity(fake):
    env, arm = fake
    q = np.linspace(-1.0, 1.0, 7)
    arm.place((0.61, -0.02, 0.15), yaw=0.3, velocity=(0.1, 0.2, -0.3), q=q)
    observation, _, _, _, info = act(env)
    raw = info["observation_raw"]
    np.testing.assert_allclose(raw[:7], q)
    np.testing.assert_allclose(raw[7:10], np.array([0.61, -0.02, 0.15]) - TARGET)
    assert raw[10] == pytest.approx(0.3)
    np.testing.assert_allclose(raw[11:], [0.1, 0.2, -0.3])
    np.testing.assert_allclose(
        observation[:7], q / arm.facts.robot.limits.q_max, rtol=1e-6
    )
    from_mouth = np.array([0.01, -0.02, 0.05])
    scaled = np.sign(from_mouth) * np.log(1 + np.abs(from_mouth) / 0.002)
    np.testing.assert_allclose(observation[7:10], scaled, rtol=1e-5)
    assert observation[10] == pytest.approx(np.log(1 + 0.3 / 0.02), rel=1e-5)
    assert observation[13] == pytest.approx(-np.log(1 + 0.3 / 0.02), rel=1e-5)


def test_theta_is_relative_to_the_hole(fake):
    env, arm = fake
    turned = Pose(HOLE.position, quat_about_z(0.25))
    arm.place(yaw=0.35)
    _, info = env.reset(options={"fixture": turned, "start": np.zeros(7)})
    assert info["theta_error"] == pytest.approx(0.10)
    act(env, 0, 0, 0, 0)
    np.testing.assert_allclose(arm.targets[-1][2], tool_down(0.25), atol=1e-9)
    act(env, 0, 0, 0, 1)
    np.testing.assert_allclose(arm.targets[-1][2], tool_down(0.45), atol=1e-9)


def test_the_action_is_an_acceleration_and_a_rotation_relative_to_the_hole(fake):
    env, arm = fake
    act(env, 0.5, -1.0, 0.25, -0.5)
    f_star, _, quat = arm.targets[-1]
    np.testing.assert_allclose(f_star, [2.0, -4.0, 1.0, 0, 0, 0])
    np.testing.assert_allclose(quat, tool_down(-0.1), atol=1e-9)


def test_an_action_beyond_one_is_clipped_to_one(fake):
    env, arm = fake
    act(env, 3.0, -7.0, 0.0, 2.0)
    np.testing.assert_allclose(arm.targets[-1][0][:3], [4.0, -4.0, 0.0])


@pytest.mark.parametrize("action", [[0.0] * 3, [0.0, 0.0, np.nan, 0.0]])
def test_an_action_of_another_size_or_not_finite_is_refused(fake, action):
    env, _ = fake
    with pytest.raises(ConfigError, match="must be 4 finite numbers, one for each of"):
        act(env, *action)


def test_reward_is_the_papers(fake):
    env, arm = fake
    arm.place(np.add(TARGET, [0.03, 0.0, 0.04]), yaw=-0.2)
    _, reward, terminated, truncated, _ = act(env)
    assert reward == pytest.approx(-(0.6 * 0.05 + 0.4 * 0.07 + 0.1 * 0.2))
    assert not terminated
    assert not truncated


def test_success_is_28_mm_deep_and_inside_and_ends_the_episode_with_50(fake):
    env, arm = fake
    arm.place(np.add(TARGET, [0.0, 0.0, 0.0019]))
    _, reward, terminated, truncated, info = act(env)
    assert (terminated, truncated, info["success"]) == (True, False, True)
    assert info["depth"] == pytest.approx(0.0281)
    assert reward == pytest.approx(50.0 - 0.0019)


@pytest.mark.parametrize(
    "offset", [(0.0, 0.0, 0.0021), (0.004, 0.0, 0.0), (0.09, 0, 0)]
)
def test_too_high_or_beside_the_hole_is_no_success(fake, offset):
    env, arm = fake
    arm.place(TARGET + offset)
    _, _, terminated, _, info = act(env)
    assert not terminated
    assert not info["success"]


def test_after_max_steps_the_episode_is_truncated_not_terminated():
    env = make_env(PegInHole, FakeArm(), max_steps=3)
    env.reset(options={"fixture": HOLE, "start": np.zeros(7)})
    ends = [act(env)[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]


def test_success_in_the_last_step_terminates():
    arm = FakeArm()
    env = make_env(PegInHole, arm, max_steps=1)
    env.reset(options={"fixture": HOLE, "start": np.zeros(7)})
    arm.place(TARGET)
    assert act(env)[2:4] == (True, False)


def test_info_has_contact_force_and_limit_violations(fake):
    env, arm = fake
    log = np.zeros((10, len(CYCLE_COLUMNS)))
    log[:, [CYCLE_COLUMNS.index(a) for a in "xyz"]] = [0.6, 0.0, 0.2]
    log[2, CYCLE_COLUMNS.index("q3")] = arm.facts.robot.limits.q_max[2] + 1e-3
    log[2, CYCLE_COLUMNS.index("dq1")] = 9.0
    log[7, CYCLE_COLUMNS.index("z")] = -0.1
    arm.place(force=(3.0, 0.0, -4.0), log=log)
    info = act(env)[4]
    assert info["contact_force_max"] == pytest.approx(5.0)
    assert info["limit_violations"] == 2


def test_info_counts_the_cycles_whose_input_was_refused(fake):
    env, arm = fake
    log = np.zeros((10, len(CYCLE_COLUMNS)))
    log[3:5, CYCLE_COLUMNS.index("flags")] = (1 << 40) + (1 << 14)
    log[7, CYCLE_COLUMNS.index("flags")] = 1 << 41
    arm.place(log=log)
    arm.state = arm.state._replace(flags=(1 << 40) + (1 << 14) + (1 << 41))
    assert act(env)[4]["bad_input"] == 2


def test_the_controllers_own_refusals_are_counted(real):
    """The bit that is counted is the one that C++ sets."""
    real.reset(seed=0)
    target = _core.Target()
    target.f_star = np.full(6, np.nan)
    state = real.arm.step(target)
    assert count_bad_input(state) == len(state.log) > 0
    assert count_bad_input(real.arm.step(_core.Target())) == 0


def test_state_and_hole_can_be_read_and_close_closes_the_arm(fake):
    env, arm = fake
    act(env)
    assert env.state is arm.state
    np.testing.assert_array_equal(env.fixture.position, HOLE.position)
    env.close()
    assert arm.closed


def test_the_start_configuration_puts_the_tool_down_at_the_drawn_pose(real):
    for seed in range(20):
        _, info = real.reset(seed=seed)
        assert abs(info["theta_error"]) <= 0.2 + 1e-3
        offset = info["position_error"] - [0.0, 0.0, 0.03]
        assert (np.abs(offset[:2]) <= 0.12 + 1e-3).all()
        assert -0.031 <= offset[2] <= 0.121


def test_no_start_touches_anything(real):
    for seed in range(20):
        real.reset(seed=seed)
        info = act(real)[4]
        assert info["contact_force_max"] == 0.0


def test_what_is_seen_on_a_twin_is_what_the_joints_measure():
    env = make_env(PegInHole, twin="medium")
    chain = env.arm.facts.robot.chain()
    env.reset(seed=0)
    info = act(env, 0.5, 0.5, -0.5, 0.5)[4]
    raw = info["observation_raw"]
    seen = raw[7:10] + env.fixture.position - [0.0, 0.0, 0.03]
    np.testing.assert_allclose(seen, chain.pose(raw[:7])[0], atol=1e-12)
    true = env.arm.plant.tool_pose().position
    assert 0.0 < np.linalg.norm(seen - true) < 0.01
    env.close()


def test_the_walls_hold_every_start_and_hole(real):
    limits = real.arm.facts.limits
    config = real.task.randomisation
    centre = np.asarray(config.middle)
    reach = np.asarray(config.half_range)
    low = centre - reach + [-config.aside, -config.aside, -0.030]
    high = centre + reach + [config.aside, config.aside, config.height[1]]
    margin = limits.delta_x
    assert (low - margin > limits.x_min).all()
    assert (high + margin < limits.x_max).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"plant": "gazebo"}, "plant 'gazebo' is unknown; known plants: mujoco"),
        ({"peg": "hexagon"}, "hexagon.; known: square"),
        ({"clearance": -0.001}, "clearance is -0.001 m; allowed: 0 to 0.01 m"),
        (
            {"clearance": "x"},
            "clearance is 'x', which is no number; allowed: 0 to 0.01 m",
        ),
        ({"task": "XYW:force"}, "unknown task axis 'W'"),
        ({"task": "XYZ:push"}, "unknown mode 'push'"),
        ({"task": "XYZ:hold ABC:hold"}, "nothing to command"),
        ({"stack": -1}, "stack is -1; allowed: 0 to 100 pairs"),
        ({"stack": 1.5}, "stack is 1.5; give a whole number: 0 to 100"),
        ({"max_steps": 0}, "max_steps is 0; allowed: 1 to 1000000 steps"),
        ({"max_steps": 1.5}, "max_steps is 1.5; give a whole number"),
        ({"engine": "bullet"}, "engine is 'bullet'.*no twin is given"),
        ({"arm": "mujoco", "engine": "bullet"}, "engine is 'bullet'.*no twin"),
        ({"f_scale": "x"}, "f_scale is 'x'"),
        ({"f_scale": (4.0, -4.0, 4.0)}, r"f_scale\[Y\] is -4 m/s2; allowed: 0 to 100"),
        *(
            ({name: value}, rf"{name}.* is {value:g} {unit}; allowed: 0 to")
            for name, largest, unit in (
                ("f_scale", 1e5, "m/s2"),
                ("f_scale_angular", 1e5, "rad/s2"),
                ("theta_range", 4.0, "rad"),
                ("position_range", 2.0, "m"),
                ("near_distance", 2.0, "m"),
            )
            for value in (np.nan, -1.0, largest)
            if not (name == "f_scale" and np.isnan(value))
        ),
        ({"f_scale": np.nan}, "f_scale is nan"),
        ({"period": 0.5}, "control period is 500 ms; allowed: 1, 2, 2.5 and 5 ms"),
        ({"twin": "nice"}, "no twin 'nice'; shipped twins: "),
    ],
)
def test_a_wrong_setting_is_an_error_that_says_what_is_known(settings, message):
    with pytest.raises(ConfigError, match=message):
        make_env(PegInHole, **settings)


def test_an_arm_of_another_task_is_refused(real):
    with pytest.raises(ConfigError, match="the arm's task is"):
        make_env(PegInHole, real.arm, task="XYZ:force ABC:hold")


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ((0.9, 0.0, 0.1), "is too far by 0.089 m"),
        ((0.6, 0.3, 0.1), "y = 0.3000 m, which is 0.0980 m outside"),
        ((0.6, 0.0, 0.01), "inside the table: .* 0.0300 m; raise it"),
    ],
)
def test_a_hole_out_of_reach_is_refused_saying_by_how_much(real, position, message):
    hole = Pose(np.array(position), quat_about_z(0.0))
    with pytest.raises(ConfigError, match=message):
        real.reset(options={"fixture": hole})


def test_an_arm_that_cannot_move_the_hole_must_be_told_where_it_is():
    arm = FakeArm()
    traits = replace(arm.facts.traits, places_fixture=False)
    arm.facts = replace(arm.facts, traits=traits)
    env = make_env(PegInHole, arm)
    with pytest.raises(ConfigError, match="cannot move the hole: say where it is"):
        env.reset(seed=0)
    env.reset(seed=0, options={"fixture": HOLE})
    np.testing.assert_array_equal(arm.hole.position, HOLE.position)
    fixed = RandomisationConfig(half_range=(0.0, 0.0, 0.0), yaw=0.0)
    env = make_env(PegInHole, arm, randomisation=fixed)
    env.reset(seed=0)


def test_an_unknown_reset_option_lists_the_known_ones(real):
    with pytest.raises(
        ConfigError, match="unknown reset options: holes; known: fixture"
    ):
        real.reset(options={"holes": HOLE})


@pytest.mark.parametrize(
    ("task", "num_actions"),
    [
        ("XYZ:force ABC:pose", 6),
        ("XYZ:force ABC:hold", 3),
        ("XYZ:force A:pose", 4),
        ("Z:force A:pose XYBC:hold", 2),
        ("XYZ:pose A:pose BC:hold", 4),
    ],
)
def test_other_tasks_step(task, num_actions):
    env = make_env(PegInHole, task=task)
    env.reset(seed=0)
    action = np.full(num_actions, 0.5, dtype=np.float32)
    observation, reward, *_ = env.step(action)
    assert env.action_space.shape == (num_actions,)
    assert env.observation_space.contains(observation)
    assert np.isfinite(reward)
    env.close()


@pytest.mark.bullet
def test_the_environment_runs_on_pybullet():
    need("pybullet")
    env = make_env(PegInHole, plant="bullet")
    first, _ = env.reset(seed=0)
    again, _ = make_env(PegInHole).reset(seed=0)
    np.testing.assert_allclose(first, again, atol=1e-4)
    act(env, 0.5, 0.5, -0.5, 0.5)
    env.close()


@pytest.mark.bullet
def test_pybullet_refuses_the_triangle():
    need("pybullet")
    with pytest.raises((ConfigError, MissingDependencyError), match="triangle"):
        make_env(PegInHole, plant="bullet", peg="triangle")


def test_force_damping_and_limits_reach_the_controller():
    env = make_env(PegInHole, force_damping=16.0, period=0.001)
    facts = env.arm.facts
    assert facts.period == 0.001
    np.testing.assert_allclose(facts.limits.dx_max, [0.25] * 3)
    osc = OscConfig.for_period(0.001, force_damping=[16.0] * 6)
    limits = LimitConfig.for_period(facts.robot, 0.001)
    controller = make_controller(facts.robot, osc, limits, env.axes, 0.001)
    assert controller is not None
    env.reset(seed=0)
    act(env, 0.0, 0.0, 1.0, 0.0)
    assert len(env.state.log) == 50
    env.close()
