"""Services over a simulation or over a recording arm, and clients of them."""

import queue
import subprocess
import sys
import time
from pathlib import Path

import grpc
import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.address import parse_address
from dovetail.arms.remote_arm import GrpcAddress, RemoteArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.poses import Pose, quat_about_z
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.calls import Stub
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.rpc.problems import problem_in
from dovetail.rpc.server import ArmServer
from dovetail.rpc.version import own_version

from .recording_arm import RecordingOffer

TASK = "XYZ:force A:pose BC:hold"
PERIOD = 0.005
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def push(*f_star):
    full = np.array([*f_star, *[0.0] * (6 - len(f_star))])
    return _core.Target(f_star=full, quat_wxyz_d=TOOL_DOWN)


@pytest.fixture(scope="session")
def cell():
    return find_cell()


@pytest.fixture(scope="session")
def start(cell):
    seed = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
    return cell.loaded_robot().inverse_kinematics(
        Pose(np.array([0.60, 0.0, 0.16]), TOOL_DOWN), seed
    )


@pytest.fixture(scope="session")
def settings(cell):
    """Law, limits, task, period: the arguments of every arm after the robot."""
    osc = OscConfig(force_damping=[16.0, 16.0, 16.0, 0.0, 0.0, 0.0])
    return osc, LimitConfig.for_period(cell.loaded_robot(), PERIOD), TASK, PERIOD


@pytest.fixture
def news():
    """Lines that a service told its user."""
    return []


@pytest.fixture
def simulation(cell, news):
    """A service over MuJoCo."""
    arm = OfferedArm(parse_address("mujoco"), cell)
    with ArmServer(arm, "127.0.0.1:0", notify=news.append) as server:
        yield server


@pytest.fixture
def builder(cell):
    """Makes an arm that records what it is told and waits as long as it moves."""
    return RecordingOffer(cell)


@pytest.fixture
def server(builder, news):
    """A service over the recording arm."""
    with ArmServer(builder, "127.0.0.1:0", notify=news.append) as server:
        yield server


@pytest.fixture
def connect(settings):
    """Make learners; they are closed at the end."""
    arms = []

    def make(server, **options):
        address = server if isinstance(server, str) else server.url
        given = [options.pop(n, v) for n, v in zip(_NAMES, settings, strict=True)]
        made_of = dict(zip(_NAMES, given, strict=True))
        made_of["task"] = TaskSpec.parse(made_of["task"])
        where = GrpcAddress.parse(address)
        arms.append(RemoteArm(where, ControllerSettings(**made_of), **options))
        return arms[-1]

    yield make
    for arm in arms:
        arm.close()


_NAMES = ("osc", "limits", "task", "period")


@pytest.fixture
def open_stub():
    """Make bare clients of a service."""
    channels = []

    def make(server, *, has_token=True):
        channels.append(grpc.insecure_channel(server.address))
        return Stub(channels[-1], token_of(server) if has_token else ())

    yield make
    for channel in channels:
        channel.close()


@pytest.fixture
def stub(server, open_stub):
    return open_stub(server)


@pytest.fixture
def acquire():
    """Open control streams that stay open until the end; returns stream and lease."""
    opened = []

    def make(stub, name="bare"):
        outbox = queue.SimpleQueue()
        request = pb.LeaseRequest(version=own_version(), client=name)
        outbox.put(pb.StepRequest(acquire=request))
        stream = stub.control(iter(outbox.get, None), timeout=60)
        opened.append((stream, outbox))
        return stream, next(stream).lease

    yield make
    for stream, outbox in opened:
        stream.cancel()
        outbox.put(None)


@pytest.fixture
def lease(stub, acquire):
    return acquire(stub)[1]


def token_of(server):
    """Return the metadata that a call to this service needs."""
    token = GrpcAddress.parse(server.url).token
    return [("authorization", f"Bearer {token}")]


def wait_until(is_true, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not is_true() and time.monotonic() < deadline:
        time.sleep(0.005)
    assert is_true()


def refused(call, *args, code=grpc.StatusCode.INVALID_ARGUMENT):
    """Return what the service says of a call that it must refuse."""

    def whole():
        answer = call(*args, timeout=10)
        list(answer if hasattr(answer, "__next__") else ())

    with pytest.raises(grpc.RpcError) as error:
        whole()
    assert error.value.code() == code, error.value
    problem = problem_in(error.value)
    assert problem is not None
    assert problem.text == error.value.details()
    return problem


@pytest.fixture
def spawn_learner(start):
    """Start learners in processes of their own; returns when the arm moves."""
    processes = []

    def start_one(server, how):
        script = Path(__file__).with_name("learner.py")
        address = server.url
        process = subprocess.Popen(
            [sys.executable, str(script), address, how, *map(str, start)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        assert process.stdout.readline() == "moving\n", process.stderr.read()
        return process

    yield start_one
    for process in processes:
        process.kill()
        process.communicate(timeout=20)


@pytest.fixture(scope="session")
def authority(tmp_path_factory):
    """Make an authority, and certificates that it or a stranger signed."""
    folder = tmp_path_factory.mktemp("certificates")

    def openssl(*words):
        subprocess.run(
            ["openssl", *words], cwd=folder, check=True, capture_output=True, timeout=60
        )

    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-noenc"]
    for name in ("ca", "stranger"):
        openssl(
            *("req", "-x509", *key, "-keyout", f"{name}.key", "-out", f"{name}.pem"),
            *("-subj", f"/CN=test {name}", "-days", "2"),
        )
    places = {
        "service": ("ca", "DNS:localhost,IP:127.0.0.1"),
        "elsewhere": ("ca", "DNS:robot.example"),
        "learner": ("ca", "DNS:learner"),
        "intruder": ("stranger", "DNS:learner"),
    }
    for name, (signer, place) in places.items():
        (folder / f"{name}.ext").write_text(f"subjectAltName={place}\n")
        openssl(
            *("req", *key, "-keyout", f"{name}.key", "-out", f"{name}.csr"),
            *("-subj", f"/CN={name}"),
        )
        openssl(
            *("x509", "-req", "-in", f"{name}.csr", "-CA", f"{signer}.pem"),
            *("-CAkey", f"{signer}.key", "-CAcreateserial", "-days", "2"),
            *("-extfile", f"{name}.ext", "-out", f"{name}.pem"),
        )
    return folder
