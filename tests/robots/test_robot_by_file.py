"""A robot is named by its file: what is chosen for it, and what is carried of it."""

import json
import sys
import types
import warnings

import numpy as np
import pytest
from arm_files import mjcf, urdf

from dovetail.errors import ConfigError, MissingDependencyError, PolicyError
from dovetail.learn.config_file import load_config
from dovetail.learn.policy_env import policy_settings
from dovetail.plugins import module_of, named_modules, require_trusted
from dovetail.robots import menagerie as menagerie_module
from dovetail.robots.find import find_robot, robot_label, whole_robot
from dovetail.robots.robot import ANY_GRIPPER
from dovetail.tasks.peg_in_hole.task import PegInHole

HAND = (
    '<link name="tool0"/><joint name="end" type="fixed"><parent link="part7"/>'
    '<child link="tool0"/><origin xyz="0 0 0.1"/></joint>'
    '<link name="palm"><inertial><mass value="0.7"/><inertia ixx="1e-3" iyy="1e-3" '
    'izz="1e-3"/></inertial></link><joint name="wrist" type="fixed"><parent '
    'link="tool0"/><child link="palm"/></joint>'
)
FINGER = (
    '<link name="finger{0}"><inertial><mass value="0.05"/><inertia ixx="1e-5" '
    'iyy="1e-5" izz="1e-5"/></inertial></link><joint name="grip{0}" type="{1}">'
    '<parent link="palm"/><child link="finger{0}"/><axis xyz="0 1 0"/>'
    '<limit lower="0" upper="0.04" effort="20" velocity="0.2"/></joint>'
)


@pytest.fixture
def named(tmp_path):
    """Return a function that writes a file, and returns its path as it is typed."""

    def write(text):
        file = tmp_path / ("arm.urdf" if text.startswith("<robot") else "arm.xml")
        file.write_text(text)
        return str(file)

    return write


@pytest.fixture(autouse=True)
def quiet():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@pytest.mark.parametrize("text", [urdf(), mjcf()])
def test_a_file_is_a_robot(named, text):
    robot = find_robot(named(text))
    assert robot.name == "arm"
    assert robot.gripper == ANY_GRIPPER
    assert robot.limits.q_max.tolist() == [2.5] * 7


