"""The C++ chain equals Pinocchio and MuJoCo: pose, J, dJ dq, M and bias."""

import mujoco
import numpy as np
import pytest

from dovetail.poses import quat_from_matrix
from dovetail.robots.find import DEFAULT_ROBOT, find_robot, list_robots
from dovetail.robots.iiwa14 import INERTIA_SETS, iiwa14
from dovetail.robots.robot import Robot
from extras import need

STATES = 200
TOLERANCE = 1e-9  # SI units; entries are at most about 100


@pytest.fixture(params=sorted({*INERTIA_SETS, *list_robots()} - {DEFAULT_ROBOT}))
def loaded(request, gripper) -> Robot:
    """Every inertia set, and other arms, with the gripper and a turned tool frame."""
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    tool_position = np.array([0.01, -0.02, 0.18])
    name = request.param
    bare = iiwa14(name) if name in INERTIA_SETS else find_robot(name)
    return bare.with_tool(gripper, tool_position, turn)


def random_states(robot, rng):
    for _ in range(STATES):
        q = rng.uniform(robot.limits.q_min, robot.limits.q_max)
        yield q, rng.uniform(-robot.limits.dq_max, robot.limits.dq_max)


def mjcf(robot: Robot) -> str:
    """Write the robot as MJCF, bodies and a TCP site only."""
    opening, closing, at = [], "", robot.geometry
    for i in range(7):
        pos = " ".join(f"{x:.17g}" for x in at.origin_position[i])
        quat = quat_from_matrix(at.origin_rotation[i])
        quat = " ".join(f"{x:.17g}" for x in quat)
        com = " ".join(f"{x:.17g}" for x in robot.links.com[i])
        I = robot.links.inertia[i]
        full = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
        full = " ".join(f"{x:.17g}" for x in full)
        low, high = robot.limits.q_min[i], robot.limits.q_max[i]
        opening.append(
            f'<body pos="{pos}" quat="{quat}"><inertial pos="{com}" '
            f'mass="{robot.links.mass[i]:.17g}" fullinertia="{full}"/>'
            f'<joint name="A{i + 1}" axis="0 0 1" range="{low:.17g} {high:.17g}"/>'
        )
        closing += "</body>"
    flange = at.flange_position + at.flange_rotation @ at.tool_position
    quat = quat_from_matrix(at.flange_rotation @ at.tool_rotation)
    pos = " ".join(f"{x:.17g}" for x in flange)
    quat = " ".join(f"{x:.17g}" for x in quat)
    site = f'<site name="tcp" pos="{pos}" quat="{quat}"/>'
    return (
        '<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody>'
        + "".join(opening)
        + site
        + closing
        + "</worldbody></mujoco>"
    )


def test_chain_equals_pinocchio(loaded, rng):
    pin = need("pinocchio")
    model, parent = pin.Model(), 0
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    at, links = loaded.geometry, loaded.links
    for i in range(7):
        place = pin.SE3(at.origin_rotation[i], at.origin_position[i])
        parent = model.addJoint(parent, pin.JointModelRZ(), place, f"A{i + 1}")
        link = pin.Inertia(float(links.mass[i]), links.com[i], links.inertia[i])
        model.appendBodyToJoint(parent, link, pin.SE3.Identity())
    position = at.flange_position + at.flange_rotation @ at.tool_position
    tool = pin.SE3(at.flange_rotation @ at.tool_rotation, position)
    frame = model.addFrame(pin.Frame("tcp", parent, tool, pin.FrameType.OP_FRAME))
    data, axes = model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    chain = loaded.chain()
    for q, dq in random_states(loaded, rng):
        pin.forwardKinematics(model, data, q, dq, np.zeros(7))
        pin.updateFramePlacements(model, data)
        p, R = chain.pose(q)
        np.testing.assert_allclose(p, data.oMf[frame].translation, atol=TOLERANCE)
        np.testing.assert_allclose(R, data.oMf[frame].rotation, atol=TOLERANCE)
        drift = pin.getFrameClassicalAcceleration(model, data, frame, axes)
        np.testing.assert_allclose(
            chain.jacobian_dot_dq(q, dq), drift.vector, atol=TOLERANCE
        )
        J = pin.computeFrameJacobian(model, data, q, frame, axes)
        np.testing.assert_allclose(chain.jacobian(q), J, atol=TOLERANCE)
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        np.testing.assert_allclose(chain.inertia_matrix(q), M, atol=TOLERANCE)
        gravity = pin.computeGeneralizedGravity(model, data, q)
        np.testing.assert_allclose(chain.gravity(q), gravity, atol=TOLERANCE)
        bias = pin.nonLinearEffects(model, data, q, dq)
        np.testing.assert_allclose(
            chain.coriolis(q, dq) + chain.gravity(q), bias, atol=TOLERANCE
        )


