"""What a person does in the cockpit, without a page."""

import time
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from dovetail.cockpit.choice import NO_POLICY, Choice, build
from dovetail.cockpit.disturbance import DRAG_SPEED, PULL_MAX
from dovetail.cockpit.recorded import Recorded
from dovetail.cockpit.replay_page import ReplayPage
from dovetail.cockpit.server import open_server
from dovetail.cockpit.session import RESUME_AFTER
from dovetail.episode import Episode
from dovetail.errors import ConfigError
from dovetail.learn.policy import PolicyError
from dovetail.poses import Pose, matrix_from_quat, theta_about_vertical
from dovetail.tasks.fixture_pose import UPRIGHT
from extras import need

from .conftest import PLAIN, resume, wait_until


def simulate(session, duration):
    """Wait until so much simulated time [s] has passed."""
    end = session.snapshot.stamp + duration
    wait_until(lambda: session.snapshot.stamp >= end - 1e-9)


def test_at_first_the_arm_is_held(session):
    begin = session.snapshot.tool.position
    simulate(session, 0.5)
    assert session.status.mode == "held"
    assert np.linalg.norm(session.snapshot.tool.position - begin) < 1e-4


def test_the_policy_finishes_and_what_it_did_can_be_replayed(session):
    session.start()
    wait_until(lambda: session.status.success)
    assert session.status.mode == "held"
    session.close()
    (file,) = session.logger.files
    episode = Episode.load(file)
    assert episode["reward"].max() > 10.0
    recorded = Recorded.load(file)
    q, _, fixture = recorded.at(recorded.end)
    np.testing.assert_array_equal(q, recorded.q[-1])
    np.testing.assert_allclose(fixture.position, session.snapshot.fixture.position)
    assert recorded.cell.name == session.core.cell.name


def test_a_stop_holds_the_arm_at_once_and_after_a_resume_a_start_goes_on(session):
    session.start()
    wait_until(lambda: session.snapshot.stamp > 0.4)
    session.stop()
    begin = session.snapshot.tool.position
    assert session.status.mode == "stopped"
    simulate(session, 0.5)
    rest = session.snapshot.tool.position
    assert np.linalg.norm(rest - begin) < 0.01
    simulate(session, 0.3)
    assert np.linalg.norm(session.snapshot.tool.position - rest) < 1e-4
    stamp = session.snapshot.stamp
    resume(session)
    assert session.status.mode == "held"
    simulate(session, 0.3)
    assert np.linalg.norm(session.snapshot.tool.position - rest) < 1e-4
    session.start()
    wait_until(lambda: session.status.success)
    assert session.snapshot.stamp > stamp  # no reset


def acts_of(session):
    """Everything by which a person moves the arm, or something in its cell."""
    above = session.snapshot.tool.position + np.array([0.0, 0.0, 0.05])
    fixture = session.snapshot.fixture.position
    return {
        "start": session.start,
        "reset": session.reset,
        "step": session.step,
        "demonstrate": session.demonstrate,
        "choose": lambda: session.choose(replace(session.choice, policy=NO_POLICY)),
        "pull": lambda: session.pull(above),
        "drag": lambda: session.drag(fixture + np.array([0.01, 0.0, 0.0]), 0.0),
        "lead": lambda: session.teleoperator.grab(
            Pose(above, session.snapshot.tool.quat_wxyz)
        ),
    }


ACTS = ("start", "reset", "step", "demonstrate", "choose", "pull", "drag", "lead")


@pytest.mark.parametrize("act", ACTS)
def test_after_a_stop_nothing_moves_the_arm_before_a_resume(session, act):
    simulate(session, 0.2)
    acts = acts_of(session)
    assert set(acts) == set(ACTS)
    acts[act]()  # just before, and on its way
    session.stop()
    simulate(session, 0.2)
    before, version = session.snapshot, session.version
    for _ in range(5):
        acts[act]()
        session.teleoperator.move(Pose(before.tool.position, before.tool.quat_wxyz))
        time.sleep(0.02)
    simulate(session, 0.3)
    after = session.snapshot
    assert session.status.mode == "stopped"
    assert session.status.is_stopped
    assert session.core.arm.is_held
    assert session.version == version
    assert not after.pull.any()
    moved = np.linalg.norm(after.tool.position - before.tool.position)
    assert moved < 1e-4
    np.testing.assert_array_equal(after.fixture.position, before.fixture.position)
    resume(session)
    simulate(session, 0.3)
    assert session.status.mode == "held"  # what came before is forgotten
    assert session.core.arm.is_held
    acts_of(session)[act]()


