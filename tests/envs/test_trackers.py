"""Trackers: what each knows, when, and that the environment sees what they change."""

from types import SimpleNamespace

import numpy as np
import pytest

from dovetail.envs.registered import make_env
from dovetail.errors import ConfigError
from dovetail.plants.twin import load_twin
from dovetail.poses import Pose, quat_about_z, theta_about_vertical
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.trackers.find import find_tracker
from dovetail.trackers.late import Late
from dovetail.trackers.truth import Truth

PLACE = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))


def at(x):
    return PLACE._replace(position=np.array([x, 0.0, 0.1]))


def state(stamp):
    return SimpleNamespace(stamp=stamp)


def test_a_tracker_is_found_by_its_name_or_by_module_and_class():
    assert find_tracker("delayed?delay=0.2").delay == 0.2
    assert isinstance(find_tracker("dovetail.trackers.truth:Truth"), Truth)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "camera",
            "'camera' is unknown; known: covered, delayed, late, noisy, truth, ",
        ),
        ("delayed?delay=20", "tracker delay is 20 s; allowed: 0 to 10 s"),
        (
            "delayed?lag=0.1",
            "does not take these arguments.*it takes delay, rate, .*, as",
        ),
        ("late?inner=1", "inner is no number; it takes delay.*offset, as"),
        ("delayed?delay", "could not convert string to float"),
        ("delayed?delay=", "could not convert string to float"),
        ("os:sep", "it takes none"),
        ("builtins:int?real=1", "it takes none"),
        (":Camera", "no class 'Camera' in a module ''"),
        ("noisy?offset=x", "NAME.ARGUMENT=NUMBER"),
        ("no_module:Camera", "no class 'Camera' in a module 'no_module'"),
    ],
)
def test_a_wrong_tracker_says_what_is_known(text, words):
    with pytest.raises(ConfigError, match=words):
        find_tracker(text)


def test_a_delayed_tracker_tells_what_was_true():
    tracker = find_tracker("delayed")
    tracker.reset(at(0.60), 0)
    seen = []
    for step in range(1, 6):
        tracker.update(at(0.60 + 0.01 * step), state(0.05 * step))
        pose, age, _ = tracker.estimate()
        seen.append((round(pose.position[0], 3), round(age, 3)))
    assert seen == [(0.60, 0.05), (0.60, 0.1), (0.61, 0.1), (0.62, 0.1), (0.63, 0.1)]


def test_a_noisy_tracker_has_the_errors_that_it_says():
    tracker, offsets = find_tracker("noisy?offset=0.002&jitter=0.0005"), []
    for seed in range(400):
        tracker.reset(PLACE, seed)
        first = tracker.estimate().pose.position
        tracker.update(PLACE, state(0.05))
        offsets.append(
            [first - PLACE.position, tracker.estimate().pose.position - first]
        )
    spread = np.std(offsets, axis=0).mean(axis=1)
    np.testing.assert_allclose(spread, [0.00206, 0.00071], rtol=0.1)


def test_the_same_seed_gives_the_same_noise():
    envs = [make_env(PegInHole, tracker="noisy?offset=0.001") for _ in range(2)]
    first, second = (env.reset(seed=3)[0] for env in envs)
    np.testing.assert_array_equal(first, second)
    exact, _ = make_env(PegInHole).reset(seed=3)
    assert np.abs(first[7:10] - exact[7:10]).max() > 0.01
    np.testing.assert_array_equal(first[:7], exact[:7])  # the start is the same


class Drifting(Truth):
    """Moves its estimate in place, as a camera that reuses its buffer does."""

    def reset(self, fixture, seed):
        super().reset(Pose(fixture.position.copy(), fixture.quat_wxyz), seed)

    def update(self, fixture, state):
        self._fixture.position[0] += 0.01


def test_a_pose_that_changes_in_place_is_seen():
    env = make_env(PegInHole, tracker=Drifting())
    _, info = env.reset(seed=1)
    before = info["position_error"][0] - env.state.tool.position[0]
    *_, info = env.step(np.zeros(4, dtype=np.float32))
    after = info["position_error"][0] - env.state.tool.position[0]
    assert before - after == pytest.approx(0.01)
    env.close()


def late_errors(**settings):
    """Errors of the first look over 300 episodes: x y z [m], turn [rad]."""
    tracker, errors = Late(**settings), []
    for seed in range(300):
        tracker.reset(PLACE, seed)
        pose = tracker.estimate().pose
        turn = theta_about_vertical(pose.quat_wxyz, PLACE.quat_wxyz)
        errors.append([*(pose.position - PLACE.position), turn])
    return np.array(errors)


def test_a_late_tracker_is_beside_by_its_bias_in_every_direction():
    errors = late_errors(bias=0.002, turn=0.02)
    np.testing.assert_allclose(np.hypot(*errors[:, :2].T), 0.002)
    np.testing.assert_allclose(errors[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(errors[:, 3]), 0.02, atol=1e-9)
    assert np.abs(errors[:, :2].mean(axis=0)).max() < 4e-4
    assert 0.4 < (errors[:, 3] > 0.0).mean() < 0.6


def test_a_late_trackers_jitter_has_its_deviation():
    assert late_errors(jitter=0.001)[:, :3].std() == pytest.approx(0.001, rel=0.1)


@pytest.mark.parametrize(("delay", "rate"), [(0.0, 1000.0), (0.05, 30.0), (0.3, 5.0)])
def test_a_late_tracker_tells_what_was_true_at_its_look(delay, rate):
    tracker = Late(delay=delay, rate=rate)
    tracker.reset(at(0.60), 0)
    for step in range(1, 31):
        tracker.update(at(0.60 + 0.001 * step), state(0.05 * step))
        pose, age, _ = tracker.estimate()
        assert delay - 1e-9 <= age
        if step > 12:
            assert age <= delay + 1.0 / rate + 1e-9
            then = 0.60 + 0.02 * (0.05 * step - age)
            assert pose.position[0] == pytest.approx(then, abs=1e-9)


def test_lost_looks_let_the_estimate_grow_old():
    tracker, ages = Late(delay=0.0, rate=20.0, dropout=0.6), []
    tracker.reset(PLACE, 0)
    for step in range(1, 201):
        tracker.update(PLACE, state(0.05 * step))
        ages.append(tracker.estimate().age)
    assert np.mean(np.array(ages) > 0.05) == pytest.approx(0.6, abs=0.12)


@pytest.mark.parametrize("twin", ["easy", "medium", "hard"])
def test_the_tracker_twin_is_what_the_twins_file_says(twin):
    env = make_env(PegInHole, tracker="twin", twin=twin)
    camera = load_twin(twin).camera
    rate = camera.rate
    assert env.tracker.bias == camera.bias > 0.0
    assert (env.tracker.turn, env.tracker.rate) == (camera.turn, rate)
    env.reset(seed=1)
    told = env.tracker.estimate().pose.position - env.fixture.position
    assert np.linalg.norm(told) == pytest.approx(camera.bias)
    env.close()


def test_the_tracker_twin_needs_a_twin():
    with pytest.raises(ConfigError, match="give a --twin whose file has a table"):
        make_env(PegInHole, tracker="twin")