def test_a_file_that_is_not_there_says_so(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read .*gone\.urdf"):
        find_robot(str(tmp_path / "gone.urdf"))
    with pytest.raises(ConfigError, match="expand it first"):
        find_robot("arm.xacro")


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_hand_that_moves_is_left_out(named, kind):
    fingers = "".join(FINGER.format(i, kind) for i in range(2))
    robot = find_robot(named(urdf(extra=HAND + fingers)))
    assert robot.links.mass[6] == pytest.approx(0.5)
    np.testing.assert_allclose(robot.geometry.flange_position, [0, 0, 0.1], atol=1e-9)
    said = " ".join(robot.notes)
    assert "axis1 to axis7" in said
    assert "grip0, grip1" in said
    assert "palm (0.8 kg)" in said


def test_a_hand_without_named_flange_gives_its_mount(named):
    extra = (HAND + FINGER.format(0, "prismatic")).replace("tool0", "frame")
    robot = find_robot(named(urdf(extra=extra)))
    assert robot.geometry.flange_position[2] == pytest.approx(0.1)


def test_hands_without_names_are_left_out_too(named):
    hand = '<body><joint type="slide" range="0 0.1"/><geom size="0.01"/></body>'
    robot = find_robot(
        named(mjcf().replace("</body></body>", f"{hand * 2}</body></body>", 1))
    )
    assert robot.links.mass[6] == pytest.approx(0.5)
    said = next(note for note in robot.notes if "is left out" in note)
    assert "unnamed body 1, unnamed body 2 moves" in said


def test_a_total_that_scales_all_masses_is_refused(named):
    whole = mjcf().replace("<compiler ", '<compiler settotalmass="37.5" ')
    with pytest.raises(ConfigError, match="settotalmass"):
        find_robot(named(whole))


@pytest.mark.parametrize("name", ["a\0.xml", "~nobody-of-this-name/a.xml"])
def test_a_path_that_is_none_is_refused(name):
    with pytest.raises(ConfigError, match="cannot read robot file"):
        find_robot(name)


def test_a_text_is_read_whatever_the_file_is_called(tmp_path):
    file = tmp_path / "my\u00a0arm.urdf"
    extra = HAND + "".join(
        FINGER.format(str(i).rjust(77, "f"), "prismatic") for i in range(35)
    )
    file.write_text(urdf(extra=extra))
    robot = find_robot(whole_robot(str(file)))
    assert robot.name == "my arm"
    assert max(map(len, robot.notes)) == 2000


def test_an_eighth_hinge_in_the_row_is_not_guessed(named):
    with pytest.raises(ConfigError, match=r"8 joints.*joints=\[") as no:
        find_robot(named(urdf(extra=HAND + FINGER.format(0, "revolute"))))
    assert "joints=[...]" in str(no.value)


def test_of_two_arms_none_is_guessed(named):
    second = urdf().replace("part", "other").replace("axis", "second")
    inner = second.split('<link name="base"/>')[1].removesuffix("</robot>")
    with pytest.raises(ConfigError, match="2 rows of 7") as refused:
        find_robot(named(urdf(extra=inner)))
    assert "axis1 to axis7" in str(refused.value)
    assert "second1 to second7" in str(refused.value)


def test_a_joint_beside_the_arm_stays(named):
    head = HAND.replace("part7", "base") + FINGER.format(0, "revolute")
    robot = find_robot(named(urdf(extra=head)))
    assert any("grip0 stays at zero" in note for note in robot.notes)


def test_a_bad_inertia_of_the_base_does_not_matter(named):
    bad = '<inertial><mass value="1"/><inertia ixx="1" iyy="9" izz="1"/></inertial>'
    base = f'<link name="base">{bad}</link>'
    text = urdf().replace('<link name="base"/>', base)
    assert find_robot(named(text)).links.mass[0] == 4.0


def test_a_last_axis_that_looks_inward_does_not_turn_the_flange(named):
    before, _, after = urdf(extra=HAND).rpartition('<axis xyz="0 0 1"/>')
    geometry = find_robot(named(f'{before}<axis xyz="0 0 -1"/>{after}')).geometry
    assert geometry.flange_position[2] == pytest.approx(-0.1)
    assert geometry.flange_rotation[2, 2] == pytest.approx(-1.0)


def test_a_joint_without_end_has_a_turn_to_either_side(named):
    robot = find_robot(named(urdf(kind="continuous")))
    assert robot.limits.q_max[5] == pytest.approx(2 * np.pi)
    assert any("axis6" in n and "6.283" in n for n in robot.notes)


@pytest.mark.parametrize("speed", [10, 1e6])
def test_a_speed_that_no_joint_has_is_replaced_and_said(named, speed):
    robot = find_robot(named(urdf(velocity=speed)))
    assert robot.limits.dq_max.tolist() == [1.5] * 7
    assert any(f"{speed:g} rad/s" in note for note in robot.notes)


def test_equal_torques_are_said(named):
    robot = find_robot(named(urdf(effort=300)))
    assert any("every joint 300 Nm" in note for note in robot.notes)


def test_settings_hold_the_robot_and_not_its_path(named):
    path = named(urdf())
    text = whole_robot(path)
    ours, read = find_robot(path), find_robot(text)
    assert path not in text
    assert robot_label(text) == "arm"
    for name, array in ours.arrays().items():
        np.testing.assert_array_equal(array, read.arrays()[name])
    assert read.notes == ours.notes
    named(urdf(effort=200))
    assert find_robot(path).limits.tau_max[0] == 200.0
    assert find_robot(text).limits.tau_max[0] == 250.0
    assert whole_robot(text) == text
    assert whole_robot("iiwa14") == "iiwa14"


@pytest.mark.parametrize(
    "changed",
    [
        {"more": 1},
        {"name": "\x1b[2J"},
        {"name": ["arm"]},
        {"notes": ["line\nbreak"]},
        {"notes": ["x"] * 1000},
        {"arrays": {}},
        {"arrays": {"mesh_file": [1.0]}},
        {"postures": {"down": [0.0]}},
        {"postures": [1.0]},
        {"coulomb": "much"},
        {"gripper": "claw"},
    ],
)
def test_a_damaged_text_is_refused(named, changed):
    table = json.loads(whole_robot(named(urdf())))
    with pytest.raises(ConfigError):
        PegInHole().workcell(find_robot(json.dumps(table | changed)))


@pytest.mark.parametrize("text", ["{", "{}", '{"name": NaN}', "{" + " " * 100_000])
def test_a_text_that_is_none_is_refused(text):
    with pytest.raises(ConfigError):
        find_robot(text)


@pytest.mark.parametrize("name", ["secret.urdf", "/dev/zero.XML", "menagerie:panda"])
def test_no_file_makes_another_one_be_read(name):
    with pytest.raises(ConfigError, match="another file"):
        require_trusted("recording", "arm_model", name)
    with pytest.raises(PolicyError, match="another file"):
        policy_settings({"env_id": "dovetail/PegInHole-v0", "env": {"robot": name}})


def test_a_policy_may_carry_a_robot(named):
    text = whole_robot(named(urdf()))
    assert require_trusted("recording", "arm_model", text) == text
    assert module_of("robot", text) == ""
    settings = {"env": "x", "robot": text, "tracker": "truth"}
    assert named_modules(settings) == []
    env = {"env_id": "dovetail/PegInHole-v0", "env": {"robot": text}}
    assert "robot" not in policy_settings(env)


def test_a_settings_file_names_a_robot_that_lies_beside(named, tmp_path):
    named(urdf())
    (tmp_path / "own.toml").write_text("robot = 'arm.urdf'")
    assert find_robot(load_config(tmp_path / "own.toml").robot).name == "arm"


class _DownloadError(Exception):
    pass


@pytest.fixture
def menagerie(monkeypatch, tmp_path):
    """Put a registry of one robot in the place of the package, and return it."""

    def xml(model):
        if model not in found.entry_names:
            raise fake.UnknownEntryPointError(model)
        if not (tmp_path / f"{model}.xml").exists():
            raise fake.MenagerieError("HTTP 404")
        return tmp_path / f"{model}.xml"

    found = types.SimpleNamespace(
        default_model="arm", entry_names=("arm", "other"), xml=xml
    )
    fake = types.SimpleNamespace(
        names=lambda: ["some_arm"],
        get=lambda name: found,
        MenagerieError=_DownloadError,
        UnknownEntryPointError=type("UnknownEntryPointError", (_DownloadError,), {}),
    )
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", fake)
    return fake


def test_a_robot_of_the_menagerie_is_read_from_its_cache(menagerie, named):
    named(mjcf())
    assert find_robot("menagerie:some_arm").name == "arm"
    assert find_robot("menagerie:some_arm/arm").name == "arm"
    assert robot_label(whole_robot("menagerie:some_arm")) == "arm"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("some_ram", "did you mean some_arm"),
        ("some_arm/third", "known: arm, other"),
        ("some_arm/other", "prefetch some_arm"),
    ],
)
def test_what_the_menagerie_does_not_give_says_what_to_do(menagerie, name, words):
    with pytest.raises(ConfigError, match=words):
        find_robot(f"menagerie:{name}")


def test_the_menagerie_is_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    monkeypatch.setattr(menagerie_module, "install_command", lambda extra: extra)
    with pytest.raises(MissingDependencyError, match="menagerie"):
        find_robot("menagerie:some_arm")


def test_a_hinge_that_is_called_a_grippers_is_none_of_the_arms(named):
    jaw = FINGER.format(0, "revolute").replace("grip0", "jointGripper")
    robot = find_robot(named(urdf(extra=HAND + jaw)))
    assert any("axis1 to axis7; jointGripper stays at zero" in n for n in robot.notes)
    two = jaw + FINGER.format(1, "revolute")  # one by name, one that branches off
    assert find_robot(named(urdf(extra=HAND + two))).links.mass[6] == 0.5
    of_six = urdf().replace('name="axis7"', 'name="jointGripper"')
    with pytest.raises(ConfigError, match="at most 6 of them in a row") as no:
        find_robot(named(of_six))
    assert "by name: jointGripper" in str(no.value)