def test_chain_equals_mujoco(loaded, rng):
    model = mujoco.MjModel.from_xml_string(mjcf(loaded))
    data, chain, M = mujoco.MjData(model), loaded.chain(), np.zeros((7, 7))
    J, drift = np.zeros((6, 7)), np.zeros((6, 7))
    for q, dq in random_states(loaded, rng):
        data.qpos[:], data.qvel[:] = q, dq
        mujoco.mj_forward(model, data)
        p, R = chain.pose(q)
        np.testing.assert_allclose(p, data.site_xpos[0], atol=TOLERANCE)
        np.testing.assert_allclose(R.ravel(), data.site_xmat[0], atol=TOLERANCE)
        mujoco.mj_jacSite(model, data, J[:3], J[3:], 0)
        np.testing.assert_allclose(chain.jacobian(q), J, atol=TOLERANCE)
        body = int(model.site_bodyid[0])
        mujoco.mj_jacDot(model, data, drift[:3], drift[3:], data.site_xpos[0], body)
        np.testing.assert_allclose(
            chain.jacobian_dot_dq(q, dq), drift @ dq, atol=TOLERANCE
        )
        mujoco.mj_fullM(model, data, M)
        np.testing.assert_allclose(chain.inertia_matrix(q), M, atol=TOLERANCE)
        bias = chain.coriolis(q, dq) + chain.gravity(q)
        np.testing.assert_allclose(bias, data.qfrc_bias, atol=TOLERANCE)


def test_jacobian_is_the_derivative_of_the_pose(robot, rng):
    chain, step = robot.chain(), 1e-6
    for q, dq in random_states(robot, rng):
        ahead, behind = chain.pose(q + step * dq), chain.pose(q - step * dq)
        twist = chain.jacobian(q) @ dq
        speed = (ahead[0] - behind[0]) / (2 * step)
        np.testing.assert_allclose(speed, twist[:3], atol=1e-7)
        turn = (ahead[1] - behind[1]) @ chain.pose(q)[1].T / (2 * step)
        spin = [turn[2, 1], turn[0, 2], turn[1, 0]]
        np.testing.assert_allclose(spin, twist[3:], atol=1e-7)


def test_a_robot_read_from_mjcf_is_the_same_arm(loaded, rng, tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(mjcf(loaded), encoding="utf-8")
    read = Robot.from_mjcf(
        path, flange="tcp", dq_max=loaded.limits.dq_max, tau_max=loaded.limits.tau_max
    )
    np.testing.assert_allclose(read.limits.q_max, loaded.limits.q_max)
    mine, theirs = loaded.chain(), read.chain()
    for q, dq in random_states(loaded, rng):
        np.testing.assert_allclose(theirs.pose(q)[0], mine.pose(q)[0], atol=1e-9)
        np.testing.assert_allclose(theirs.pose(q)[1], mine.pose(q)[1], atol=1e-9)
        M = mine.inertia_matrix(q)
        np.testing.assert_allclose(theirs.inertia_matrix(q), M, atol=1e-9)
        c = mine.coriolis(q, dq)
        np.testing.assert_allclose(theirs.coriolis(q, dq), c, atol=1e-9)
