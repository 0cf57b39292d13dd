"""Facts of a robot's file are used, or it is said that they are not."""

import warnings

import numpy as np
import pytest
from arm_files import TORQUES, mjcf, urdf

from dovetail.cli import run
from dovetail.control.config import LimitConfig
from dovetail.errors import ConfigError, TorqueError, UnprovenWarning
from dovetail.plants.plant import DynamicsConfig
from dovetail.plugins import trust
from dovetail.robots.motors import Motors
from dovetail.robots.robot import Robot

HINGES = [f"axis{i}" for i in range(1, 8)]
BALANCED = '<mujoco><compiler balanceinertia="true" discardvisual="false"/></mujoco>'


@pytest.fixture
def read(tmp_path):
    """Return a function that reads an arm from a text, and what is said of it."""

    def load(text, **options):
        is_urdf = text.startswith("<robot")
        file = tmp_path / ("arm.urdf" if is_urdf else "arm.xml")
        file.write_text(text)
        kind = Robot.from_urdf if is_urdf else Robot.from_mjcf
        if not is_urdf:
            options.setdefault("dq_max", [1.0] * 7)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            robot = kind(file, **options)
        assert all(w.category is UnprovenWarning for w in said)
        assert [str(w.message) for w in said] == [*robot.notes, *robot.motors.notes]
        return robot

    return load


def test_motors_of_an_mjcf_file_are_used(read):
    robot = read(mjcf(joint='damping="2.5" armature="0.4" frictionloss="1.25"'))
    for name, value in (("damping", 2.5), ("armature", 0.4), ("coulomb", 1.25)):
        np.testing.assert_array_equal(vars(robot.motors)[name], value)
    assert robot.motors.notes == ()
    physics = DynamicsConfig.of_robot(robot)
    assert (physics.damping, physics.coulomb) == ((2.5,) * 7, (1.25,) * 7)
    assert physics.armature == (0.4,) * 7
    model = LimitConfig.for_period(robot, 1e-3)
    np.testing.assert_array_equal(model.damping, 2.5)
    np.testing.assert_array_equal(model.armature, 0.4)


def test_motors_of_a_urdf_are_used_joint_by_joint(read):
    robot = read(urdf(inside='<dynamics damping="1.75" friction="0.5"/>'))
    assert robot.motors.damping.tolist() == [0.5, 0.5, 1.75, *[0.5] * 4]
    assert robot.motors.coulomb.tolist() == [0, 0, 0.5, 0, 0, 0, 0]
    (note,) = robot.motors.notes
    assert "axis3" not in note
    assert "axis4" in note


def test_a_zero_that_a_file_says_is_no_default(read):
    robot = read(urdf(inside='<dynamics damping="0"/>'))
    assert robot.motors.damping[2] == 0.0


def test_what_a_file_does_not_say_is_noted_once(read):
    (note,) = read(mjcf()).motors.notes
    assert "damping" in note
    assert "armature" in note
    assert "0.1 kg m2" in note
    given = read(mjcf(), motors=Motors(damping=np.ones(7)))
    assert given.motors.notes == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (mjcf(joint='damping="1 2" armature="1"'), "linear"),
        (mjcf(joint='stiffness="20" damping="1" armature="1"'), "spring"),
        (
            mjcf(
                joint='damping="1" armature="1"',
                last='<equality><joint joint1="axis1" joint2="axis2"/></equality>',
            ),
            "equality",
        ),
        (
            mjcf(
                joint='damping="1" armature="1"',
                last='<actuator><motor joint="axis1" armature="3"/></actuator>',
            ),
            "actuators",
        ),
    ],
)
def test_what_cannot_be_used_is_noted(read, text, words):
    robot = read(text)
    notes = [*robot.notes, *robot.motors.notes]
    assert any(words in note for note in notes)


