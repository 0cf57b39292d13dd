"""Whatever a client sends: it is told what is wrong, and the service goes on."""

import math
import queue
import socket

import grpc
import numpy as np
import pytest

from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.messages import write_pose
from dovetail.rpc.settings import write_settings
from dovetail.rpc.version import PROTOCOL, own_version

from .conftest import HOLE, refused, token_of, wait_until

NAN, INF = math.nan, math.inf


@pytest.fixture
def configuration(lease, settings):
    osc, limits, task, period = settings
    message = pb.Configuration(lease=lease, version=own_version())
    task = TaskSpec.parse(task)
    write_settings(
        ControllerSettings(osc=osc, limits=limits, task=task, period=period), message
    )
    return message


@pytest.fixture
def step_request(lease):
    target = pb.Target(
        f_star=[0.0] * 6, position_d=[0.0] * 3, quat_wxyz_d=[0.0, 1.0, 0.0, 0.0]
    )
    return pb.StepRequest(lease=lease, target=target, duration=0.05)


@pytest.fixture
def reset_request(lease, start):
    request = pb.ResetRequest(lease=lease, q=start.tolist())
    write_pose(HOLE, request.fixture)
    return request


@pytest.fixture
def ready(stub, configuration, reset_request):
    stub.configure(configuration)
    stub.reset(reset_request)
    return stub


def paths(problem):
    return [field.path for field in problem.fields]


def setting(message, name):
    return next(s for s in (*message.osc, *message.limits) if s.name == name)


@pytest.mark.parametrize(
    ("path", "name", "values"),
    [
        ("target.f_star[Z]", "f_star", [0.0, 0.0, NAN, 0.0, 0.0, 0.0]),
        ("target.f_star[A]", "f_star", [0.0, 0.0, 0.0, 0.0, 0.0, INF]),
        ("target.f_star", "f_star", [0.0] * 5),
        ("target.f_star", "f_star", []),
        ("target.position_d[X]", "position_d", [-INF, 0.0, 0.0]),
        ("target.quat_wxyz_d[w]", "quat_wxyz_d", [NAN, 1.0, 0.0, 0.0]),
        ("target.quat_wxyz_d", "quat_wxyz_d", [0.0, 0.0, 0.0, 0.0]),
        ("target.quat_wxyz_d", "quat_wxyz_d", [1.0, 1.0, 1.0, 1.0]),
        ("target.near_plane", "near_plane", [0.0] * 3),
        ("target.near_plane", "near_plane", [0.0, 0.0, 2.0, 0.1]),
        ("target.near_plane", "near_plane", [0.0, 0.0, 0.0, 0.1]),
        ("target.near_plane[nx]", "near_plane", [-INF, 0.0, 0.0, 0.0]),
        ("target.near_plane[offset]", "near_plane", [0.0, 0.0, 1.0, INF]),
        ("target.near_plane[offset]", "near_plane", [0.0, 0.0, 1.0, NAN]),
        ("target.velocity_d", "velocity_d", [0.0] * 5),
        ("target.velocity_d[C]", "velocity_d", [0.0] * 3 + [INF] + [0.0] * 2),
        ("target.acceleration_d", "acceleration_d", [0.0] * 7),
        ("target.acceleration_d[X]", "acceleration_d", [NAN] + [0.0] * 5),
        ("target.f_tare", "f_tare", [0.0] * 3),
        ("target.f_tare[Z]", "f_tare", [0.0, 0.0, NAN, 0.0, 0.0, 0.0]),
        ("target.q_d", "q_d", [0.0] * 6),
        ("target.q_d[A7]", "q_d", [0.0] * 6 + [NAN]),
    ],
)
def test_wrong_targets(ready, builder, step_request, path, name, values):
    getattr(step_request.target, name)[:] = values
    problem = refused(ready.step, step_request)
    assert paths(problem) == [path]
    assert path in problem.text
    assert "step" not in builder.arm.calls


def test_a_wrong_mask_of_axes_that_stay(ready, builder, step_request):
    step_request.target.stay = 8
    assert paths(refused(ready.step, step_request)) == ["target.stay"]
    assert "step" not in builder.arm.calls


@pytest.mark.parametrize("age", [-1e-3, NAN, INF, 2e9])
def test_wrong_ages(ready, builder, step_request, age):
    step_request.target.age = age
    assert paths(refused(ready.step, step_request)) == ["target.age"]
    assert "step" not in builder.arm.calls


@pytest.mark.parametrize("duration", [0.0, -0.05, 0.003, NAN, INF, 1e300, 10.005])
def test_wrong_durations(ready, builder, step_request, duration):
    step_request.duration = duration
    assert paths(refused(ready.step, step_request)) == ["duration"]
    assert "step" not in builder.arm.calls


