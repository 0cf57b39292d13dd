"""The doctor at an arm's first power-on, played by a simulated cabinet."""

from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from arms.loopback import LOOPBACK, free_port, lockstep_address
from dovetail import arm_checks
from dovetail.arm_checks import run_arm_checks
from dovetail.arms.address import parse_address
from dovetail.cli import run
from dovetail.envs.randomisation import tool_down
from dovetail.plants.plant import DynamicsConfig, make_plant
from dovetail.poses import Pose, quat_about_z
from dovetail.scene import SceneConfig

HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
START = Pose(np.array([0.60, 0.0, 0.20]), tool_down(0.0))
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
NAMES = [
    "connection",
    "gravity, measured torque",
    "hold",
    "torques",
    "push, external torque",
    "messages",
]


@contextmanager
def cabinet(dynamics=None, **settings):
    """Yields the address of an arm behind a lockstep cabinet; resets move there."""
    plant = make_plant("mujoco", SceneConfig(), dynamics or DynamicsConfig())
    plant.reset(plant.robot.inverse_kinematics(START, Q_SEED), HOLE)
    with lockstep_address(plant, **settings) as address:
        yield f"{address}&reset=move"


def checks(text, ask=None):
    return {check.name: check for check in run_arm_checks(parse_address(text), ask)}


def test_an_arm_as_the_model_says_passes_every_check():
    with cabinet() as address:
        found = checks(address)
    assert list(found) == NAMES
    assert {check.status for check in found.values()} == {"ok"}
    assert "FRI 1.15 from 127.0.0.1:" in found["connection"].detail
    assert "5 ms x 1, AUT" in found["connection"].detail
    assert "+1.00 times the model's" in found["gravity, measured torque"].detail
    assert "away from the base" in found["push, external torque"].detail


def test_the_wrong_sign_of_the_measured_torque_is_found():
    with cabinet(measured_sign=1) as address:
        check = checks(address)["gravity, measured torque"]
    assert check.status == "broken"
    assert "add measured_sign=1 to the address" in check.detail


def test_signs_on_the_wire_that_are_the_other_ones_can_be_said():
    with cabinet(measured_sign=1, commanded_sign=1) as address:
        found = checks(f"{address}&measured_sign=1&commanded_sign=1")
    assert {check.status for check in found.values()} == {"ok"}


def test_the_wrong_sign_of_the_external_torque_is_found():
    with cabinet(external_sign=-1) as address:
        check = checks(address)["push, external torque"]
        assert check.status == "broken"
        assert "add external_sign=-1 to the address" in check.detail


def test_a_wrong_load_shows_in_the_external_torque():
    heavy = DynamicsConfig(mass_scale=(1.0,) * 6 + (3.0,))
    with cabinet(heavy) as address:
        check = checks(address)["hold"]
    assert check.status == "broken"
    assert "check the load data" in check.detail


def test_whoever_says_no_ends_the_checks():
    answers = iter([True, False])
    with cabinet() as address:
        found = checks(address, ask=lambda question: next(answers))
    assert list(found) == NAMES[:3]


class StubArm:
    """An arm of which only what is measured matters."""

    def __init__(self, **state):
        self.robot = SceneConfig().robot()
        self.q = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0])
        self.follows = state.pop("follows", 1.0)
        self.state = SimpleNamespace(**state)
        self.is_stopped = False

    def monitoring(self):
        return self.state

    def step(self, target, duration):
        moved = self.follows * (np.asarray(target.q_d) - self.q)
        return SimpleNamespace(q=self.q + moved, position=np.zeros(3))

    def stop(self):
        self.is_stopped = True


def test_a_joint_that_turns_the_wrong_way_is_stopped_at_once():
    arm = StubArm(follows=-1.0)
    check = arm_checks.check_turns(arm, arm.q)
    assert check.status == "broken"
    assert "A1 turned the wrong way by 0.030 rad" in check.detail
    assert arm.is_stopped


def test_a_joint_that_stays_behind_is_named():
    arm = StubArm(follows=np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.1, 1.0]))
    check = arm_checks.check_turns(arm, arm.q)
    assert check.status == "broken"
    assert "A6 stayed behind" in check.detail
    assert not arm.is_stopped


@pytest.mark.parametrize(
    ("factor", "status", "words"),
    [
        (1.0, "ok", "+1.00 times"),
        (-1.0, "broken", "add measured_sign=1 to the address"),
        (2.0, "broken", "check the load data"),
        (np.nan, "broken", "sends no measured torque"),
    ],
)
def test_gravity_tells_the_sign_of_the_measured_torque(factor, status, words):
    arm = StubArm()
    gravity = arm.robot.chain().gravity(arm.q)
    rest = arm_checks.Rest(arm.q, 0.0, factor * gravity, np.zeros(7))
    check = arm_checks.check_gravity(arm, rest, parse_address("fri://0.0.0.0"))
    assert check.status == status
    assert words in check.detail


def test_an_upright_arm_says_nothing_about_gravity():
    arm = StubArm()
    rest = arm_checks.Rest(np.zeros(7), 0.0, np.zeros(7), np.zeros(7))
    check = arm_checks.check_gravity(arm, rest, parse_address("fri://0.0.0.0"))
    assert check.status == "missing"
    assert not check.is_essential


def test_without_a_control_port_nobody_is_pushed_unless_somebody_is_asked():
    arm = StubArm(q=np.zeros(7), tau_measured=np.zeros(7), tau_external=np.zeros(7))
    address = parse_address("fri://0.0.0.0")
    assert arm_checks.check_push(arm, arm.q, address, None).detail == "nobody pushed"
    felt = arm_checks.check_push(arm, arm.q, address, lambda question: True)
    assert felt.status == "missing"
    assert "no push was felt" in felt.detail


def test_lost_messages_are_said():
    arm = StubArm()
    counts = {"missed": 5, "received": 1000}
    times = {"reply_time": {"p50": 1e-5, "p999": 1e-4}}
    arm.statistics = lambda: {"counts": counts, "times": times}
    assert arm_checks.check_messages(arm).status == "broken"
    counts["missed"] = 1
    assert arm_checks.check_messages(arm).status == "ok"


def test_the_command_prints_the_checks_and_its_exit_code(monkeypatch, capsys):
    monkeypatch.setattr(
        "builtins.input", lambda question: "n" if "turned" in question else ""
    )
    with cabinet() as address:
        assert run(["doctor", "--arm", address]) == 0
        text = capsys.readouterr().out
        assert "connection" in text
        assert "push" not in text
    with cabinet(external_sign=-1) as address:
        assert run(["doctor", "--arm", address, "--yes"]) == 1
    assert "external_sign=-1" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arm", "message"),
    [
        ("mujoco", "checks arms behind FRI"),
        ("grpc://localhost", "checks arms behind FRI"),
        ("gazebo", "known addresses"),
    ],
)
def test_only_an_arm_behind_fri_is_checked(arm, message, capsys):
    assert run(["doctor", "--arm", arm, "--yes"]) == 2
    assert message in capsys.readouterr().err


def test_no_cabinet_is_an_error_that_says_what_to_check(capsys):
    address = f"fri://{LOOPBACK}:{free_port()}?timeout=300ms"
    assert run(["doctor", "--arm", address, "--yes"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("dovetail: ")
    assert "Traceback" not in error


def test_nobody_at_the_terminal_is_an_error(monkeypatch, capsys):
    def end(question):
        raise EOFError

    monkeypatch.setattr("builtins.input", end)
    assert run(["doctor", "--arm", f"fri://{LOOPBACK}:{free_port()}"]) == 2
    assert "or with --yes" in capsys.readouterr().err
