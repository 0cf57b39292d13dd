"""RemoteArm: the same numbers as without a service, and clear errors."""

import threading
import time
from itertools import groupby

import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.address import parse_address
from dovetail.arms.local_address import PlantAddress
from dovetail.arms.local_arm import LocalArm
from dovetail.control.config import LimitConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError, ConfigError, PlantError
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc import version
from dovetail.rpc.fields import FieldReader
from dovetail.rpc.messages import read_target, write_target
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.rpc.server import ArmServer
from states import state_numbers

from .conftest import HOLE, TOOL_DOWN, push, wait_until


def assert_equal_states(one, other):
    others = state_numbers(other)
    for name, a in state_numbers(one).items():
        np.testing.assert_array_equal(a, others[name], err_msg=name, strict=True)


@pytest.mark.parametrize("kind", ["mujoco", "twin:medium"])
def test_an_episode_is_bit_for_bit_that_of_the_arm_behind(
    kind, cell, settings, start, connect, rng
):
    address = parse_address(kind)
    local = LocalArm(address.make_plant(cell), cell.loaded_robot(), *settings)
    with ArmServer(OfferedArm(address, cell), "127.0.0.1:0") as server:
        remote = connect(server, robot=cell.loaded_robot(), cell=cell)
        for seed in (3, 4):
            local.plant.seed(seed)
            remote.seed(seed)
            assert_equal_states(remote.reset(start, HOLE), local.reset(start, HOLE))
            logs = []
            for _ in range(60):
                target = push(*rng.uniform(-3.0, 3.0, 3))
                duration = 0.005 * rng.integers(1, 12)
                state = local.step(target, duration)
                logs.append(state.log)
                assert_equal_states(remote.step(target, duration), state)
            np.testing.assert_array_equal(remote.cycles(), np.vstack(logs))
        assert remote.facts.robot.tool_pose(start).position.tobytes() == (
            local.facts.robot.tool_pose(start).position.tobytes()
        )
    local.close()


@pytest.mark.parametrize("places_fixture", [False, True])
def test_the_service_says_whether_the_hole_can_be_put_elsewhere(
    cell, connect, places_fixture
):
    class Address(PlantAddress):
        @property
        def places_fixture(self):
            return places_fixture

    arm = OfferedArm(Address(engine="mujoco"), cell)
    with ArmServer(arm, "127.0.0.1:0") as server:
        assert connect(server).facts.traits.places_fixture is places_fixture


@pytest.mark.parametrize("joint_mode", [False, True])
def test_everything_of_a_target_arrives(joint_mode, rng):
    target = _core.Target()
    names = [name for name in dir(target) if not name.startswith("_")]
    for name in set(names) - {"joint_mode", "age", "stay"}:
        setattr(target, name, rng.normal(size=getattr(target, name).shape))
    target.quat_wxyz_d = TOOL_DOWN
    target.near_plane = np.array([0.6, 0.0, 0.8, rng.normal()])
    target.joint_mode, target.age, target.stay = joint_mode, 0.03, 0b000101
    if not joint_mode:
        target.q_d = np.zeros(7)  # not used, not sent
    message, fields = pb.Target(), FieldReader()
    write_target(target, message)
    arrived = read_target(pb.Target.FromString(message.SerializeToString()), fields)
    fields.finish()
    for name in names:
        np.testing.assert_array_equal(getattr(arrived, name), getattr(target, name))


def test_a_plane_that_is_nowhere_arrives():
    message = pb.Target()
    write_target(_core.Target(), message)
    plane = read_target(message, FieldReader()).near_plane
    np.testing.assert_array_equal(plane, [0.0, 0.0, 0.0, -np.inf])


def test_robot_and_what_the_arm_is_come_from_the_service(simulation, cell, connect):
    arm = connect(simulation)
    own = cell.loaded_robot()
    assert arm.facts.robot.name == own.name
    assert arm.facts.robot.payload.mass == own.payload.mass
    np.testing.assert_array_equal(arm.facts.robot.links.inertia, own.links.inertia)
    assert arm.info.arm == "mujoco"
    assert not arm.info.real_time
    assert tuple(arm.info.columns) == CYCLE_COLUMNS


def test_the_state_behind_may_be_changed_by_its_user(simulation, start, connect):
    arm = connect(simulation)
    arm.reset(start, HOLE)
    state = arm.step(push(0.0))
    state.q[0] = 1.0
    state.log[0] = 0.0


def test_two_learners_at_once_the_second_is_told_who_holds_the_arm(server, connect):
    connect(server, name="first learner")
    with pytest.raises(ArmError, match=r"held by first learner at ipv4:127.0.0.1"):
        connect(server, name="second learner")


def test_the_first_learner_is_not_disturbed_by_the_second(server, start, connect):
    first = connect(server)
    first.reset(start, HOLE)
    with pytest.raises(ArmError):
        connect(server)
    assert first.step(push(0.0)).stamp == 0.05


def test_closing_gives_the_arm_to_the_next_and_holds_it(
    server, builder, start, connect
):
    first = connect(server)
    first.reset(start, HOLE)
    first.step(push(0.0))
    first.close()
    first.close()
    assert builder.arm.calls == ["reset", "step", "stop"]
    second = connect(server)
    with pytest.raises(ArmError, match=r"stopped \(.* has left: released\): clear or"):
        second.step(push(0.0))
    second.reset(start, HOLE)
    assert second.step(push(0.0)).stamp == 0.05