def test_a_duration_must_be_there(ready, step_request):
    step_request.ClearField("duration")
    assert "duration is missing" in refused(ready.step, step_request).text


def test_large_finite_numbers_are_no_error(ready, step_request):
    step_request.target.f_star[:] = [1.7e308] * 6
    assert ready.step(step_request).state.stamp == 0.05


@pytest.mark.parametrize("count", [6, 8])
def test_six_or_eight_joint_values(ready, reset_request, count):
    reset_request.q[:] = [0.1] * count
    problem = refused(ready.reset, reset_request)
    assert problem.text == (
        f"q is {count} values; allowed: 7 (A1 A2 A3 A4 A5 A6 A7) in rad"
    )


def test_every_wrong_field_of_a_reset_is_named(ready, reset_request):
    reset_request.q[1] = 3.0
    reset_request.q[4] = NAN
    reset_request.fixture.position[2] = INF
    reset_request.fixture.quat_wxyz[:] = []
    problem = refused(ready.reset, reset_request)
    assert paths(problem) == [
        *("q[A2]", "q[A5]", "fixture.position[Z]", "fixture.quat_wxyz"),
    ]
    assert "q[A2] is 3 rad; allowed: -2.0944 to 2.0944 rad" in problem.text


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ("XYZ:hold ABC:hold", "commands no axis"),
        ("XYZABC:free", "commands no axis"),
        ("", "names no axis"),
        ("XYQ:force", "unknown task axis 'Q'"),
        ("XYZ:push", "unknown mode 'push'"),
        ("XX:force", "named twice"),
    ],
)
def test_wrong_tasks(stub, configuration, builder, task, words):
    configuration.task = task
    problem = refused(stub.configure, configuration)
    assert paths(problem) == ["task"]
    assert words in problem.text
    assert builder.arm is None


@pytest.mark.parametrize("period", [0.0, -0.001, 0.006, NAN])
def test_wrong_periods(stub, configuration, period):
    configuration.period = period
    problem = refused(stub.configure, configuration)
    assert paths(problem) == ["period"]
    assert problem.fields[0].allowed == "0.0001 to 0.005 s"


def test_every_number_of_the_settings_is_checked(stub, configuration):
    count = 0
    for message in (*configuration.osc, *configuration.limits):
        for i, value in enumerate(message.numbers):
            message.numbers[i] = NAN
            count += 1
            problem = refused(stub.configure, configuration)
            assert [p.split("[")[0].split(".")[1] for p in paths(problem)] == [
                message.name
            ]
            message.numbers[i] = value
    assert count > 80
    stub.configure(configuration)


def test_every_setting_must_be_there_and_be_known(stub, configuration):
    for group in (configuration.osc, configuration.limits):
        names = [message.name for message in group]
        for message in group:
            message.name = f"{(name := message.name)}_"
            problem = refused(stub.configure, configuration)
            wanted = {f"{name}_", name}
            assert {p.split(".")[1] for p in paths(problem)} == wanted
            message.name = name
        assert [message.name for message in group] == names


def test_limits_wider_than_the_robots_are_refused(stub, configuration, cell):
    own = cell.loaded_robot().limits
    setting(configuration, "tau_max").numbers[2] = 2.0 * own.tau_max[2]
    setting(configuration, "q_min").numbers[0] = own.q_min[0] - 0.01
    setting(configuration, "dq_max").numbers[6] = np.nextafter(own.dq_max[6], INF)
    problem = refused(stub.configure, configuration)
    assert sorted(paths(problem)) == [
        *("limits.dq_max[A7]", "limits.q_min[A1]", "limits.tau_max[A3]"),
    ]


def test_an_unknown_choice_lists_the_known_ones(stub, configuration):
    setting(configuration, "scheme").choice = "magic"
    problem = refused(stub.configure, configuration)
    assert "limits.scheme is 'magic'; allowed: qp, paper" in problem.text


def test_a_name_with_control_characters_cannot_forge_lines(stub, news, acquire):
    acquire(stub, "a\n\x1b[31mb" * 100)
    wait_until(lambda: len(news) == 1)
    assert news[0].isprintable()
    assert len(news[0]) < 300


FAILED = grpc.StatusCode.FAILED_PRECONDITION


def test_calls_in_the_wrong_order(stub, lease, step_request, reset_request):
    assert "configure it first" in refused(stub.reset, reset_request, code=FAILED).text
    assert "configure it first" in refused(stub.step, step_request, code=FAILED).text


