"""A person leads the tool: by the gizmo, by a 3D mouse, alone or over a policy."""

import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from dovetail.cockpit.choice import NO_POLICY
from dovetail.cockpit.space_mouse import DEAD, SpaceMouse, without_rest
from dovetail.cockpit.teleoperator import Teleoperator
from dovetail.envs import registered
from dovetail.envs.teleop import LEAD_SPEED, TeleopWrapper, action_towards
from dovetail.episode import LED, Episode
from dovetail.errors import ConfigError, MissingDependencyError, install_command
from dovetail.poses import Pose, quat_about_z, quat_from_vector, quat_multiply

from .conftest import wait_until


class FakeDevice:
    """A 3D mouse whose cap a test moves."""

    def __init__(self):
        self.cap = np.zeros(6)
        self.error = None
        self.is_closed = False

    def read(self):
        if self.error is not None:
            raise self.error
        names = ("x", "y", "z", "roll", "pitch", "yaw")
        return SimpleNamespace(**dict(zip(names, self.cap.tolist(), strict=True)))

    def close(self):
        self.is_closed = True


@pytest.fixture
def device():
    return FakeDevice()


def goal_of(core):
    return core.task.goal(core.tracker.estimate().pose)


def make(**settings):
    env = registered.make("dovetail/PegInHole-v0", **settings)
    env.reset(seed=3)
    return env, env.unwrapped


def insert(session):
    """Lead the tool over the hole and in, as a person does: by looking."""
    core, teleoperator = session.core, session.teleoperator
    goal = goal_of(core)
    above = goal.position + np.array([0.0, 0.0, 0.05])
    teleoperator.grab(Pose(above, goal.quat_wxyz))
    wait_until(lambda: np.linalg.norm(session.snapshot.tool.position - above) < 0.002)
    teleoperator.move(Pose(goal.position, goal.quat_wxyz))


@pytest.mark.parametrize("damping", [0.0, 40.0])
@pytest.mark.parametrize("way", [(0.04, 0.0, 0.0), (0.0, -0.3, 0.02)])
def test_the_tool_arrives_where_it_is_led_and_is_never_faster_than_a_hand(damping, way):
    env, core = make(force_damping=damping)
    begin = core.state.tool.position
    to = Pose(begin + np.minimum(np.abs(way), 0.06) * np.sign(way), goal_of(core)[1])
    led = TeleopWrapper(env, lambda c: action_towards(c, to))
    speeds = []
    for _ in range(60):
        *_, info = led.step(np.zeros(4, dtype=np.float32))
        speeds.append(np.abs(core.state.tool.velocity[:3]).max())
        assert info["is_intervention"]
    assert max(speeds) < 1.3 * LEAD_SPEED
    assert np.linalg.norm(core.state.tool.position - to.position) < 0.002
    env.close()


@pytest.mark.parametrize("turns", [(0.15, 0.0, 0.0), (0.1, -0.12, 0.2)])
def test_turns_are_those_of_the_command_map(turns):
    env, core = make(task="XYZ:force ABC:pose", theta_range=0.3)
    x, y, z = (
        quat_from_vector(t * axis) for t, axis in zip(turns, np.eye(3), strict=True)
    )
    quat = quat_multiply(x, quat_multiply(y, quat_multiply(z, goal_of(core)[1])))
    action = action_towards(core, Pose(core.state.tool.position, quat))
    assert core.commands.axes == ("X", "Y", "Z", "A", "B", "C")
    np.testing.assert_allclose(0.3 * action[3:], turns[::-1], atol=1e-6)
    env.close()


def test_a_policys_action_passes_where_nobody_leads():
    env, _ = make()
    led = TeleopWrapper(env, lambda _: None)
    action = np.array([0.1, 0.2, -0.3, 0.4], dtype=np.float32)
    *_, info = led.step(action)
    assert info["is_intervention"] is False
    np.testing.assert_array_equal(info["action"], action)
    env.close()


@pytest.mark.parametrize(
    "wrong",
    [
        Pose(np.array([np.nan, 0.0, 0.0]), quat_about_z(0.0)),
        Pose(np.array([1e9, 0.0, 0.0]), quat_about_z(0.0)),
        Pose(np.zeros(3), np.zeros(4)),
        Pose(np.zeros(3), np.full(4, np.nan)),
    ],
)
def test_a_place_that_is_none_leads_nowhere(wrong):
    teleoperator = Teleoperator()
    with pytest.raises(ConfigError, match="cannot be led"):
        teleoperator.grab(wrong)
    assert not teleoperator.is_leading


