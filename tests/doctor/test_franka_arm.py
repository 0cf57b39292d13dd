"""The doctor's checks of a Franka, on libfranka's stand-in."""

import numpy as np
import pytest

from arms.stand_in import use_stand_in
from dovetail.arms.address import parse_address
from dovetail.arms.franka.at_rest import Rest
from dovetail.cli import run
from dovetail.control.proven import DECLARED
from dovetail.doctor import franka_arm
from dovetail.doctor.franka_arm import (
    check_load,
    check_loop,
    check_machine,
    check_model,
    check_sensors,
    run_franka_checks,
)
from dovetail.doctor.standstill import AS_CONFIGURED
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError
from dovetail.robots.missed_load import load_torques


@pytest.fixture(autouse=True)
def stand_in(monkeypatch):
    use_stand_in(monkeypatch)


def checks(host, ask=None):
    address = parse_address(f"franka://{host}")
    found = run_franka_checks(address, ask, robot="fr3")
    return {check.name: check for check in found}


def test_a_sound_arm_passes_every_check(capsys):
    found = checks("127.0.0.1")
    kept = {"real time", "loop"}  # this machine's, and how busy it is
    assert all(c.status == "ok" for c in found.values() if c.name not in kept)
    assert {"load", "external torque", "gravity, arm's model"} <= set(found)
    assert {"loop", "rest", "hold", "delay", "gravity error", "torques"} <= set(found)
    assert list(found)[-1] == "rest, as tasks run"


@pytest.mark.parametrize("host", ["127.0.0.4", "127.0.0.5", "127.0.0.6"])
def test_a_wrong_load_ends_the_checks_before_a_motion(host):
    found = checks(host)
    assert list(found)[-1] == "load"
    assert found["load"].status == "broken"


def test_the_command_fails_with_a_wrong_load(capsys):
    arguments = ["doctor", "--arm", "franka://127.0.0.4", "--robot", "fr3", "--yes"]
    assert run(arguments) == 1
    assert "by the cell the flange carries" in capsys.readouterr().out


def test_nothing_is_moved_without_consent():
    asked = []
    found = checks("127.0.0.1", lambda question: asked.append(question))
    assert len(asked) == 1
    assert set(found) == {"real time"}


def at_rest(robot, scale=1.0):
    q = robot.posture("down")
    gravity = np.asarray(robot.chain().gravity(q))
    none = np.zeros(7)
    return Rest(q, scale * gravity, none, True, 0.7, 0.9, none[:3], gravity)


@pytest.mark.parametrize(("scale", "status"), [(1.0, "ok"), (0.5, "broken")])
def test_sensors_are_compared_with_the_models_weight(scale, status):
    robot = find_cell(robot="fr3").loaded_robot()
    assert check_sensors(robot, at_rest(robot, scale)).status == status


@pytest.mark.parametrize(
    ("measured", "held", "status", "word"),
    [
        (True, None, "ok", "show no other"),
        (False, 0.0, "ok", "show no other"),
        (False, 0.5, "ok", "show 1.4"),
        (False, np.eye(7)[0] * 3.0, "missing", "not known"),
    ],
)
def test_a_load_that_no_torque_shows_is_said_and_not_ok(measured, held, status, word):
    robot = find_cell(robot="fr3").loaded_robot()
    rest = at_rest(robot)._replace(is_measured=measured)
    if isinstance(held, float):
        held = held * load_torques(robot, rest.q)[:, 0]
    check = check_load(robot, rest._replace(held=held))
    assert (check.status, check.is_essential) == (status, status == "ok")
    assert word in check.detail


@pytest.mark.parametrize("reason", ["wrong_load", "joint_reflex"])
def test_an_arm_that_is_lost_when_it_is_held_once_more_is_a_row(monkeypatch, reason):
    builds, build = [], franka_arm._build

    def lost_the_second_time(*given):
        builds.append(build(*given) if not builds else None)
        if builds[-1] is None:
            raise ArmError("lost", reason)
        return builds[-1]

    monkeypatch.setattr(franka_arm, "_build", lost_the_second_time)
    last = list(checks("127.0.0.1").values())[-1]
    assert (last.name, last.status, last.detail) == (AS_CONFIGURED, "broken", "lost")


def test_sensors_without_noise_are_named():
    robot = find_cell(robot="fr3").loaded_robot()
    rest = at_rest(robot)._replace(is_measured=False)
    check = check_sensors(robot, rest)
    assert (check.status, check.is_essential) == ("missing", False)


def test_an_arm_with_another_model_is_named():
    robot = find_cell(robot="fr3").loaded_robot()
    rest = at_rest(robot)
    assert check_model(robot, rest, DECLARED).status == "ok"
    other = rest._replace(gravity=1.6 * rest.gravity)
    assert check_model(robot, other, DECLARED).status == "broken"


def test_a_kernel_without_preemption_is_essential_where_it_is_insisted_on(tmp_path):
    lacks = tmp_path / "realtime"
    assert not check_machine(is_needed=False, realtime=lacks).is_essential
    check = check_machine(is_needed=True, realtime=lacks)
    assert (check.status, check.is_essential) == ("missing", True)


@pytest.mark.parametrize(("lost", "status"), [(0, "ok"), (9, "broken")])
def test_lost_cycles_fail_the_loop(lost, status):
    class Arm:
        def statistics(self):
            counts = {"cycles": 3000, "lost": lost, "success_rate": 1.0}
            return {"counts": counts, "times": {"p50": 1e-4, "p99": 2e-4, "max": 1e-3}}

    assert check_loop(Arm(), {"cycles": 0, "lost": 0}).status == status
