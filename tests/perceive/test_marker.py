"""A camera as a tracker: in an environment, and when it does not see."""

import numpy as np
import pytest

from dovetail.envs.registered import make_env
from dovetail.poses import rotation_error
from dovetail.tasks.peg_in_hole.task import PegInHole

from .scene import beside


@pytest.fixture
def file(tmp_path, opengl):
    path = tmp_path / "camera.toml"
    path.write_text(beside().to_toml())
    return str(path)


def test_an_environment_is_told_what_the_camera_sees(file):
    env = make_env(PegInHole, tracker=file)
    env.reset(seed=3)
    ages = []
    for _ in range(4):
        env.step(np.zeros(4, dtype=np.float32))
        seen, age, covariance = env.tracker.estimate()
        ages.append(age)
        assert np.linalg.norm(seen.position - env.fixture.position) < 2e-3
        turn = rotation_error(seen.quat_wxyz, env.fixture.quat_wxyz)
        assert np.abs(turn).max() < 0.01
        assert 0.0 < np.sqrt(covariance[0, 0]) < 2e-3
    assert min(ages) >= 0.05
    assert max(ages) < 0.05 + 1.0 / 30.0 + 1e-6
    env.close()