def test_a_step_before_the_reset(stub, configuration, step_request):
    stub.configure(configuration)
    problem = refused(stub.step, step_request, code=FAILED)
    assert "has not been reset" in problem.text


@pytest.mark.parametrize(
    "name", ["reset", "step", "clear", "release_lease", "configure"]
)
def test_without_the_lease_nothing_moves(
    ready, builder, step_request, reset_request, name
):
    before = list(builder.arm.calls)
    request = {"step": step_request, "reset": reset_request}
    request["configure"] = pb.Configuration(version=own_version())
    message = request.get(name, pb.Holder())
    for wrong in ("", "0" * 32):
        message.lease = wrong
        problem = refused(getattr(ready, name), message, code=FAILED)
        assert "does not hold the arm's lease" in problem.text
    assert builder.arm.calls == before


def test_a_stream_that_acquires_nothing_is_refused(ready, step_request):
    refused(ready.control, iter([step_request]), code=FAILED)


def test_a_second_stream_is_refused_while_the_first_is_open(ready):
    acquire = pb.LeaseRequest(version=own_version(), client="second")
    request = pb.StepRequest(acquire=acquire)
    problem = refused(ready.control, iter([request]), code=FAILED)
    assert "held by bare at ipv4:127.0.0.1" in problem.text


def test_an_error_in_the_stream_does_not_end_it(
    stub, configuration, reset_request, step_request
):
    stub.release_lease(pb.Holder(lease=configuration.lease))
    outbox = queue.SimpleQueue()
    acquire = pb.LeaseRequest(version=own_version(), client="bare")
    outbox.put(pb.StepRequest(acquire=acquire))
    answers = stub.control(iter(outbox.get, None), timeout=20)
    configuration.lease = reset_request.lease = next(answers).lease
    stub.configure(configuration)
    stub.reset(reset_request)
    bad = pb.StepRequest()
    bad.CopyFrom(step_request)
    bad.target.f_star[0] = NAN
    for request in (bad, step_request, None):
        outbox.put(request)
    problem, state = answers
    assert problem.problem.kind == "ConfigError"
    assert problem.problem.fields[0].path == "target.f_star[X]"
    assert state.state.stamp == 0.05


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("get_info", pb.InfoRequest),
        ("configure", pb.Configuration),
        ("state", pb.WatchRequest),
        ("get_log", pb.LogRequest),
    ],
)
def test_another_version_is_refused_naming_both(stub, name, message):
    for protocol, package in ((0, ""), (PROTOCOL + 1, "9.9.9")):
        request = message(version=pb.Version(protocol=protocol, package=package))
        text = refused(getattr(stub, name), request).text
        assert f"client speaks protocol {protocol} (dovetail {package}" in text
        assert f"this service speaks {own_version().protocol} (dovetail" in text


def test_settings_do_not_change_while_the_arm_follows_a_target(
    ready, configuration, builder
):
    configuration.period = 0.002
    problem = refused(ready.configure, configuration, code=FAILED)
    assert "in real time; stop it first" in problem.text
    ready.stop(pb.StopRequest(reason="to configure"))
    ready.configure(configuration)
    assert builder.built[-1].period == 0.002


def test_bytes_that_are_no_message(server, stub, lease, news):
    channel = grpc.insecure_channel(server.address)
    token = token_of(server)
    for name in ("GetInfo", "Step", "Configure", "Stop", "Control", "State"):
        call = channel.stream_stream(f"/dovetail.Arm/{name}")
        with pytest.raises(grpc.RpcError) as error:
            list(call(iter([b"\xff" * 100]), timeout=10, metadata=token))
        assert error.value.code() == grpc.StatusCode.INVALID_ARGUMENT
    call = channel.unary_unary("/dovetail.Arm/GetInfo")
    with pytest.raises(grpc.RpcError) as error:
        call(b"\0" * 10**6, timeout=10, metadata=token)
    assert error.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    channel.close()
    stub.clear(pb.Holder(lease=lease), timeout=10)
    assert not any("unexpected" in line for line in news)


@pytest.mark.parametrize("seed", range(5))
def test_garbage_on_the_port(server, stub, lease, seed):
    rng = np.random.default_rng(seed)
    host, port = server.address.rsplit(":", 1)
    preface = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" if seed % 2 else b""
    for _ in range(10):
        with socket.create_connection((host, int(port)), timeout=10) as connection:
            connection.settimeout(0.2)
            try:
                connection.sendall(preface + rng.bytes(2000))
                connection.recv(1000)
            except OSError:
                pass
    stub.clear(pb.Holder(lease=lease), timeout=10)