def test_a_resume_that_was_on_its_way_before_a_stop_does_not_end_it(session):
    begin = time.monotonic()
    session.stop()
    while time.monotonic() < begin + 0.8 * RESUME_AFTER:
        session.resume()
        session.start()
        assert session.is_stopped
        time.sleep(0.01)
    resume(session)
    assert time.monotonic() >= begin + RESUME_AFTER
    session.stop()
    session.resume()
    assert session.is_stopped


def test_what_was_wished_for_before_a_stop_is_forgotten_for_good(session, monkeypatch):
    """A reset of a real arm takes seconds: a start, a stop and a resume fit in."""
    reset, has_begun, may_end = session.core.reset, Event(), Event()

    def slow(**more):
        has_begun.set()
        may_end.wait(20.0)
        return reset(**more)

    with monkeypatch.context() as patched:
        patched.setattr(session.core, "reset", slow)
        session.reset()
        has_begun.wait(20.0)
        session.start()
        session.stop()
        resume(session)
        may_end.set()
        wait_until(lambda: session.status.mode == "held")
    simulate(session, 0.5)
    assert session.status.mode == "held"


def test_a_stop_while_a_reset_prepares_ends_it(session, monkeypatch):
    """The hold used to be cleared by the reset, and the arm went to its start."""
    reset, has_begun, may_end = session.core.reset, Event(), Event()

    def slow(**more):
        has_begun.set()
        may_end.wait(20.0)
        return reset(**more)

    with monkeypatch.context() as patched:
        patched.setattr(session.core, "reset", slow)
        session.reset()
        has_begun.wait(20.0)
        session.stop()
        may_end.set()
        wait_until(lambda: "STOP was pressed before" in session.status.note)
    assert session.core.arm.is_held
    resume(session)
    session.reset()
    wait_until(lambda: session.status.mode == "held")


@pytest.mark.parametrize("far", [0.02, 0.5])
def test_the_tool_follows_a_pull_of_at_most_so_much(session, far):
    begin = session.snapshot.tool.position
    way = np.array([0.0, far, 0.0])
    session.pull(begin + way)
    simulate(session, 0.5)
    moved = (session.snapshot.tool.position - begin)[1]
    assert moved > 1e-4
    assert 0.0 < np.linalg.norm(session.snapshot.pull) <= PULL_MAX + 1e-9
    assert max(session.snapshot.used) < 100.0
    session.pull(None)
    wait_until(lambda: (session.snapshot.tool.position - begin)[1] < 0.5 * moved)
    assert not session.snapshot.pull.any()


def test_a_pull_to_the_end_of_the_world_is_as_hard_as_any(session):
    session.pull(np.array([-1e308, 1e308, 0.0]))
    simulate(session, 0.5)
    assert np.linalg.norm(session.snapshot.pull) == pytest.approx(PULL_MAX)
    assert session.violations == 0
    with pytest.raises(ConfigError, match="nan"):
        session.pull(np.array([0.0, np.nan, 0.0]))
    session.stop()
    assert session.disturbance.pull_to is None
    simulate(session, 0.1)
    assert session.status.mode == "stopped"


def test_a_dragged_fixture_follows_no_faster_than_a_hand(session):
    before = session.snapshot
    begin = before.fixture
    session.drag(begin.position + np.array([0.03, 0.02, 0.0]), 0.1)
    simulate(session, 0.1)
    after = session.snapshot
    moved = np.linalg.norm(after.fixture.position - begin.position)
    assert 0.0 < moved <= DRAG_SPEED * (after.stamp - before.stamp) + 1e-9
    simulate(session, 0.5)
    np.testing.assert_allclose(
        session.snapshot.fixture.position,
        begin.position + np.array([0.03, 0.02, 0.0]),
        atol=1e-9,
    )
    assert session.core.fixture is session.snapshot.fixture


