"""An arm that another process owns: the page shows it, and nothing is lost with it."""

import time

import numpy as np
import pytest

from arms.loopback import LOOPBACK, free_port, make_cabinet
from dovetail.arms.address import parse_address
from dovetail.cockpit.choice import NO_POLICY
from dovetail.cockpit.page import Page
from dovetail.cockpit.server import open_server
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.poses import Pose, quat_about_z
from extras import need

from .conftest import resume, wait_until

Q_NEAR = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.5])


@pytest.fixture
def service():
    """A simulation behind gRPC."""
    need("grpc")
    from dovetail.rpc.offered_arm import OfferedArm
    from dovetail.rpc.server import ArmServer

    arm = OfferedArm(parse_address("mujoco"), find_cell())
    with ArmServer(arm, "127.0.0.1:0") as server:
        yield server


def offered(session):
    """What the page of a session offers of what a simulation's page does."""
    need("viser")
    server = open_server(0)
    page = Page(server, session)
    page.close()
    server.stop()
    return page.panel.offered


def test_the_page_of_a_simulation_offers_to_pause_step_and_pace_it(session):
    assert offered(session) == ("Start", "Pause", "Step", "Reset", "Speed")


def test_a_simulation_behind_grpc_is_paced_and_not_paused(make_session, service):
    session = make_session(place=service.url)
    session.reset()
    session.start()
    session.pause()
    session.pace.speed = 0.25
    wait_until(
        lambda: session.snapshot is not None and session.status.mode == "running"
    )
    begin, stamp = time.monotonic(), session.snapshot.stamp
    wait_until(lambda: session.snapshot.stamp > stamp + 0.2)
    assert time.monotonic() - begin > 0.5


def test_the_page_of_an_arm_that_has_not_moved_yet_is_drawn_and_then_shows_it(
    make_session, service
):
    need("viser")
    session = make_session(place=service.url)
    assert session.snapshot is None
    server = open_server(0)
    page = Page(server, session)
    assert page.panel.offered == ("Start", "Reset", "Speed")
    wait_until(lambda: page.frames > 10)
    assert session.status.mode == "stopped"
    session.reset()
    wait_until(lambda: session.status.mode == "held")
    frames = page.frames
    wait_until(lambda: page.frames > frames + 10)
    normal, _ = session.snapshot.near
    np.testing.assert_allclose(normal, [0.0, 0.0, 1.0], atol=1e-9)
    page.close()
    server.stop()


def test_a_service_that_dies_is_told_at_a_stop_too_and_the_log_is_kept(
    make_session, service
):
    session = make_session(place=service.url)
    session.reset()
    session.start()
    wait_until(lambda: session.snapshot is not None and session.snapshot.stamp > 0.3)
    service.close()
    wait_until(lambda: session.status.mode == "stopped")
    assert "Reset begins anew" in session.status.note
    session.stop()
    assert "STOP did not reach the arm" in session.status.note
    session.close()
    assert [file.exists() for file in session.logger.files] == [True]


def test_a_service_that_dies_while_the_arm_is_held_is_told_without_a_step(
    make_session, service
):
    session = make_session(place=service.url)
    session.reset()
    wait_until(lambda: session.status.mode == "held")
    service.close()
    wait_until(lambda: session.status.mode == "stopped")
    assert "the held arm follows no more: no answer at" in session.status.note
    assert "Reset begins anew" in session.status.note


def test_a_cabinet_that_ends_while_the_arm_is_held_is_told_without_a_step(
    make_session, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # the last seconds of the motion are written there
    port, plant = free_port(), make_plant("mujoco", find_cell(), DynamicsConfig())
    plant.reset(Q_NEAR, Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0)))
    with make_cabinet(plant, port, 0.005, clock="wall") as cabinet:
        place = f"fri://{LOOPBACK}:{port}?period=5ms&approach=yes"
        session = make_session(place=place, fixture=(0.6, 0.0, 0.1, 0.0))
        session.reset()
        wait_until(lambda: session.status.mode == "held", timeout=20.0)
        assert offered(session) == ("Start", "Reset")
        cabinet.close()
        wait_until(lambda: session.status.mode == "stopped")
    assert "the held arm follows no more" in session.status.note
    plant.close()


def test_what_a_task_raises_ends_the_motion_and_not_the_page(session, monkeypatch):
    def fail(action):
        raise ValueError("a task of one's own")

    session.start()
    wait_until(lambda: session.snapshot.stamp > 0.2)
    with monkeypatch.context() as patched:
        patched.setattr(session.core, "step", fail)
        wait_until(lambda: session.status.mode == "stopped")
    assert "a task of one's own" in session.status.note
    assert session.core.arm.is_held
    session.reset()
    wait_until(lambda: session.status.mode == "held")
    session.start()
    wait_until(lambda: session.status.success)


def test_a_reset_that_fails_leaves_the_arm_stopped(session, monkeypatch):
    def fail(*_, **__):
        raise ArmError("the tool did not follow", reason="tare")

    with monkeypatch.context() as patched:
        patched.setattr(session.core, "reset", fail)
        session.reset()
        wait_until(lambda: "did not follow" in session.status.note)
        wait_until(lambda: session.status.mode == "stopped")
    session.reset()
    wait_until(lambda: session.status.mode == "held")


def test_a_start_right_after_a_demonstration_was_kept_goes_on(session):
    session.demonstrate()
    wait_until(lambda: session.logger.is_demonstration)
    session.end_demonstration(is_kept=True)
    session.start()
    wait_until(lambda: session.status.success)


def test_an_arm_elsewhere_that_was_stopped_before_its_first_reset_goes_on_later(
    make_session, service
):
    session = make_session(place=service.url)
    session.stop()
    session.reset()
    resume(session)
    session.reset()
    wait_until(lambda: session.status.mode == "held")
    session.start()
    wait_until(lambda: session.status.mode == "running")
    session.stop()
    resume(session)
    session.start()
    wait_until(lambda: session.status.mode == "running")


def test_without_a_policy_an_arm_elsewhere_is_led(make_session, service):
    session = make_session(policy=NO_POLICY, place=service.url)
    session.reset()
    wait_until(lambda: session.status.mode == "held")
    begin = session.snapshot.tool.position
    to = Pose(begin + np.array([0.0, 0.0, 0.03]), session.snapshot.tool.quat_wxyz)
    session.teleoperator.grab(to)
    wait_until(lambda: session.snapshot.tool.position[2] > begin[2] + 0.02)
    session.teleoperator.let_go()
    wait_until(lambda: session.status.mode == "held")


@pytest.mark.parametrize("is_pressed", [True, False])
def test_only_a_pressed_stop_outlives_the_cockpit(make_session, service, is_pressed):
    session = make_session(place=service.url)
    session.reset()
    wait_until(lambda: session.status.mode == "held")
    session.stop(is_pressed=is_pressed)
    session.close()
    again = make_session(place=service.url)
    again.reset()
    if is_pressed:
        wait_until(lambda: "is stopped" in again.status.note)
    else:
        wait_until(lambda: again.status.mode == "held")
