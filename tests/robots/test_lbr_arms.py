"""KUKA's LBR arms: lengths and weights of data sheets, masses of lbr_description."""

import importlib

import mujoco
import numpy as np
import pytest

from dovetail.robots.find import find_robot
from dovetail.robots.iiwa14 import iiwa14

TOP = {
    "iiwa14": 1.306,
    "iiwa7": 1.266,
    "med14": 1.306,
}  # m, the flange of the stretched arm
# kg: lbr_description's base, and the whole arm by KUKA
WEIGHT = {"iiwa7": (4.855658, 23.9), "med14": (8.146413, 32.3)}
AXES = ("0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1")


@pytest.fixture(params=TOP)
def name(request):
    return request.param


@pytest.fixture
def arm(name):
    return iiwa14("lbr") if name == "iiwa14" else find_robot(name)


def in_their_frames(name):
    """Return lbr_description's arm as it is there: all frames parallel at q = 0."""
    opening, closing = "", ""
    placed = importlib.import_module(f"dovetail.robots.{name}")._LBR
    for (origin, (mass, com, moments, products)), axis in zip(
        placed, AXES, strict=True
    ):
        pos, at = (" ".join(map(str, v)) for v in (origin, com))
        full = " ".join(map(str, (*moments, *products)))
        opening += (
            f'<body pos="{pos}"><joint axis="{axis}"/>'
            f'<inertial pos="{at}" mass="{mass}" fullinertia="{full}"/>'
        )
        closing += "</body>"
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{opening}{closing}</worldbody></mujoco>"
    )


def test_the_flange_is_as_high_as_the_data_sheet_has_it(name, arm):
    pose = arm.tool_pose(np.zeros(7))
    assert pose.position == pytest.approx([0.0, 0.0, TOP[name]], abs=1e-9)


@pytest.mark.parametrize("heavy", WEIGHT)
def test_it_weighs_what_the_data_sheet_says(heavy):
    base, whole = WEIGHT[heavy]
    assert find_robot(heavy).links.mass.sum() + base == pytest.approx(whole, abs=0.05)


def test_it_moves_as_in_lbr_description(name, arm, rng):
    model, chain = in_their_frames(name), arm.chain()
    data, inertia = mujoco.MjData(model), np.zeros((7, 7))
    for q in rng.uniform(arm.limits.q_min, arm.limits.q_max, (50, 7)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(chain.gravity(q), data.qfrc_bias, atol=1e-6)  # Nm
        mujoco.mj_fullM(model, data, inertia)
        np.testing.assert_allclose(chain.inertia_matrix(q), inertia, atol=1e-6)


def test_a_med_14_is_an_iiwa_14_in_shape_and_limits(rng):
    med, iiwa = find_robot("med14"), iiwa14()
    for name in med.limits.shapes:
        np.testing.assert_array_equal(vars(med.limits)[name], vars(iiwa.limits)[name])
    for q in rng.uniform(med.limits.q_min, med.limits.q_max, (20, 7)):
        mine, other = med.tool_pose(q), iiwa.tool_pose(q)
        np.testing.assert_allclose(mine.position, other.position, atol=1e-9)
        np.testing.assert_allclose(mine.quat_wxyz, other.quat_wxyz, atol=1e-9)
