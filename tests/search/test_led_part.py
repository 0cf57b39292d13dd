"""The part in the fixture's frame, and actions that are given there."""

import numpy as np
import pytest

from dovetail.envs import registered
from dovetail.envs.unwrapped import require_contact_env
from dovetail.poses import matrix_from_quat, quat_from_vector, quat_multiply
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


def test_it_is_seen_in_the_fixtures_frame(tilted, monkeypatch):
    core, part = tilted
    R = matrix_from_quat(core.fixture.quat_wxyz)
    end, velocity, turn = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), 0.2
    goal = core.task.goal(core.fixture).quat_wxyz
    turned = quat_multiply(quat_from_vector(turn * R[:, 2]), goal)
    tool = core.state.tool._replace(
        position=core.fixture.position + R @ end,
        quat_wxyz=turned,
        velocity=np.append(R @ velocity, np.zeros(3)),
    )
    monkeypatch.setattr(core, "state", core.state._replace(tool=tool))
    part.look(CORNER)
    np.testing.assert_allclose(part.end, end, atol=1e-9)
    np.testing.assert_allclose(part.velocity, velocity, atol=1e-9)
    np.testing.assert_allclose(part.turned, [0.0, 0.0, turn], atol=1e-9)
    assert part.yaw == pytest.approx(turn)
    c, s = np.cos(turn), np.sin(turn)
    out = [c * 0.01 - s * 0.01, s * 0.01 + c * 0.01, 0.0]
    np.testing.assert_allclose(part.corner - end, out, atol=1e-9)


def test_a_force_is_given_in_the_fixtures_frame_and_a_tilt_lowers_the_corner(tilted):
    core, part = tilted
    R, scale = matrix_from_quat(core.fixture.quat_wxyz), np.array(core.commands.scale)
    force, axis = np.array([1.0, -2.0, 0.5]), np.array([-np.sqrt(0.5), np.sqrt(0.5), 0])
    action = part.action(force, axis, 0.1, np.zeros(3)) * scale
    np.testing.assert_allclose(action[:3], R @ force, rtol=1e-5)
    about_z, about_y, about_x = action[3:].astype(float)
    tilt = np.eye(3)
    for about, angle in zip(np.eye(3)[::-1], (about_z, about_y, about_x), strict=True):
        tilt = matrix_from_quat(quat_from_vector(angle * about)) @ tilt
    lowered = R.T @ tilt @ R @ CORNER
    assert lowered[2] == pytest.approx(-np.sin(0.1) * np.hypot(0.01, 0.01), rel=1e-4)
    far = part.action(1e3 * force, axis, 0.0, np.zeros(3))
    assert np.abs(far).max() == 1.0


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