def test_a_dragged_fixture_keeps_its_tilt(make_session):
    session = make_session(fixture=(0.6, 0.0, 0.1, 0.1, 0.15, -0.1))
    wait_until(lambda: session.snapshot is not None)
    begin = session.snapshot.fixture
    session.drag(begin.position + np.array([0.01, 0.0, 0.0]), 0.2)
    simulate(session, 1.0)
    end = session.snapshot.fixture.quat_wxyz
    assert theta_about_vertical(end, np.array(UPRIGHT)) == pytest.approx(0.2)
    rows = [matrix_from_quat(quat)[2] for quat in (begin.quat_wxyz, end)]
    assert rows[0][2] < 0.99
    np.testing.assert_allclose(*rows, atol=1e-9)  # a turn about the vertical alone


def test_a_fixture_out_of_reach_is_refused_and_stays(session):
    begin = session.snapshot.fixture
    with pytest.raises(ConfigError, match=r"outside the workspace|can be reached"):
        session.drag(begin.position + np.array([0.5, 0.0, 0.0]), 0.0)
    simulate(session, 0.1)
    np.testing.assert_array_equal(session.snapshot.fixture.position, begin.position)


def test_a_covered_camera_believes_what_it_saw_last(session):
    seen = session.snapshot.believed
    session.cover(True)
    simulate(session, 0.1)
    session.drag(seen.position + np.array([0.01, 0.0, 0.0]), 0.0)
    simulate(session, 0.3)
    np.testing.assert_array_equal(session.snapshot.believed.position, seen.position)
    session.cover(False)
    simulate(session, 0.1)
    now = session.snapshot
    np.testing.assert_array_equal(now.believed.position, now.fixture.position)


def test_the_scripted_search_acts_in_the_place_of_a_policy(session):
    session.choose(replace(session.choice, policy="corner"))
    wait_until(
        lambda: session.choice.policy == "corner" and session.status.mode == "held"
    )
    session.start()
    simulate(session, 1.5)
    down = matrix_from_quat(session.core.state.tool.quat_wxyz)[2, 2]
    assert np.arccos(-down) > 0.1  # rad: it tilts the part


@pytest.mark.parametrize("place", ["fri://0.0.0.0", "grpc://127.0.0.1:1"])
def test_a_robot_that_may_touch_harder_needs_a_yes(place):
    with pytest.raises(ConfigError, match="--accept-contact"):
        build(Choice(policy="corner", place=place))


def test_paused_time_stands_still_but_for_single_steps(session):
    session.pause()
    wait_until(lambda: session.status.mode == "paused")
    time.sleep(0.05)
    begin = session.snapshot.stamp
    time.sleep(0.1)
    assert session.snapshot.stamp == begin
    for count in (1, 2):
        session.step()
        end = begin + 0.05 * count
        wait_until(lambda end=end: session.snapshot.stamp > end - 1e-9)
        time.sleep(0.05)
        assert session.snapshot.stamp == pytest.approx(end)
    session.pause(False)
    simulate(session, 0.1)


def test_another_choice_is_built_and_the_fixture_stays_where_it_was_dragged(session):
    place = session.snapshot.fixture.position + np.array([0.01, 0.0, 0.0])
    session.drag(place, 0.0)
    simulate(session, 0.4)
    version = session.version
    session.choose(Choice(policy=NO_POLICY, place="twin:easy"))
    wait_until(lambda: session.version > version)
    wait_until(lambda: session.status.mode == "held")
    np.testing.assert_allclose(session.snapshot.fixture.position, place, atol=1e-9)
    session.start()
    wait_until(lambda: "no policy" in session.status.note)


@pytest.mark.parametrize(
    "wrong",
    [
        Choice(policy="nobody_made_it", place="mujoco"),
        Choice(place="twin:nowhere"),
        Choice(policy="peg_square", env="dovetail/RailClip-v0"),
        Choice(policy="peg_square", settings={"peg": "star"}),
    ],
)
def test_a_wrong_choice_is_told_and_changes_nothing(session, wrong):
    before = session.choice
    session.choose(wrong)
    wait_until(lambda: session.status.note)
    assert session.choice is before
    simulate(session, 0.1)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (Choice(policy="nobody_made_it"), "no policy"),
        (Choice(policy="peg_square", env="dovetail/RailClip-v0"), "trained in"),
    ],
)
def test_a_session_that_cannot_be_built_says_why(make_session, wrong, why):
    with pytest.raises((ConfigError, PolicyError), match=why):
        make_session(policy=wrong.policy) if wrong.env is None else make_wrong(wrong)