def test_equal_settings_do_not_build_the_arm_again(server, builder, connect):
    connect(server).close()
    connect(server).close()
    assert len(builder.built) == 1
    connect(server, task="XYZ:force ABC:hold")
    assert len(builder.built) == 2


def test_stop_ends_a_step_under_way_and_clear_lets_it_move_again(
    server, builder, start, connect
):
    arm = connect(server)
    arm.reset(start, HOLE)
    timer = threading.Timer(0.2, arm.stop)
    timer.start()
    before = time.monotonic()
    arm.step(push(0.0), duration=5.0)
    assert time.monotonic() - before < 3.0
    timer.join()
    with pytest.raises(ArmError, match=r"stopped by its learner.*: clear it"):
        arm.step(push(0.0))
    with pytest.raises(ArmError, match="clear it first"):
        arm.reset(start, HOLE)
    arm.clear()
    arm.step(push(0.0))
    calls = [call for call, _ in groupby(builder.arm.calls)]  # a stop may be repeated
    assert calls == ["reset", "step", "stop", "clear", "step"]
    assert builder.arm.calls.count("stop") <= 2


def test_an_error_of_the_arm_arrives_as_what_it_was(server, builder, start, connect):
    arm = connect(server)
    arm.reset(start, HOLE)
    builder.arm.trouble = PlantError("the simulation diverged")
    with pytest.raises(PlantError, match=r"^the simulation diverged$"):
        arm.step(push(0.0))
    builder.arm.trouble = ArmError("the cabinet is gone", "silence")
    with pytest.raises(ArmError, match=r"^the cabinet is gone$") as error:
        arm.step(push(0.0))
    assert error.value.reason == "silence"
    assert arm.step(push(0.0)).stamp == 0.05


def test_an_error_that_nobody_expected_holds_the_arm(
    server, builder, news, start, connect
):
    arm = connect(server)
    arm.reset(start, HOLE)
    builder.arm.trouble = ZeroDivisionError("a bug")
    with pytest.raises(ArmError, match="ZeroDivisionError: a bug"):
        arm.step(push(0.0))
    assert builder.arm.calls[-1] == "stop"
    wait_until(lambda: any("unexpected ZeroDivisionError" in line for line in news))


def test_a_service_that_ends_in_mid_episode_is_a_clear_error(
    builder, start, settings, connect
):
    with ArmServer(builder, "127.0.0.1:0") as server:
        arm = connect(server)
        arm.reset(start, HOLE)
        arm.step(push(0.0))
    assert builder.arm is None
    with pytest.raises(ArmError, match=r"step at 127\.0\.0\.1:\d+: nothing listens"):
        arm.step(push(0.0))
    with pytest.raises(ArmError, match="the reset failed"):
        arm.reset(start, HOLE)
    arm.close()
    with pytest.raises(ArmError, match="this arm is closed"):
        arm.step(push(0.0))


def test_a_step_that_never_answers_ends(server, builder, start, connect):
    arm = connect(server, timeout=0.5)
    arm.reset(start, HOLE)
    builder.arm.step = lambda target, duration: time.sleep(4.0)
    with pytest.raises(ArmError, match="no answer in time"):
        arm.step(push(0.0))


def test_the_answer_to_an_interrupted_step_is_not_taken_for_the_next_ones(
    server, start, connect, monkeypatch
):
    arm = connect(server)
    arm.reset(start, HOLE)

    def interrupt(doing):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(arm._steps, "_next", interrupt)
        with pytest.raises(KeyboardInterrupt):
            arm.step(push(0.0))
    assert arm.step(push(0.0)).stamp == pytest.approx(0.10)


def test_nobody_listens_says_what_to_start(connect):
    with pytest.raises(ArmError, match="nothing listens there; start `dovetail serve"):
        connect("grpc://127.0.0.1:9")


def test_another_robot_is_refused_by_name_of_what_differs(server, connect):
    other = find_cell(peg="triangle").loaded_robot()
    with pytest.raises(ConfigError, match="differ, for example") as refused:
        connect(server, robot=other)
    assert refused.value.name == "robot"


def test_another_scene_is_refused(server, connect):
    with pytest.raises(
        ConfigError,
        match=r"1 mm clearance per side', the service's is 'square peg, 0.5 mm",
    ):
        connect(server, cell=find_cell(clearance=0.001))


def test_a_service_of_another_version_is_refused(server, connect, monkeypatch):
    monkeypatch.setattr(version, "PROTOCOL", 7)
    own = version.own_version()
    monkeypatch.setattr("dovetail.rpc.client.own_version", lambda: own)
    monkeypatch.setattr(version, "PROTOCOL", 3)
    with pytest.raises(ConfigError, match=r"client speaks protocol 7 .*speaks 3 \("):
        connect(server)


def test_a_learner_of_another_version_is_refused(server, connect, monkeypatch):
    monkeypatch.setattr("dovetail.rpc.client.require_version", refuse_as_client)
    with pytest.raises(ConfigError, match=r"service speaks protocol 6 .*speaks 7"):
        connect(server)


def refuse_as_client(other, who):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(version, "PROTOCOL", 7)
        version.require_version(other, who)


def test_settings_the_service_refuses_arrive_with_their_names(
    server, cell, settings, connect
):
    robot = cell.loaded_robot()
    wide = LimitConfig.for_period(robot, 0.005, q_max=robot.limits.q_max + 0.1)
    with pytest.raises(ConfigError, match=r"limits\.q_max\[A1\] is .* rad; allowed"):
        connect(server, limits=wide)
    connect(server)