def test_after_a_stop_the_gizmo_has_to_be_grabbed_anew():
    teleoperator = Teleoperator()
    place = Pose(np.zeros(3), quat_about_z(0.0))
    teleoperator.grab(place)
    assert teleoperator.is_leading
    teleoperator.let_go()
    teleoperator.move(place)  # the mouse is still down
    assert not teleoperator.is_leading


def test_a_person_leads_the_tool_in_without_a_policy_and_the_log_says_so(make_session):
    session = make_session(policy=NO_POLICY)
    session.demonstrate()
    wait_until(lambda: session.logger.is_demonstration)
    insert(session)
    wait_until(lambda: session.status.success)
    assert session.status.mode == "held"
    assert session.violations == 0
    session.close()
    (file,) = session.logger.demonstrations
    episode = Episode.load(file)
    assert episode[LED].all()
    assert episode.metadata["demonstration"] == "finished"
    assert episode.metadata["success"] is True


def test_a_correction_takes_over_from_a_policy_and_gives_back(session):
    session.start()
    wait_until(lambda: session.snapshot.stamp > 0.2)
    here = session.snapshot.tool.position + np.array([0.0, 0.0, 0.05])
    session.teleoperator.grab(Pose(here, session.snapshot.tool.quat_wxyz))
    wait_until(lambda: np.linalg.norm(session.snapshot.tool.position - here) < 0.003)
    assert session.status.mode == "led"
    session.teleoperator.let_go()
    wait_until(lambda: session.status.success)
    session.close()
    led = Episode.load(session.logger.files[0])[LED]
    first = int(np.argmax(led))
    assert led[0] == led[-1] == 0.0
    assert led[first] == 1.0
    assert np.abs(np.diff(led)).sum() == 2.0


def test_let_go_the_arm_is_held_and_a_stop_ends_the_lead(make_session):
    session = make_session(policy=NO_POLICY)
    begin = session.snapshot.tool.position
    far = Pose(begin + np.array([0.0, 0.1, 0.0]), session.snapshot.tool.quat_wxyz)
    session.teleoperator.grab(far)
    wait_until(lambda: session.snapshot.tool.position[1] > begin[1] + 0.01)
    session.stop()
    session.teleoperator.move(far)
    assert session.status.mode == "stopped"
    assert session.core.arm.is_held
    stamp = session.snapshot.stamp
    wait_until(lambda: session.snapshot.stamp > stamp + 0.5)
    rest = session.snapshot.tool.position
    wait_until(lambda: session.snapshot.stamp > stamp + 0.8)
    assert np.linalg.norm(session.snapshot.tool.position - rest) < 1e-4


def lead_a_little(session):
    session.demonstrate()
    wait_until(lambda: session.logger.is_demonstration and session.snapshot.stamp < 0.3)
    begin = session.snapshot.tool.position
    place = Pose(begin + np.array([0.0, 0.0, 0.03]), session.snapshot.tool.quat_wxyz)
    session.teleoperator.grab(place)
    wait_until(lambda: session.snapshot.tool.position[2] > begin[2] + 0.01)
    session.teleoperator.let_go()


def test_a_demonstration_cut_short_is_marked_and_one_thrown_away_loses_no_other(
    make_session,
):
    session = make_session(policy=NO_POLICY)
    lead_a_little(session)
    session.end_demonstration(is_kept=True)
    wait_until(lambda: "unfinished" in session.status.note)
    lead_a_little(session)
    session.end_demonstration(is_kept=False)
    wait_until(lambda: "thrown away" in session.status.note)
    lead_a_little(session)  # nobody decides: it is kept
    lead_a_little(session)
    session.close()
    kept = [Episode.load(file) for file in session.logger.demonstrations]
    assert [e.metadata["demonstration"] for e in kept] == ["unfinished"] * 3
    names = [file.name for file in session.logger.demonstrations]
    assert len(set(names)) == 3


