"""The Rethink Sawyer: its frames and its masses are the maker's."""

import mujoco
import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.robots import sawyer as facts
from dovetail.robots.sawyer import sawyer
from dovetail.workcell.tool import FRANKA_HAND

ROBOT = sawyer()
# Joints of the maker's URDF as they are written there: xyz [m] and rpy [rad].
JOINTS = (
    ((0.0, 0.0, 0.08), (0.0, 0.0, 0.0)),
    ((0.081, 0.05, 0.237), (-np.pi / 2, np.pi / 2, 0.0)),
    ((0.0, -0.14, 0.1425), (np.pi / 2, 0.0, 0.0)),
    ((0.0, -0.042, 0.26), (-np.pi / 2, 0.0, 0.0)),
    ((0.0, -0.125, -0.1265), (np.pi / 2, 0.0, 0.0)),
    ((0.0, 0.031, 0.275), (-np.pi / 2, 0.0, 0.0)),
    ((0.0, -0.11, 0.1053), (-np.pi / 2, -0.17453, 3.1416)),
)
HAND = ((0.0, 0.0, 0.0245), (0.0, 0.0, 1.570796))


def words(values):
    return " ".join(map(str, values))


@pytest.fixture(scope="module")
def model():
    """The maker's arm with its head as a body of its own."""
    opening, closing = "", ""
    frames = zip(JOINTS, facts._LINKS, strict=True)
    for i, ((xyz, rpy), (mass, com, moments, products)) in enumerate(frames):
        full = words((*moments, *products))
        opening += (
            f'<body pos="{words(xyz)}" euler="{words(rpy)}"><joint axis="0 0 1"/>'
            f'<inertial pos="{words(com)}" mass="{mass}" fullinertia="{full}"/>'
        )
        closing += "</body>"
        if i == 0:
            mass, com, moments, products = facts._HEAD
            low = (com[0], com[1], 0.1021)
            full = words((*moments, *products))
            opening += (
                f'<body pos="0 0 0.2965"><inertial pos="{words(low)}" mass="{mass}" '
                f'fullinertia="{full}"/></body>'
            )
    site = f'<site name="hand" pos="{words(HAND[0])}" euler="{words(HAND[1])}"/>'
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" eulerseq="XYZ"/><worldbody>'
        f"{opening}{site}{closing}</worldbody></mujoco>"
    )


def test_it_is_the_makers_arm(model, rng):
    data, inertia, chain = mujoco.MjData(model), np.zeros((7, 7)), ROBOT.chain()
    for q in rng.uniform(ROBOT.limits.q_min, ROBOT.limits.q_max, (50, 7)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        position, rotation = chain.pose(q)
        np.testing.assert_allclose(position, data.site("hand").xpos, atol=1e-5)
        at = data.site("hand").xmat.reshape(3, 3)
        np.testing.assert_allclose(rotation, at, atol=1e-5)
        np.testing.assert_allclose(chain.gravity(q), data.qfrc_bias, atol=1e-3)  # Nm
        mujoco.mj_fullM(model, data, inertia)
        np.testing.assert_allclose(chain.inertia_matrix(q), inertia, atol=1e-3)


def test_it_carries_a_franka_hand():
    assert find_cell(robot="sawyer").tool.name == FRANKA_HAND.name
