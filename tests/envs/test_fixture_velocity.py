import gymnasium
import numpy as np
import pytest

from dovetail.envs.fixture_velocity import FASTEST, WINDOW, FixtureVelocity
from dovetail.envs.unwrapped import require_contact_env
from dovetail.poses import Pose
from dovetail.trackers.tracker import Estimate

STEP = 0.05


def follow(positions, age=0.0, step=STEP):
    """What is said of the velocity after each sight."""
    velocity = FixtureVelocity()
    pose = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return np.array(
        [
            velocity.follow(Estimate(pose._replace(position=p), age), k * step)[1]
            for k, p in enumerate(positions)
        ]
    )


@pytest.mark.parametrize("speed", [0.001, 0.02, 0.04, FASTEST])
@pytest.mark.parametrize("age", [0.0, 0.08])
def test_an_even_motion_is_found_as_it_is(speed, age):
    direction = np.array([0.6, -0.8, 0.0])
    positions = np.outer(np.arange(20) * STEP, speed * direction)
    found = follow(positions, age)
    assert not found[: WINDOW - 1].any()
    np.testing.assert_allclose(
        found[WINDOW:], speed * direction[None] * np.ones((12, 1))
    )


def test_a_fixture_that_stands_has_no_velocity_whatever_the_noise():
    rng = np.random.default_rng(0)
    assert not follow(np.full((50, 3), 0.3)).any()
    for sigma in (1e-5, 1e-3, 5e-3):
        found = follow(rng.normal(0.0, sigma, (3000, 3)))
        assert found.any(axis=1).mean() < 0.005


def test_another_place_is_no_motion():
    positions = np.zeros((30, 3))
    positions[10:] = [0.02, 0.0, 0.0]  # seen again after it was covered
    assert not follow(positions).any()


def test_nothing_is_followed_faster_than_it_may_be():
    positions = np.outer(np.arange(20) * STEP, [0.0, 1.3 * FASTEST, 0.0])
    speed = np.linalg.norm(follow(positions), axis=1)
    assert speed.max() == pytest.approx(FASTEST)


def test_a_sight_that_is_no_new_one_counts_once():
    velocity = FixtureVelocity()
    quat = np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(3 * WINDOW):
        seen = STEP * (k // 3 * 3)  # every third step there is a picture
        pose = Pose(np.array([0.02 * seen, 0.0, 0.0]), quat)
        _, found = velocity.follow(Estimate(pose, k * STEP - seen), k * STEP)
    np.testing.assert_allclose(found, [0.02, 0.0, 0.0])


@pytest.mark.parametrize("is_moving", [False, True])
def test_a_target_knows_how_its_fixture_moves(is_moving):
    env = gymnasium.make("dovetail/PegInHole-v0", tare=False)
    core = require_contact_env(env)
    env.reset(seed=1)
    velocity = np.array([0.0, 0.03, 0.0]) * is_moving
    core.slide_fixture(velocity)
    for _ in range(WINDOW + 1):
        env.step(np.zeros(4, dtype=np.float32))
    target = core.begin_step(np.zeros(4, dtype=np.float32))
    np.testing.assert_allclose(target.velocity_d, [*velocity, 0, 0, 0], atol=1e-12)
    env.reset(seed=2)
    assert not core.begin_step(np.zeros(4, dtype=np.float32)).velocity_d.any()
    env.close()


def test_what_is_seen_late_is_moved_on():
    velocity, quat = FixtureVelocity(), np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(2 * WINDOW):
        now = STEP * k
        late = Pose(np.array([0.02 * (now - 0.08), 0.0, 0.0]), quat)
        pose, _ = velocity.follow(Estimate(late, 0.08), now)
    np.testing.assert_allclose(pose.position, [0.02 * now, 0.0, 0.0])
    pose, found = velocity.follow(Estimate(late, 0.08 + 1.0), now + 1.0)  # covered
    np.testing.assert_array_equal(pose.position, late.position)
    assert not found.any()
