"""Robot facts agree with the published ones; bad ones are refused with their name."""

import pickle
import time
from dataclasses import replace

import numpy as np
import pytest

from dovetail.errors import ConfigError, ReachError
from dovetail.poses import Pose, matrix_from_quat, quat_about_z, quat_multiply
from dovetail.robots.iiwa14 import INERTIA_SETS, iiwa14
from dovetail.robots.inertia import merge_bodies
from dovetail.robots.robot import Payload

# Check pose, computed from the public models.
Q_CHECK = np.array([0.3, 0.5, -0.2, -1.2, 0.4, 0.9, 0.7])
P_CHECK = (0.649703, 0.140846, 0.577720)
R_CHECK = (
    (-0.707029, 0.502240, 0.497861),
    (0.681980, 0.670511, 0.292093),
    (-0.187120, 0.546049, -0.816588),
)
GRAVITY_CHECK = {
    "pybullet": (0, -32.76, -1.42, 14.34, -0.25, -0.15, 0),
    "drake": (0, -49.95, -2.35, 23.35, -0.40, -0.59, 0),
    "lbr": (0, -42.60, -1.82, 18.52, -0.34, -0.19, 0),
}
INERTIA_CHECK = {
    "pybullet": (1.535, 2.552, 0.494, 0.535, 0.013, 0.009, 0.001),
    "drake": (2.314, 3.682, 0.775, 0.835, 0.019, 0.017, 0.001),
    "lbr": (1.916, 3.199, 0.607, 0.661, 0.014, 0.010, 0.000),
}
DOWN = np.array([0.0, 1.0, 0.0, 0.0])


@pytest.mark.parametrize("inertia", INERTIA_SETS)
def test_flange_pose_gravity_and_inertia_at_the_check_pose(inertia):
    robot = iiwa14(inertia)
    pose = robot.tool_pose(Q_CHECK)
    np.testing.assert_allclose(pose.position, P_CHECK, atol=1e-6)
    np.testing.assert_allclose(matrix_from_quat(pose.quat_wxyz), R_CHECK, atol=2e-6)
    chain = robot.chain()
    np.testing.assert_allclose(
        chain.gravity(Q_CHECK), GRAVITY_CHECK[inertia], atol=0.006
    )
    np.testing.assert_allclose(
        np.diag(chain.inertia_matrix(Q_CHECK)), INERTIA_CHECK[inertia], atol=6e-4
    )


def test_the_arm_stretched_up_reaches_the_data_sheet_height():
    np.testing.assert_allclose(
        iiwa14().tool_pose(np.zeros(7)).position, [0, 0, 1.306], atol=1e-12
    )


def test_an_unknown_inertia_set_lists_the_known_ones():
    with pytest.raises(ConfigError, match=r"'kuka'.*drake, pybullet, lbr"):
        iiwa14("kuka")


def test_payload_moves_the_tcp_and_adds_its_gravity(gripper):
    bare, tool = iiwa14(), iiwa14().with_tool(gripper, np.array([0.0, 0.0, 0.18]))
    flange, tcp = bare.tool_pose(Q_CHECK), tool.tool_pose(Q_CHECK)
    R = matrix_from_quat(flange.quat_wxyz)
    np.testing.assert_allclose(tcp.position, flange.position + R[:, 2] * 0.18)
    assert tool.links.mass[6] == pytest.approx(bare.links.mass[6] + 1.2)
    at_com = iiwa14().with_tool(gripper, gripper.com)  # TCP where the payload hangs
    J = at_com.chain().jacobian(Q_CHECK)
    added = tool.chain().gravity(Q_CHECK) - bare.chain().gravity(Q_CHECK)
    np.testing.assert_allclose(added, J[2] * 1.2 * 9.81, atol=1e-10)


def test_a_second_payload_is_refused(robot, gripper):
    with pytest.raises(ConfigError, match="already carries"):
        robot.with_tool(gripper, np.zeros(3))


def test_merging_bodies_keeps_mass_and_second_moments(rng):
    masses, coms = rng.uniform(0.1, 3, 3), rng.normal(size=(3, 3))
    bodies = [(m, c, np.eye(3) * 0.01) for m, c in zip(masses, coms, strict=True)]
    mass, com, inertia = merge_bodies(*bodies)
    axis = np.array([0.6, 0.0, 0.8])
    about_origin = 0.0
    for m, c, body_inertia in bodies:
        arm = np.cross(axis, c)
        about_origin += m * arm @ arm + axis @ body_inertia @ axis
    arm = np.cross(axis, com)
    assert mass * arm @ arm + axis @ inertia @ axis == pytest.approx(about_origin)


