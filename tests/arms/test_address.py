"""One word says where the arm is; a wrong word says which words there are."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.address import parse_address
from dovetail.arms.arm_address import ArmAddress, parse_endpoint
from dovetail.arms.fri_arm import FriAddress
from dovetail.arms.local_address import PlantAddress, TwinAddress
from dovetail.arms.local_arm import LocalArm
from dovetail.arms.remote_arm import GrpcAddress
from dovetail.control.task_spec import TaskSpec
from dovetail.durations import parse_time
from dovetail.envs.arm_setup import build_arm
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell, make_env
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig
from dovetail.tasks.peg_in_hole.task import PegInHole

TASK = TaskSpec.parse("XYZ:force A:pose BC:hold")


def test_plants_and_twins_are_named_by_one_word():
    assert parse_address("mujoco") == PlantAddress(engine="mujoco")
    assert parse_address("bullet") == PlantAddress(engine="bullet")
    assert parse_address("twin:medium") == TwinAddress(config="medium")
    assert parse_address("twin:./my.toml") == TwinAddress(config="./my.toml")


def test_a_bare_fri_address_is_a_real_cabinet_with_the_usual_port():
    address = parse_address("fri://0.0.0.0")
    assert address == FriAddress(host="0.0.0.0", port=30200)
    assert address.margins == "hardware"
    assert not address.places_fixture
    assert not address.is_here


def test_every_fri_key_is_read():
    address = parse_address(
        "fri://127.0.0.1:30205?version=2.7&period=2ms&clock=lockstep"
        "&control=127.0.0.1:30301&reset=place&timeout=3s&target_timeout=100ms&realtime=yes"
        "&margins=model&peer=192.170.10.2"
    )
    assert address == FriAddress(
        host="127.0.0.1",
        port=30205,
        version="2.7",
        period=0.002,
        clock="lockstep",
        control="127.0.0.1:30301",
        reset="place",
        timeout=3.0,
        target_timeout=0.1,
        realtime=True,
        peer="192.170.10.2",
        margins="model",
    )
    assert address.places_fixture


def test_what_public_reports_leave_open_can_be_said():
    usual = parse_address("fri://0.0.0.0")
    assert (usual.measured_sign, usual.commanded_sign, usual.external_sign) == (
        -1,
        -1,
        1,
    )
    cabinet = parse_address(
        "fri://0.0.0.0?measured_sign=1&commanded_sign=1&external_sign=-1"
        "&commanded_is_total=yes"
    )
    assert (cabinet.measured_sign, cabinet.commanded_sign) == (1, 1)
    assert (cabinet.external_sign, cabinet.commanded_is_total) == (-1, True)


def test_a_simulated_cabinet_places_the_arm_where_nothing_else_is_asked():
    assert parse_address("fri://0.0.0.0?control=a:1").reset == "place"
    assert parse_address("fri://0.0.0.0?control=a:1&reset=move").reset == "move"
    assert parse_address("fri://0.0.0.0").reset == "move"


@pytest.mark.parametrize(
    ("text", "seconds"), [("5ms", 0.005), ("0.005s", 0.005), ("1ms", 0.001)]
)
def test_a_period_is_given_in_milliseconds_or_seconds(text, seconds):
    assert parse_address(f"fri://0.0.0.0?period={text}").period == seconds
    assert parse_time(text, "x") == pytest.approx(seconds)


@pytest.mark.parametrize("version", ["1.14", "1.15", "1.16"])
def test_versions_with_the_same_wire_format_are_one(version):
    address = parse_address(f"fri://0.0.0.0?version={version}")
    assert address.version == "1.15"


def test_a_service_on_this_machine_needs_no_certificate():
    text = "grpc://127.0.0.1:50051"
    address = parse_address(text)
    assert address == GrpcAddress(text=text, host="127.0.0.1", port=50051)
    assert parse_address("grpc://localhost").port == 50051
    assert parse_address("grpc://localhost?margins=model").margins == "model"
    assert parse_address("grpc://localhost?period=2.5ms").period == 0.0025


def test_certificates_are_files(tmp_path):
    for name in ("ca", "cert", "key"):
        (tmp_path / name).touch()
    text = f"grpc://robot:1?ca={tmp_path}/ca&cert={tmp_path}/cert&key={tmp_path}/key"
    address = parse_address(text)
    assert (address.ca, address.cert) == (tmp_path / "ca", tmp_path / "cert")
    assert address.key == tmp_path / "key"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "known addresses: mujoco, bullet, drake, twin:NAME, fri://HOST:PORT"),
        ("gazebo", "arm 'gazebo' is unknown"),
        ("twin:", "arm 'twin:' is unknown"),
        ("twin:medium?period=1ms", "give 'twin:medium' and options in their place, as"),
        ("mujoco?period=1ms", "'period=1ms', which are for addresses on a network"),
        ("http://x:1", "grpc://HOST:PORT"),
        ("fri://", "give fri://HOST:PORT"),
        ("fri://0.0.0.0:0", "port 1 to 65535"),
        ("fri://0.0.0.0:65536", "1 to 65535"),
        ("fri://0.0.0.0:abc", "1 to 65535"),
        ("fri://0.0.0.0/x", "no address"),
        ("fri://0.0.0.0?watchdog=1s", "unknown keys: watchdog"),
        ("fri://0.0.0.0?peer=robot", "arm peer is 'robot'; give the cabinet's IPv4"),
        ("fri://0.0.0.0?speed=1", "unknown keys: speed"),
        ("fri://0.0.0.0?version=3.0", "known: 1.14, 1.15, 1.16, 2.5, 2.7"),
        ("fri://0.0.0.0?version=", "FRI version is ''"),
        ("fri://0.0.0.0?period=5", "with its unit, ms or s"),
        ("fri://0.0.0.0?period=0ms", "a number above 0"),
        ("fri://0.0.0.0?period=-1ms", "a number above 0"),
        ("fri://0.0.0.0?period=nanms", "a number above 0"),
        ("fri://0.0.0.0?period=infs", "a number above 0"),
        ("fri://0.0.0.0?period=10ms", "10 ms; allowed: 1, 2 and 5 ms; take 5ms"),
        ("fri://0.0.0.0?period=3ms", "50 ms, is no multiple of it; allowed"),
        ("fri://0.0.0.0?period=2.5ms", "2.5 ms, and FRI knows whole milliseconds"),
        ("fri://0.0.0.0?clock=cpu", "known: wall, lockstep"),
        ("fri://0.0.0.0?reset=place", "needs control=HOST:PORT"),
        ("fri://0.0.0.0?control=x", "give HOST:PORT"),
        ("fri://0.0.0.0?control=x:y", "give HOST:PORT"),
        ("fri://0.0.0.0?realtime=1", "known: no, yes"),
        ("fri://0.0.0.0?measured_sign=2", "measured_sign is '2'; known: -1, 1"),
        ("fri://0.0.0.0?clock=wall&clock=lockstep", "gives clock twice"),
        ("grpc://", "give grpc://HOST:PORT"),
        (
            "grpc://a:1?word=x",
            "unknown keys: word; known keys: ca, cert, key, token, period, margins",
        ),
        ("grpc://a:1", "needs certificates"),
        ("grpc://localhost?period=10ms", "allowed: 1, 2, 2.5 and 5 ms; take 5ms"),
        ("grpc://a:1?cert=x", "gives cert without key"),
        ("grpc://a:1?ca=/nowhere", "arm ca '/nowhere' is no file"),
    ],
)
def test_a_wrong_address_says_what_is_right(text, message):
    with pytest.raises(ConfigError) as error:
        parse_address(text)
    assert message in str(error.value)


@pytest.mark.parametrize("text", ["", "x", ":1", "a:0", "a:99999", "a:1/b", "a:1?b"])
def test_an_endpoint_is_host_and_port(text):
    with pytest.raises(ConfigError, match="HOST:PORT"):
        parse_endpoint(text, "listen")
    assert parse_endpoint("[::1]:50", "listen") == ("::1", 50)


def test_an_address_in_this_process_gives_the_arm_that_the_settings_give():
    states = []
    for settings in ({"arm": "twin:easy"}, {"arm": None, "twin": "easy"}):
        arm = build_arm(settings.pop("arm"), find_cell(), TASK, EnvConfig(**settings))
        assert isinstance(arm, LocalArm)
        states.append(arm.plant.dynamics)
        arm.close()
    assert states[0] == states[1]


def test_the_environment_takes_an_address_for_an_arm():
    with_address = make_env(PegInHole, "mujoco")
    without = make_env(PegInHole, plant="mujoco")
    for env in (with_address, without):
        env.reset(seed=1)
    np.testing.assert_array_equal(with_address.state.q, without.state.q)
    for env in (with_address, without):
        env.close()


def test_what_an_address_names_cannot_be_given_twice():
    physics = EnvConfig(dynamics=DynamicsConfig())
    with pytest.raises(ConfigError, match="exclude each other"):
        build_arm("mujoco", find_cell(), TASK, EnvConfig(twin="easy"))
    with pytest.raises(ConfigError, match="a twin has its own"):
        build_arm("twin:easy", find_cell(), TASK, physics)
    with pytest.raises(ConfigError, match="of this process only"):
        build_arm("fri://0.0.0.0", find_cell(), TASK, physics)


def test_an_address_of_ones_own_builds_the_arm_of_an_environment():
    class OwnAddress(PlantAddress):
        built = 0

        def build(self, cell, settings):
            type(self).built += 1
            return super().build(cell, settings)

    build_arm(OwnAddress(engine="mujoco"), find_cell(), TASK).close()
    assert OwnAddress.built == 1


def test_an_arm_that_is_not_as_the_model_says_gets_wider_margins(monkeypatch):
    built = []
    monkeypatch.setattr(
        FriAddress,
        "build",
        lambda address, cell, s: built.append((s.limits.delta_v, s.period)),
    )
    for keys in ("period=1ms", "period=1ms&margins=model", "period=1ms&control=a:1"):
        build_arm(f"fri://0.0.0.0?{keys}", find_cell(), TASK)
    assert built == [(0.50, 0.001), (0.01, 0.001), (0.50, 0.001)]


def test_what_an_address_says_reaches_the_servo_loop(monkeypatch):
    built = []
    monkeypatch.setattr(
        _core, "ServoLoop", lambda loop, servo, *_: built.append((loop, servo))
    )
    text = "fri://127.0.0.1:30205?peer=192.170.10.2&version=2.7&clock=lockstep"
    text += "&target_timeout=100ms&measured_sign=1&commanded_sign=1&external_sign=-1"
    build_arm(f"{text}&commanded_is_total=yes", find_cell(), TASK)
    loop, servo = built[0]
    assert (loop.address, loop.port, loop.peer) == (
        *("127.0.0.1", 30205),
        "192.170.10.2",
    )
    assert (servo.measured_sign, servo.commanded_sign, servo.external_sign) == (
        *(1, 1),
        -1,
    )
    assert servo.commanded_is_total
    assert servo.lockstep
    assert servo.watchdog.target_timeout == 0.1


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("grpc://localhost:1?token=secret", "grpc://localhost:1"),
        ("grpc://[::1]:1?token=secret&period=1ms", "grpc://[::1]:1?period=1ms"),
        ("grpc://localhost?period=1ms&tok%65n=secret", "grpc://localhost?period=1ms"),
    ],
)
def test_a_token_is_in_no_text_that_is_kept(given, kept):
    address = parse_address(given)
    assert address.token == "secret"
    assert address.text == kept
    assert "secret" not in f"{address!r} {address} {address.describe_ground()}"


@pytest.mark.parametrize(
    "wrong",
    ["grpc://localhost:1?perod=1ms&token=secret", "grpc://192.0.2.1?token=secret"],
)
def test_a_token_is_in_no_refusal_of_its_address(wrong):
    with pytest.raises(ConfigError) as refusal:
        parse_address(wrong)
    assert "secret" not in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "may_be_robot"),
    [
        ("mujoco", False),
        ("bullet", False),
        ("twin:medium", False),
        ("fri://0.0.0.0", True),
        ("fri://0.0.0.0?clock=wall", True),
        ("fri://0.0.0.0?control=127.0.0.1:1", False),
        ("grpc://localhost", True),
    ],
)
def test_what_may_be_a_robot(text, may_be_robot):
    assert parse_address(text).may_be_robot is may_be_robot


def test_an_arm_of_a_new_kind_may_be_a_robot_until_it_says_no():
    class NewAddress(ArmAddress):
        def build(self, cell, settings):
            raise AssertionError

        def describe_ground(self):
            return "somewhere"

    assert NewAddress().may_be_robot is True