def test_the_command_prints_the_notes(tmp_path, monkeypatch, capsys):
    (tmp_path / "arm.urdf").write_text(urdf())
    (tmp_path / "noted_arm.py").write_text(
        "from dovetail.robots.robot import Robot\n"
        "def own(): return Robot.from_urdf('arm.urdf')\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    trust("noted_arm")
    run(["identify", "record", "--robot", "noted_arm:own", "--out", "x"])
    assert "note: arm.urdf does not give the damping" in capsys.readouterr().out


def test_torque_limits_of_actuators_are_used(read):
    text = mjcf(
        last="<actuator>"
        + "".join(
            f'<motor joint="{name}" gear="50" ctrlrange="-2 2"/>' for name in HINGES[:4]
        )
        + "".join(
            f'<position joint="{name}" kp="9" forcerange="-70 80"/>'
            for name in HINGES[4:]
        )
        + "</actuator>"
    ).replace('actuatorfrcrange="-90 90"', "")
    assert read(text).limits.tau_max.tolist() == [100.0] * 4 + [70.0] * 3


# -- Files of the kind that people have -----------------------------------------


def test_options_for_mujoco_in_a_urdf_join_dovetails_own(read):
    plain, told = read(urdf()), read(urdf(extra=BALANCED))
    np.testing.assert_array_equal(told.links.inertia, plain.links.inertia)


def test_an_inertia_that_no_body_has_is_named_with_its_line(read):
    with pytest.raises(ConfigError, match=r"link part4 \(line 9\)") as refused:
        read(urdf(inertia=(0.03, 0.01, 0.012)))
    assert "0.03 > 0.01 + 0.012" in str(refused.value)
    text = urdf(inertia=(0.03, 0.01, 0.014), extra=BALANCED)  # as the message advises
    np.testing.assert_allclose(
        read(text).links.inertia[3], 0.018 * np.eye(3), atol=1e-9
    )
    body = mjcf().replace(".02 .02 .02", ".03 .01 .012", 1)
    with pytest.raises(ConfigError, match=r"body part1 \(line 7\)"):
        read(body)


def test_a_flat_body_is_not_refused_for_rounding(read, rng):
    """MuJoCo refuses half of these, which are turned plates."""
    for _ in range(20):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        I = turn @ np.diag([0.02, 0.012, 0.008]) @ turn.T
        words = " ".join(f"{v:.17g}" for v in (*np.diag(I), I[0, 1], I[0, 2], I[1, 2]))
        text = mjcf().replace('diaginertia=".02 .02 .02"', f'fullinertia="{words}"')
        moments = np.linalg.eigvalsh(read(text).links.inertia[0])
        np.testing.assert_allclose(moments, [0.008, 0.012, 0.02], rtol=1e-5)


def test_a_frame_may_have_the_inertia_of_a_placeholder(read):
    ones = " ".join(
        f'{name}="1e-8"' for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    hand = (
        f'<link name="hand"><inertial><mass value="1e-8"/><inertia {ones}/></inertial>'
        '</link><joint name="mount" type="fixed"><parent link="part7"/>'
        '<child link="hand"/></joint>'
    )
    with_hand, plain = read(urdf(extra=hand)), read(urdf())
    np.testing.assert_allclose(with_hand.links.inertia, plain.links.inertia, atol=2e-8)
    heavy = hand.replace("1e-8", "1e-3")
    with pytest.raises(ConfigError, match="link hand"):
        read(urdf(extra=heavy))


def test_a_turned_rod_is_not_refused_for_rounding(read, rng):
    for _ in range(20):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        I = turn @ np.diag([0.0, 0.02, 0.02]) @ turn.T
        words = " ".join(f"{v:.17g}" for v in (*np.diag(I), I[0, 1], I[0, 2], I[1, 2]))
        text = mjcf().replace('diaginertia=".02 .02 .02"', f'fullinertia="{words}"')
        moments = np.linalg.eigvalsh(read(text).links.inertia[0])
        np.testing.assert_allclose(moments, [0.0, 0.02, 0.02], atol=1e-7)


GRIPPER = "".join(
    f'<link name="finger{i}"><inertial><mass value="0.05"/><inertia ixx="1e-5" '
    'iyy="1e-5" izz="1e-5"/></inertial></link>'
    f'<joint name="slide{i}" type="prismatic"><parent link="part7"/><child '
    f'link="finger{i}"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>'
    f'<limit lower="0" upper="0.04" effort="20" velocity="0.2"/>{mimic}</joint>'
    for i, mimic in enumerate(["", '<mimic joint="slide0"/>'])
)


def test_slides_of_a_gripper_are_said_and_welded(read):
    robot = read(urdf(extra=GRIPPER))
    assert any("slide0" in note for note in robot.notes)
    assert robot.links.mass[6] == pytest.approx(0.5 + 2 * 0.05)
    with pytest.raises(ConfigError, match="slide0"):
        read(urdf(extra=GRIPPER), joints=[*HINGES[:6], "slide0"])


@pytest.mark.parametrize("inside", ["<freejoint/>", '<joint type="ball"/>'])
def test_another_joint_is_welded_where_seven_are_named(read, inside):
    text = mjcf(body=f'<body>{inside}<inertial pos="0 0 0" mass="0.1" '
                     'diaginertia="1 1 1"/></body>')  # fmt: skip
    assert read(text, joints=HINGES).links.mass[2] == pytest.approx(3.1)


def test_a_joint_that_mimics_another_is_not_driven(read):
    text = urdf(inside='<mimic joint="axis2"/>')
    with pytest.raises(ConfigError, match="at most 6 of them in a row"):
        read(text)
    with pytest.raises(ConfigError, match=r"axis3 \(line 8\) mimics axis2"):
        read(text, joints=HINGES)


@pytest.mark.parametrize("kind", ["urdf", "mjcf"])
def test_a_link_without_mass_is_named(read, kind):
    text = mjcf(inertial=False)
    if kind == "urdf":
        text = urdf().replace('<mass value="3.0"/>', '<mass value="0"/>')
    with pytest.raises(ConfigError, match=r"part3 \(line \d+\), which joint axis3"):
        read(text)


def test_a_mass_comes_from_shapes_where_no_other_is_written(read, tmp_path):
    ball = mjcf(body='<geom size="0.05" density="1000"/>', inertial=False)
    mass = 1000 * 4 / 3 * np.pi * 0.05**3
    assert read(ball).links.mass[2] == pytest.approx(mass)
    corners = "v -1 -1 -1\nv 3 -1 -1\nv -1 3 -1\nv -1 -1 3\n"
    faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "x.obj").write_text(corners + faces)
    mesh = mjcf(
        top='<asset><mesh file="x.obj" scale="0.1 0.1 0.1"/></asset>',
        body='<geom type="mesh" mesh="x" density="1000"/>',
        inertial=False,
    )
    assert read(mesh).links.mass[2] == pytest.approx(1000 * 0.4**3 / 6)


def test_an_arm_in_two_files_is_read(read, tmp_path):
    whole = mjcf()
    first, rest = whole.split("<worldbody>")
    inner, last = rest.split("</worldbody>")
    (tmp_path / "bodies.xml").write_text(f"<mujocoinclude>{inner}</mujocoinclude>")
    include = '<worldbody><include file="bodies.xml"/></worldbody>'
    two = read(first + include + last)
    np.testing.assert_array_equal(two.links.mass, read(whole).links.mass)


# -- Torque ------------------------------------------------------------------------


def test_a_placeholder_speed_is_the_cause_that_is_named(read):
    fast = read(urdf(velocity=10, effort=280))
    with pytest.raises(TorqueError) as refused:
        LimitConfig.for_period(fast, 1e-3)
    assert refused.value.cause == "speed"
    assert refused.value.shares["speed"] > 100
    assert "payload" not in str(refused.value)
    assert "dq_max=" in str(refused.value)
    slow = read(urdf(velocity=10, effort=280), dq_max=[1.2] * 7)
    assert LimitConfig.for_period(slow, 1e-3).ddq_max[0] > 5


def test_each_other_cause_is_named(read):
    damped = read(mjcf(joint='damping="90" armature="0.1"'))
    weak = read(urdf(), tau_max=[*TORQUES[:3], 10, *TORQUES[4:]])
    heavy = read(mjcf(joint='damping="0" armature="99"'))
    for robot, cause in ((damped, "damping"), (weak, "gravity"), (heavy, "inertia")):
        with pytest.raises(TorqueError) as refused:
            LimitConfig.for_period(robot, 1e-3)
        assert refused.value.cause == cause
