"""Arms are read from URDF and MJCF files; other files are refused with their joints."""

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot import Robot
from extras import need

AXES = ("0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1")
HEIGHTS = (0.1475, 0.2125, 0.228, 0.192, 0.2075, 0.1925, 0.091)
INERTIA = '<inertia ixx="0.02" iyy="0.025" izz="0.01" ixy="0" ixz="0" iyz="0.001"/>'


def urdf(kinds=("revolute",) * 7, velocity='velocity="1.5"'):
    """An arm whose frames are all parallel to the base and whose axes are not z."""
    text = '<robot name="arm"><link name="base"/>'
    for i, kind in enumerate(kinds):
        parent = f"link{i}" if i else "base"
        height, axis = HEIGHTS[i % 7], AXES[i % 7]
        text += (
            f'<link name="link{i + 1}"><inertial><origin xyz="0.01 0.02 0.05"/>'
            f'<mass value="{3 - 0.3 * i}"/>{INERTIA}</inertial>'
            '<visual><geometry><mesh filename="package://gone/x.stl"/></geometry>'
            f'</visual></link><joint name="J{i + 1}" type="{kind}">'
            f'<parent link="{parent}"/><child link="link{i + 1}"/>'
            f'<origin xyz="0 0 {height}"/><axis xyz="{axis}"/>'
            + (kind != "continuous")
            * f'<limit lower="-2" upper="2" effort="{100 - i}" {velocity}/>'
            + "</joint>"
        )
    return (
        text
        + '<link name="hand"><inertial><origin xyz="0 0 0.03"/><mass value="0.5"/>'
        + f"{INERTIA}</inertial></link>"
        + f'<joint name="mount" type="fixed"><parent link="link{len(kinds)}"/>'
        + '<child link="hand"/><origin xyz="0 0 0.035"/></joint></robot>'
    )


def write(tmp_path, text, name="arm.urdf"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_urdf_with_other_axes_equals_pinocchio(tmp_path, rng):
    pin = need("pinocchio")
    path = write(tmp_path, urdf())
    robot = Robot.from_urdf(path, flange="hand")
    np.testing.assert_allclose(robot.limits.q_max, 2.0)
    np.testing.assert_allclose(robot.limits.dq_max, 1.5)
    np.testing.assert_allclose(robot.limits.tau_max, 100 - np.arange(7))
    model = pin.buildModelFromXML(path.read_text(encoding="utf-8"))
    data, hand = model.createData(), model.getFrameId("hand")
    chain = robot.chain()
    for _ in range(100):
        q, dq = rng.uniform(-2, 2, 7), rng.uniform(-2, 2, 7)
        pin.framesForwardKinematics(model, data, q)
        p, R = chain.pose(q)
        np.testing.assert_allclose(p, data.oMf[hand].translation, atol=1e-7)
        np.testing.assert_allclose(R, data.oMf[hand].rotation, atol=1e-7)
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        np.testing.assert_allclose(chain.inertia_matrix(q), M, atol=1e-7)
        bias = pin.nonLinearEffects(model, data, q, dq)
        mine = chain.coriolis(q, dq) + chain.gravity(q)
        np.testing.assert_allclose(mine, bias, atol=1e-6)


@pytest.mark.bullet
def test_the_urdf_of_pybullet_is_our_pybullet_set(rng):
    folder = need("pybullet_data").getDataPath()
    read = Robot.from_urdf(f"{folder}/kuka_iiwa/model.urdf").chain()
    own = iiwa14("pybullet")
    ours, flange = own.chain(), own.geometry.flange_position
    for _ in range(100):
        q, dq = rng.uniform(-2, 2, 7), rng.uniform(-1, 1, 7)
        p, R = read.pose(q)
        np.testing.assert_allclose(p + R @ flange, ours.pose(q)[0], atol=1e-6)
        M = ours.inertia_matrix(q)
        np.testing.assert_allclose(read.inertia_matrix(q), M, atol=1e-6)
        c = ours.coriolis(q, dq)
        np.testing.assert_allclose(read.coriolis(q, dq), c, atol=1e-6)


@pytest.mark.parametrize(
    ("kinds", "words"),
    [
        (("revolute",) * 6, r"has 6 joints \(J1, J2, J3, J4, J5, J6\)"),
        (("revolute",) * 8, r"has 8 joints \(J1, .*J8\)"),
        ((*("revolute",) * 6, "prismatic"), r"J7 \(slide\)\); .* these have 6"),
        ((*("revolute",) * 6, "continuous"), "joint J7 .* no dq_max"),
    ],
)
def test_an_arm_of_other_joints_is_refused_with_their_names(tmp_path, kinds, words):
    with pytest.raises(ConfigError, match=words):
        Robot.from_urdf(write(tmp_path, urdf(kinds)))


def test_seven_of_more_joints_can_be_chosen(tmp_path):
    path = write(tmp_path, urdf(("revolute",) * 8))
    names = [f"J{i}" for i in range(1, 8)]
    robot = Robot.from_urdf(path, joints=names)
    end = robot.links.mass[6]  # link8 and hand ride on it
    assert end == pytest.approx(1.2 + 0.9 + 0.5)
    with pytest.raises(ConfigError, match="has no joint 'J9'; known: J1, J2"):
        Robot.from_urdf(path, joints=[*names[:6], "J9"])
    with pytest.raises(ConfigError, match="J2 does not follow joint J3"):
        Robot.from_urdf(path, joints=["J1", "J3", "J2", *names[3:]])


def test_a_missing_limit_names_the_joint(tmp_path):
    path = write(tmp_path, urdf(velocity=""))
    with pytest.raises(ConfigError, match=r"joint J1 \(line 1\) no dq_max"):
        Robot.from_urdf(path)
    assert Robot.from_urdf(path, dq_max=np.ones(7)).limits.dq_max[3] == 1.0


def test_files_that_are_no_robot_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="cannot read robot file"):
        Robot.from_urdf(tmp_path / "absent.urdf")
    with pytest.raises(ConfigError, match=r"is not XML: .*line 1"):
        Robot.from_urdf(write(tmp_path, urdf()[:400]))
    with pytest.raises(ConfigError, match=r"root element <robot>, expected <mujoco>"):
        Robot.from_mjcf(write(tmp_path, urdf()))
    broken = urdf().replace("link3", "linkX", 1)
    with pytest.raises(ConfigError, match="is link3; the file's links: "):
        Robot.from_urdf(write(tmp_path, broken))
    with pytest.raises(ConfigError, match=r"no site or body 'wrist'; known: .*hand"):
        Robot.from_urdf(write(tmp_path, urdf()), flange="wrist")
