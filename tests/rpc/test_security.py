"""Who may connect: loopback with a token, everyone else with the right ones."""

import socket

import grpc
import pytest

from dovetail.arms.remote_arm import GrpcAddress
from dovetail.errors import ArmError, ConfigError
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.security import Certificates, is_loopback, split_address
from dovetail.rpc.server import ArmServer
from dovetail.rpc.version import own_version

from .conftest import HOLE, push, refused


def files_of(folder, name, ca="ca"):
    return Certificates(
        cert=folder / f"{name}.pem", key=folder / f"{name}.key", ca=folder / f"{ca}.pem"
    ).check()


@pytest.fixture
def secure(builder, authority):
    """A service that only learners of the authority can use."""
    with ArmServer(builder, "127.0.0.1:0", files_of(authority, "service")) as server:
        yield server


def address(server, folder, name="learner", ca="ca"):
    return (
        f"grpc://{server.address}?ca={folder / ca}.pem&cert={folder / name}.pem"
        f"&key={folder / name}.key"
    )


@pytest.mark.parametrize("host", ["0.0.0.0", "[::]", "192.0.2.1", "robot.example"])
def test_no_other_address_than_loopback_without_certificates(builder, host):
    with pytest.raises(ConfigError, match="--cert, --key and --client-ca"):
        ArmServer(builder, f"{host}:0")


def test_with_certificates_every_address_is_possible(builder, authority):
    ArmServer(builder, "0.0.0.0:0", files_of(authority, "service")).close()


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        *(("127.0.0.1", True), ("127.9.9.9", True), ("::1", True)),
        *(("localhost", True), ("0.0.0.0", False), ("::", False)),
        *(("10.0.0.1", False), ("localhost.evil.example", False), ("", False)),
    ],
)
def test_what_is_loopback(host, expected):
    assert is_loopback(host) is expected


@pytest.mark.parametrize(
    "text", ["", "50051", ":50051", "h:", "h:x", "h:-1", "h:70000"]
)
def test_addresses_that_are_none(text):
    with pytest.raises(ConfigError, match="give HOST:PORT"):
        split_address(text)


def test_a_learner_of_the_authority_moves_the_arm(secure, authority, start, connect):
    arm = connect(address(secure, authority))
    arm.reset(start, HOLE)
    assert arm.step(push(0.0)).stamp == 0.05
    assert "(learner)" in str(secure.service.leases.holder)


def test_a_strangers_certificate_is_refused_with_a_reason_on_both_sides(
    secure, authority, start, connect, capfd
):
    good = connect(address(secure, authority))
    with pytest.raises(ArmError, match=r"refuses the certificate .*intruder\.pem"):
        connect(address(secure, authority, "intruder"))
    assert "CERTIFICATE_VERIFY_FAILED" in capfd.readouterr().err  # gRPC says so itself
    good.reset(start, HOLE)  # the service goes on


def test_a_service_of_another_authority_is_refused_with_a_reason(
    secure, authority, connect
):
    with pytest.raises(ArmError, match=r"service's certificate is refused here: "):
        connect(address(secure, authority, ca="stranger"))


def test_a_service_with_another_name_is_refused_with_a_reason(
    builder, authority, connect
):
    files = files_of(authority, "elsewhere")
    with (
        ArmServer(builder, "127.0.0.1:0", files) as server,
        pytest.raises(ArmError, match=r"made for the name '127\.0\.0\.1'"),
    ):
        connect(address(server, authority))


def test_without_tls_a_learner_is_told_that_it_is_needed(secure, connect):
    with pytest.raises(ArmError, match="the service wants TLS"):
        connect(secure, timeout=20)


def test_with_tls_to_a_service_without_it(server, authority, connect):
    with pytest.raises(ArmError, match="was the service started with certificates"):
        connect(address(server, authority), timeout=20)


def test_a_key_of_another_certificate_is_refused_at_the_start(authority):
    files = Certificates(
        cert=authority / "service.pem",
        key=authority / "learner.key",
        ca=authority / "ca.pem",
    )
    with pytest.raises(ConfigError, match="key values mismatch"):
        files.check()


@pytest.mark.parametrize("name", ["cert", "key", "ca"])
def test_files_that_are_none(authority, tmp_path, name):
    paths = {
        n: authority / f"service.{e}" for n, e in (("cert", "pem"), ("key", "key"))
    }
    paths |= {"ca": authority / "ca.pem"}
    empty = tmp_path / "empty.pem"
    empty.write_text("nothing\n")
    with pytest.raises(ConfigError, match=r"empty\.pem .*cannot be used"):
        Certificates(**(paths | {name: empty})).check()
    with pytest.raises(ConfigError, match=f"{name} file .* cannot be read: No such"):
        Certificates(**(paths | {name: tmp_path / "missing"})).check()


def test_a_port_in_use_says_so_and_leaves_nothing_behind(builder, server):
    with pytest.raises(ConfigError, match=r"already in use; another .*ss -ltnp"):
        ArmServer(builder, server.address)


def test_an_address_of_another_machine(builder, authority):
    with pytest.raises(ConfigError, match=r"192\.0\.2\.1:5000.*no such address"):
        ArmServer(builder, "192.0.2.1:5000", files_of(authority, "service"))


def test_a_port_that_needs_privileges(builder, forbidden_port):
    with pytest.raises(ConfigError, match="need privileges"):
        ArmServer(builder, f"127.0.0.1:{forbidden_port}")


def test_clients_that_only_connect_are_no_harm(server, start, connect):
    host, port = server.address.rsplit(":", 1)
    idle = [socket.create_connection((host, int(port))) for _ in range(100)]
    arm = connect(server)
    arm.reset(start, HOLE)
    assert arm.step(push(0.0)).stamp == 0.05
    for connection in idle:
        connection.close()


@pytest.mark.parametrize(
    "name", ["get_info", "configure", "reset", "step", "clear", "state", "get_log"]
)
def test_without_the_token_only_a_stop_is_served(server, builder, open_stub, name):
    stranger = open_stub(server, has_token=False)
    kind = {"get_info": "InfoRequest", "configure": "Configuration"}
    kind |= {"reset": "ResetRequest", "step": "StepRequest", "clear": "Holder"}
    kind |= {"state": "WatchRequest", "get_log": "LogRequest"}
    request = getattr(pb, kind[name])()
    refused(getattr(stranger, name), request, code=grpc.StatusCode.UNAUTHENTICATED)
    stranger.stop(pb.StopRequest(reason="hand in the cell"), timeout=10)
    assert server._host.stop_reason.startswith("hand in the cell")


def test_without_the_token_nobody_gets_the_lease(server, open_stub):
    acquire = pb.LeaseRequest(version=own_version(), client="stranger")
    requests = iter([pb.StepRequest(acquire=acquire)])
    stranger = open_stub(server, has_token=False)
    refused(stranger.control, requests, code=grpc.StatusCode.UNAUTHENTICATED)
    assert server.service.leases.holder is None


def test_each_service_has_a_token_of_its_own(builder):
    urls = []
    for _ in range(2):
        server = ArmServer(builder, "127.0.0.1:0")
        urls.append(server.url)
        server.close()
    tokens = {GrpcAddress.parse(url).token for url in urls}
    assert len(tokens) == 2
    assert min(len(token) for token in tokens) >= 16