@pytest.mark.parametrize(
    ("part", "field", "index", "value", "words"),
    [
        ("links", "mass", 2, 0.0, "link A3"),
        ("links", "mass", 0, np.nan, r"robot mass\[0\] is nan"),
        ("limits", "tau_max", 5, -1.0, r"tau_max\[A6\]"),
        ("limits", "q_max", 3, -3.0, "joint A4"),
        ("limits", "dq_max", 6, 0.0, r"dq_max\[A7\]"),
    ],
)
def test_a_wrong_fact_is_refused_with_its_joint(part, field, index, value, words):
    facts = vars(iiwa14())[part]
    wrong = np.array(vars(facts)[field])
    wrong[index] = value
    with pytest.raises(ConfigError, match=words):
        replace(facts, **{field: wrong})


def test_a_payload_no_body_can_have_is_refused():
    with pytest.raises(ConfigError, match="payload mass is -1"):
        Payload(mass=-1.0, com=np.zeros(3), inertia=np.eye(3))
    with pytest.raises(ConfigError, match="principal moments"):
        Payload(mass=1.0, com=np.zeros(3), inertia=np.diag([1.0, 1.0, 3.0]))
    with pytest.raises(ConfigError, match=r"payload com\[1\] is nan"):
        Payload(mass=1.0, com=np.array([0, np.nan, 0]), inertia=np.eye(3))


def test_a_robot_survives_pickling_with_its_chain_in_use(robot):
    robot.tool_pose(Q_CHECK)
    copy = pickle.loads(pickle.dumps(robot))
    np.testing.assert_array_equal(
        copy.tool_pose(Q_CHECK).position, robot.tool_pose(Q_CHECK).position
    )


def test_inverse_kinematics_finds_every_pose_of_the_workspace(robot, rng, q_home):
    durations = []
    for _ in range(200):
        position = rng.uniform([0.45, -0.15, 0.08], [0.75, 0.15, 0.35])
        quat = quat_multiply(quat_about_z(rng.uniform(-1.0, 1.0)), DOWN)
        start = time.perf_counter()
        q = robot.inverse_kinematics(Pose(position, quat), q_home)
        durations.append(time.perf_counter() - start)
        reached = robot.tool_pose(q)
        np.testing.assert_allclose(reached.position, position, atol=2e-6)
        assert abs(abs(reached.quat_wxyz @ quat) - 1.0) < 1e-10
        assert (q > robot.limits.q_min).all()
        assert (q < robot.limits.q_max).all()
    assert np.median(durations) < 0.02  # s; about 1 ms on an idle core


def test_inverse_kinematics_recovers_random_reachable_poses(robot, rng):
    found = 0
    for _ in range(100):
        q = rng.uniform(0.8 * robot.limits.q_min, 0.8 * robot.limits.q_max)
        seed = np.clip(
            q + rng.normal(0, 0.5, 7), robot.limits.q_min, robot.limits.q_max
        )
        pose = robot.tool_pose(q)
        answer = robot.inverse_kinematics(pose, seed)
        found += np.linalg.norm(robot.tool_pose(answer).position - pose.position) < 1e-5
    assert found == 100


def test_a_pose_out_of_reach_says_by_how_much(robot, q_home):
    with pytest.raises(ReachError, match=r"stays .* mm") as caught:
        robot.inverse_kinematics(Pose(np.array([1.5, 0.0, 0.3]), DOWN), q_home)
    assert caught.value.position_error == pytest.approx(0.45, abs=0.1)
    assert caught.value.joints == ()
    with pytest.raises(ConfigError, match="position is"):
        robot.inverse_kinematics(Pose(np.array([np.nan, 0.0, 0.3]), DOWN), q_home)


def test_a_pose_that_a_joint_keeps_out_of_reach_names_the_joint(robot, q_home):
    limits = replace(robot.limits, q_max=robot.limits.q_max * [1, 1, 1, 1, 1, 0.3, 1])
    stiff = replace(robot, limits=limits)
    down = robot.tool_pose(q_home)
    assert q_home[5] > limits.q_max[5]
    with pytest.raises(ReachError) as caught:
        stiff.inverse_kinematics(down, q_home)
    assert 5 in caught.value.joints
