"""Perturbed trials: what is drawn, what it does, and what cannot be perturbed."""

import json
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from dovetail.arms.address import parse_address
from dovetail.errors import ConfigError
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.evaluation.origin import command_line
from dovetail.evaluation.perturbation import (
    TRAVEL,
    Perturbation,
    Perturbed,
    distance_out,
    draw_pushes,
    make_perturbed,
)
from dovetail.poses import Pose, quat_about_z, tool_down
from extras import need
from facts import about

HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
STILL = np.zeros(4, dtype=np.float32)


@pytest.fixture
def make():
    """Builds perturbed environments and closes them afterwards."""
    built = []

    def make(plant="mujoco", **settings):
        env = make_perturbed(
            "dovetail/PegInHole-v0", Perturbation(**settings), {"plant": plant}
        )
        built.append(env)
        return env

    yield make
    for env in built:
        env.close()


def test_nothing_perturbed_is_the_plain_environment(make):
    assert not Perturbation().is_any
    assert not isinstance(make(), Perturbed)


def test_a_covered_camera_is_off_by_the_distance_in_a_random_horizontal_direction(make):
    env = make(fixture_shift=0.02)
    angles = []
    for seed in range(40):
        env.reset(seed=seed, options={"fixture": HOLE})
        np.testing.assert_array_equal(env.core.fixture.position, HOLE.position)
        off = env.core.fixture.position - env.core.tracker.estimate().pose.position
        assert np.linalg.norm(off) == pytest.approx(0.02)
        assert off[2] == 0.0
        angles.append(np.arctan2(off[1], off[0]))
    counts, _ = np.histogram(angles, bins=4, range=(-np.pi, np.pi))
    assert counts.min() >= 4


def test_under_a_covered_camera_the_policy_sees_the_old_pose_and_its_age(make):
    env = make(fixture_shift=0.02)
    _, plain = make().reset(seed=1, options={"fixture": HOLE})
    _, info = env.reset(seed=1, options={"fixture": HOLE})
    off = info["observation_raw"][7:10] - plain["observation_raw"][7:10]
    np.testing.assert_allclose(
        off, info["perturbation"]["fixture_shift [m]"], atol=1e-12
    )
    env.step(STILL)
    env.step(STILL)
    assert env.core.tracker.estimate().age == pytest.approx(0.1)


def test_success_and_depth_are_those_of_the_true_hole(make):
    env = make(fixture_shift=0.03)
    robot = env.core.arm.facts.robot
    bottom = Pose(HOLE.position - [0, 0, 0.029], tool_down(0.0))
    inside = robot.inverse_kinematics(bottom, env.core.arm.facts.robot.posture("down"))
    _, info = env.reset(seed=1, options={"fixture": HOLE, "start": inside})
    assert info["success"]
    assert info["depth"] == pytest.approx(0.029, abs=1e-4)
    shift = info["perturbation"]["fixture_shift [m]"]
    above = bottom.position - shift + [0.0, 0.0, 0.04]  # further down is the block
    believed = Pose(above, bottom.quat_wxyz)
    beside = robot.inverse_kinematics(
        believed, env.core.arm.facts.robot.posture("down")
    )
    _, info = env.reset(seed=1, options={"fixture": HOLE, "start": beside})
    assert not info["success"]
    assert np.abs(info["position_error"][:2]).max() < 1e-4


def test_pushes_keep_to_their_ranges_and_do_not_overlap():
    rng = np.random.default_rng(0)
    sizes, directions = [], []
    for _ in range(100):
        pushes = draw_pushes(rng, 30.0, 10.0)
        assert len(pushes) >= 6
        ends = [0.05 * push.step + push.duration for push in pushes]
        starts = [0.05 * push.step for push in pushes]
        assert all(s >= e for s, e in zip(starts[1:], ends, strict=False))
        assert all(0.2 <= push.duration <= 0.5 for push in pushes)
        sizes += [np.linalg.norm(push.force) for push in pushes]
        directions += [push.force / np.linalg.norm(push.force) for push in pushes]
    assert 29.0 < max(sizes) <= 30.0
    assert np.mean(sizes) == pytest.approx(15.0, abs=1.0)
    np.testing.assert_allclose(np.mean(directions, axis=0), 0.0, atol=0.1)


@pytest.mark.parametrize(
    "plant", ["mujoco", pytest.param("bullet", marks=pytest.mark.bullet)]
)
def test_the_arm_is_pushed_as_was_told_and_the_same_for_a_seed(make, plant):
    if plant == "bullet":
        need("pybullet")
    env, calm = make(plant, push=30.0), make(plant)
    paths = []
    for seed in (5, 5, 6):
        _, info = env.reset(seed=seed, options={"fixture": HOLE})
        pushed = [push["start [s]"] for push in info["perturbation"]["pushes"]]
        assert pushed == sorted(pushed)
        paths.append([env.step(STILL)[4]["observation_raw"][7:10] for _ in range(60)])
    calm.reset(seed=5, options={"fixture": HOLE})
    still = [calm.step(STILL)[4]["observation_raw"][7:10] for _ in range(60)]
    np.testing.assert_array_equal(paths[0], paths[1])
    assert np.abs(np.subtract(paths[0], paths[2])).max() > 1e-3
    away = np.abs(np.subtract(paths[0], still)).max(axis=1)
    _, info = env.reset(seed=5, options={"fixture": HOLE})
    first = round(info["perturbation"]["pushes"][0]["start [s]"] / 0.05)
    assert away[:first].max() < 1e-9
    assert away.max() > 1e-3


def test_the_hole_goes_out_and_back_at_its_speed():
    times = np.arange(0.0, 10.0, 0.05)
    way = np.array([distance_out(time, 0.02) for time in times])
    assert way.max() == pytest.approx(TRAVEL)
    assert way.min() == 0.0
    steps = np.abs(np.diff(way))
    np.testing.assert_allclose(steps, 0.001, atol=1e-12)


