"""The part in the fixture's frame, and actions that are given there."""

import numpy as np
import pytest

from dovetail.envs import registered
from dovetail.envs.unwrapped import require_contact_env
from dovetail.poses import matrix_from_quat
from dovetail.search.corner import SEARCH_AXES
from dovetail.search.led_part import LedPart

CORNER = np.array([0.01, 0.01, 0.0])


@pytest.fixture(scope="module", params=["up", "robot"])
def tilted(request):
    """An environment whose fixture is tilted, and the part in it."""
    env = registered.make(
        "dovetail/PegInHole-v0",
        task=SEARCH_AXES,
        theta_range=0.3,
        near_speed=0.05,
        facing=request.param,
        tilt=0.2,
    )
    env.reset(seed=0)
    core = require_contact_env(env)
    part = LedPart(core, 0.15)
    part.look(CORNER)
    assert core.task.goal(core.fixture).normal[2] < 0.99
    yield core, part
    env.close()


def test_a_turn_is_about_the_axis_of_a_tilted_fixture(tilted):
    core, part = tilted
    scale = np.array(core.commands.scale)
    x, up = np.eye(3)[[0, 2]]
    angles = part.action(np.zeros(3), x, 0.0, 0.1 * up)[3:] * scale[3:]
    vector = [np.sin(angles[2]), np.sin(angles[1]), np.sin(angles[0])]
    # As for the mouth, the tool would be turned by as much about the vertical.
    normal = matrix_from_quat(core.fixture.quat_wxyz)[:, 2]
    np.testing.assert_allclose(vector, 0.1 * normal, atol=0.006)


def test_it_is_seen_in_the_fixtures_frame(tilted):
    core, part = tilted
    R = matrix_from_quat(core.fixture.quat_wxyz)
    end = core.fixture.position + R @ part.end
    np.testing.assert_allclose(end, core.state.tool.position, atol=1e-12)
    assert np.linalg.norm(part.corner - part.end) == pytest.approx(np.hypot(0.01, 0.01))
    still = np.linalg.norm(R @ part.velocity - core.state.tool.velocity[:3])
    assert still < 1e-12


def test_a_way_through_the_air_is_made_as_fast_as_allowed(tilted):
    core, part = tilted
    damping = core.config.force_damping[0]
    far = part.through_air(np.array([0.0, 0.0, -1.0]))
    near = part.through_air(np.array([0.0, 0.0, -0.001]))
    assert damping * 0.15 > core.commands.scale[0]  # an action cannot ask for it
    assert np.abs(far).max() == pytest.approx(core.commands.scale[0])
    slow = LedPart(core, 0.05)
    slow.look(CORNER)
    far = slow.through_air(np.array([0.0, 0.0, -1.0]))
    assert np.abs(far).max() == pytest.approx(0.05 * damping)
    assert np.abs(near).max() == pytest.approx(0.01 * damping)