def test_a_demonstration_that_ended_can_still_be_thrown_away(make_session):
    session = make_session(policy=NO_POLICY)
    lead_a_little(session)
    session.end_demonstration(is_kept=True)
    session.end_demonstration(is_kept=False)
    wait_until(lambda: "thrown away" in session.status.note)
    assert session.logger.demonstrations == []
    session.end_demonstration(is_kept=False)
    wait_until(lambda: "no demonstration" in session.status.note)


def test_a_cockpit_goes_on_with_the_numbers_of_an_earlier_one(make_session, tmp_path):
    files = []
    for _ in range(2):
        session = make_session(policy=NO_POLICY, logs=tmp_path / "same")
        lead_a_little(session)
        session.close()
        files += session.logger.demonstrations
    assert len(set(files)) == 2
    assert all(file.exists() for file in files)


def test_a_cap_at_rest_is_zero_and_a_full_one_is_one():
    raw = np.array([0.0, DEAD, -DEAD, 1.0, -1.0, np.nan])
    np.testing.assert_allclose(without_rest(raw), [0.0, 0.0, 0.0, 1.0, -1.0, 0.0])
    assert 0.0 < without_rest(np.full(6, DEAD + 0.01))[0] < 0.02


@pytest.mark.parametrize(
    ("heading", "wanted"), [(0.0, (1.0, 0.0)), (np.pi / 2.0, (0.0, 1.0))]
)
def test_a_cap_pushed_away_moves_the_tool_away_from_who_looks(device, heading, wanted):
    env, core = make()
    mouse, teleoperator = SpaceMouse(device), Teleoperator()
    teleoperator.take_mouse(mouse)
    teleoperator.heading = heading
    wait_until(lambda: teleoperator.action(core) is None)  # at rest first
    device.cap[1] = 1.0
    wait_until(lambda: teleoperator.is_leading)
    action = teleoperator.action(core)
    np.testing.assert_allclose(action[:2], wanted, atol=1e-5)
    env.close()
    teleoperator.take_mouse(None)
    assert device.is_closed


def test_a_cap_that_is_pushed_at_a_stop_leads_again_only_after_a_rest(device):
    teleoperator = Teleoperator()
    mouse = SpaceMouse(device)
    teleoperator.take_mouse(mouse)
    device.cap[0] = 0.5
    time.sleep(0.05)
    assert not teleoperator.is_leading  # it was pushed when it was switched on
    device.cap[0] = 0.0
    time.sleep(0.05)
    assert not teleoperator.is_leading
    device.cap[0] = 0.5
    wait_until(lambda: teleoperator.is_leading)
    teleoperator.let_go()
    time.sleep(0.05)
    assert not teleoperator.is_leading
    teleoperator.take_mouse(None)


def test_an_unplugged_mouse_holds_the_arm_and_loses_nothing(make_session, device):
    session = make_session(policy=NO_POLICY)
    session.demonstrate()
    wait_until(lambda: session.logger.is_demonstration)
    session.teleoperator.take_mouse(SpaceMouse(device))
    wait_until(lambda: not session.teleoperator.is_leading)
    time.sleep(0.05)
    device.cap[2] = 1.0
    begin = session.snapshot.tool.position[2]
    wait_until(lambda: session.snapshot.tool.position[2] > begin + 0.01)
    device.error = OSError("Failed to read from HID device: -1")
    wait_until(lambda: "cannot be read any more" in session.status.note)
    assert not session.teleoperator.has_mouse
    stamp = session.snapshot.stamp
    wait_until(lambda: session.snapshot.stamp > stamp + 0.5)
    rest = session.snapshot.tool.position
    wait_until(lambda: session.snapshot.stamp > stamp + 0.8)
    assert np.linalg.norm(session.snapshot.tool.position - rest) < 5e-4
    session.close()
    assert len(session.logger.demonstrations) == 1


def test_without_package_or_device_the_page_says_what_to_do(session, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyspacemouse", None)
    with pytest.raises(MissingDependencyError, match="pyspacemouse<3"):
        SpaceMouse()
    session.use_mouse(True)
    assert install_command("teach") in session.status.note
    none = SimpleNamespace(
        AxisConvention=SimpleNamespace(HID_Z_UP=0), open=lambda **_: 1 / 0
    )
    monkeypatch.setitem(sys.modules, "pyspacemouse", none)
    session.use_mouse(True)
    assert "plug one in" in session.status.note
    assert not session.teleoperator.has_mouse