@pytest.mark.parametrize(
    "plant", ["mujoco", pytest.param("bullet", marks=pytest.mark.bullet)]
)
def test_the_moving_hole_is_where_the_environment_says_and_the_tracker_sees(
    make, plant
):
    if plant == "bullet":
        need("pybullet")
    env = make(plant, fixture_speed=0.03)
    moved = []
    env.reset(seed=2, options={"fixture": HOLE})
    engine = env.core.arm.plant
    plain = engine.move_fixture
    engine.move_fixture = lambda hole: (moved.append(hole.position), plain(hole))
    for step in range(1, 51):
        _, _, _, _, info = env.step(STILL)
        way = env.core.fixture.position - HOLE.position
        expected = distance_out(0.05 * step, 0.03)
        assert np.linalg.norm(way) == pytest.approx(expected, abs=1e-9)
        np.testing.assert_allclose(moved[-1], env.core.fixture.position, atol=1e-12)
        assert env.core.tracker.estimate().pose is env.core.fixture
        goal = env.core.fixture.position - [0, 0, env.core.task.block.depth]
        error = env.core.state.tool.position - goal
        np.testing.assert_allclose(info["position_error"], error, atol=1e-12)
    jumps = np.linalg.norm(np.diff(moved, axis=0), axis=1)
    assert jumps.max() <= 0.03 * 0.005 + 1e-9


def test_a_hole_near_the_edge_moves_inwards(make):
    env = make(fixture_speed=0.02)
    corner = Pose(np.array([0.42, -0.20, 0.10]), HOLE.quat_wxyz)
    for seed in range(10):
        options = {"fixture": corner, "start": env.core.arm.facts.robot.posture("down")}
        _, info = env.reset(seed=seed, options=options)
        velocity = np.array(info["perturbation"]["fixture_velocity [m/s]"])
        end = corner.position + TRAVEL * velocity / 0.02
        assert end[0] >= 0.38 + 0.005
        assert end[1] >= -0.22 + 0.005


def test_starts_below_are_below_the_mouth_and_beside_the_block(make):
    env = make(start="below")
    for seed in range(20):
        _, info = env.reset(seed=seed, options={"fixture": HOLE})
        x, y, z = info["position_error"] - [0, 0, env.core.task.block.depth]
        assert z <= 1e-4
        assert max(abs(x), abs(y)) > 0.07


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"fixture_shift": 0.06}, "fixture_shift is 0.06 m; allowed: 0 to 0.05 m"),
        ({"push": -1.0}, "push is -1 N; allowed: 0 to 100 N"),
        ({"push": float("nan")}, "push is nan N"),
        ({"fixture_speed": 0.2}, "fixture_speed is 0.2 m/s; allowed: 0 to 0.1 m/s"),
        ({"start": "above"}, "start is 'above'; known: random, below"),
    ],
)
def test_what_is_out_of_range_is_refused_by_name(settings, words):
    with pytest.raises(ConfigError, match=words):
        Perturbation(**settings)


@pytest.mark.parametrize(
    ("settings", "address", "words"),
    [
        ({"push": 30.0}, "grpc://localhost:1", "--push needs a simulation"),
        (
            {"fixture_speed": 0.02},
            "grpc://localhost:1",
            "--fixture-speed needs a simulation",
        ),
        ({"push": 30.0}, "fri://0.0.0.0:1", "--push needs .*pushed by hand"),
        (
            {"fixture_speed": 0.02},
            "fri://0.0.0.0:1",
            "--fixture-speed needs a simulation",
        ),
    ],
)
def test_an_arm_that_cannot_be_perturbed_is_refused(settings, address, words):
    with pytest.raises(ConfigError, match=words):
        Perturbation(**settings).require_possible(parse_address(address))


def test_a_covered_camera_and_low_starts_need_nothing_of_the_arm():
    asked = Perturbation(fixture_shift=0.02, start="below")
    for address in ("grpc://localhost:1", "fri://0.0.0.0:1", "twin:easy"):
        asked.require_possible(parse_address(address))


def test_an_evaluation_under_perturbation_says_so_everywhere(policy_file, tmp_path):
    config = EvaluationConfig(
        policy=str(policy_file),
        plant="mujoco",
        tries=1,
        out=tmp_path / "out",
        fixture=(0.6, 0.0, 0.1, 0.0),
        fixture_shift=0.01,
        push=20.0,
        start="below",
    )
    text = StringIO()
    evaluation = evaluate(config, Console(file=text, width=200))
    assert evaluation.rows[-1].successes == 0  # 10 mm beside the hole
    title = (
        "camera covered and fixture moved by 10 mm, pushes of up to 20 N, starts below"
    )
    assert title in text.getvalue()
    report = json.loads((config.out / "report.json").read_text())
    assert report["config"]["fixture_shift"] == 0.01
    shift = report["tries"][0]["perturbation"]["fixture_shift [m]"]
    assert np.linalg.norm(shift) == pytest.approx(0.01)
    for words in ("--fixture-shift 0.01", "--push 20.0", "--start below"):
        assert words in report["command"]
    assert "fixture moved by 10 mm" in (config.out / "report.html").read_text()
    with pytest.raises(ConfigError, check=about("push")):
        evaluate(replace(config, push=200.0, out=tmp_path / "no"), Console(file=text))
    assert not (tmp_path / "no").exists()


def test_the_command_of_an_unperturbed_evaluation_has_none_of_it(policy_file):
    command = command_line(EvaluationConfig(policy=str(policy_file), plant="mujoco"))
    assert not any(w in command for w in ("hole-shift", "push", "hole-speed", "start"))