def make_wrong(choice):
    from dovetail.cockpit.session import Session

    Session(choice)


def test_while_the_arm_is_only_held_nothing_is_written(session):
    simulate(session, 0.3)
    session.reset()
    simulate(session, 0.1)
    session.close()
    assert session.logger.files == []


def test_each_reset_begins_a_log_and_says_where_the_fixture_went(session):
    for count in (1, 2):
        begin = session.snapshot.fixture.position
        session.drag(begin + np.array([0.005, 0.0, 0.0]), 0.0)
        simulate(session, 0.2)
        session.reset()
        wait_until(lambda: session.snapshot.stamp < 0.1)
        session.logger.flush()
        assert len(session.logger.files) == count
    first, second = (Recorded.load(file) for file in session.logger.files)
    fixtures = first.fixtures
    before, after = fixtures[0][1].position, fixtures[-1][1].position
    np.testing.assert_allclose(after - before, [0.005, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(second.fixtures[0][1].position, after)


def test_what_was_believed_and_pulled_is_drawn_again_in_the_replay(session):
    need("viser")
    session.cover(True)
    session.reset()
    simulate(session, 0.1)
    begin = session.snapshot.fixture.position
    session.drag(begin + np.array([0.0, 0.02, 0.0]), 0.0)
    session.pull(session.snapshot.tool.position + np.array([0.0, 0.0, 0.05]))
    simulate(session, 0.4)
    session.close()
    recorded = Recorded.load(session.logger.files[-1])
    end = recorded.end
    np.testing.assert_allclose(recorded.believed_at(end).position, begin)
    assert recorded.at(end)[2].position[1] > begin[1] + 0.015
    assert recorded.pull_at(0.0)[2] == 0.0
    assert recorded.pull_at(end)[2] > 5.0
    server = open_server(0)
    page = ReplayPage(server, (recorded,))
    (scene,) = page.scenes
    assert not scene.pull.visible
    page.seek(end)
    wait_until(lambda: scene.pull.visible)
    assert scene.believed.visible
    np.testing.assert_allclose(scene.believed.position, begin)
    page.close()
    server.stop()


def test_a_log_that_cannot_be_written_is_told_and_the_arm_goes_on(
    make_session, tmp_path
):
    (tmp_path / "file").write_text("in the way")
    session = make_session(logs=tmp_path / "file" / "logs")
    session.pull(session.snapshot.tool.position)
    simulate(session, 0.1)
    session.reset()
    wait_until(lambda: session.logger.problem)
    assert "is lost" in session.logger.problem
    simulate(session, 0.1)


def test_a_simulated_camera_tells_where_the_fixture_is(opengl, make_session, tmp_path):
    need("cv2")
    text = (Path(__file__).parents[2] / "examples" / "beside.toml").read_text()
    file = tmp_path / "camera.toml"
    file.write_text(text)
    session = make_session(policy=NO_POLICY, settings={**PLAIN, "tracker": str(file)})
    session.reset()
    simulate(session, 0.2)
    assert session.status.mode == "held"
    error = session.snapshot.believed.position - session.snapshot.fixture.position
    assert 0.0 < np.linalg.norm(error) < 0.005


def test_a_camera_on_the_arm_looks_from_above_first(opengl, make_session):
    """Its shutter hid that it is on the arm, and a page asked before it had looked."""
    need("cv2")
    file = Path(__file__).parents[2] / "examples" / "flange.toml"
    session = make_session(policy=NO_POLICY, settings={**PLAIN, "tracker": str(file)})
    error = session.snapshot.believed.position - session.snapshot.fixture.position
    assert 0.0 < np.linalg.norm(error) < 0.005


def test_a_policy_that_waited_for_its_start_has_its_whole_time(make_session):
    session = make_session(policy="peg_near", settings={**PLAIN, "fall_back": 0.5})
    core = session.core
    wait_until(lambda: core.is_searching)  # the arm is held, and time passes
    session.start()
    wait_until(lambda: session.status.mode == "running")
    assert not core.is_searching
    wait_until(lambda: core.is_searching)
