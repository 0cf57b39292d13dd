"""Who gets into a page, and what of theirs reaches the arm: attacks on real sockets."""

import contextlib
import http.client
import math
import socket
import time

import numpy as np
import pytest

from dovetail.cockpit.recorded import Recorded
from dovetail.cockpit.replay_page import ReplayPage
from dovetail.cockpit.server import HOST, open_server
from extras import need

from .conftest import from_benchmarks, resume, wait_until

need("viser")
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402

from dovetail.cockpit import gate  # noqa: E402

client = from_benchmarks("cockpit_client")
Client = client.Client
STOP, ESCAPE = "STOP  (Esc)", "Stop: hold the arm"
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}
WAYS = {"page": {}, "socket": UPGRADE}


@pytest.fixture(scope="module")
def server():
    """A page's server, without a page."""
    opened = open_server(0)
    yield opened
    opened.stop()


def own_protocol(server):
    return f"chat, {server.gate.subprotocol}"


def ask(server, path, headers, way, protocol=None):
    """Return the status of the answer to a request with exactly these headers."""
    connection = http.client.HTTPConnection(HOST, server.port, timeout=10.0)
    with contextlib.closing(connection):
        connection.putrequest("GET", path, skip_host=True)
        for name, value in [*headers, *WAYS[way].items()]:
            connection.putheader(name, value)
        if way == "socket":
            connection.putheader(
                "Sec-WebSocket-Protocol", protocol or own_protocol(server)
            )
        connection.endheaders()
        response = connection.getresponse()
        return response.status, response.headers


def headers_of(server, host=None, origin=None):
    named = [("Host", host or f"{HOST}:{server.port}")]
    return named + ([] if origin is None else [("Origin", origin)])


# -- who gets in -----------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", ["drive", "watch"])
@pytest.mark.parametrize(
    ("host", "origin"),
    [
        (None, None),  # a program
        ("127.0.0.1:9001", "http://127.0.0.1:9001"),  # through ssh -L 9001:...
        ("localhost:8080", "http://localhost:8080"),
        ("LOCALHOST:8080", "http://localhost:8080"),
        ("localhost", "http://localhost"),
        ("[::1]:8080", "http://[::1]:8080"),
        ("127.0.0.1:8080", "https://127.0.0.1:8080"),  # behind something that encrypts
    ],
)
def test_the_page_itself_gets_in(server, kind, host, origin, way):
    path = f"/{getattr(server.gate, f'{kind}_token')}/"
    status, _ = ask(server, path, headers_of(server, host, origin), way)
    assert status == {"page": 200, "socket": 101}[way]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", ["drive", "watch"])
@pytest.mark.parametrize(
    ("host", "origin"),
    [
        (None, "null"),
        (None, ""),
        (None, "http://evil.example"),
        (None, "http://127.0.0.1:1"),  # a page of another port
        (None, "http://localhost:{port}"),
        (None, "http://127.0.0.1:{port}.evil.example"),
        (None, "file://"),
        ("evil.example", None),  # a name that is rebound to 127.0.0.1
        ("evil.example:{port}", "http://evil.example:{port}"),
        ("127.0.0.1.evil.example:{port}", "http://127.0.0.1.evil.example:{port}"),
        ("localhost.evil.example:{port}", None),
        ("127.0.0.1:{port}@evil.example", None),
        ("192.168.1.7:{port}", None),
        ("0.0.0.0:{port}", None),
        ("", None),
    ],
)
def test_a_page_of_another_place_is_refused_though_it_knew_the_token(
    server, kind, host, origin, way
):
    here = {"port": server.port}
    headers = [("Host", f"{HOST}:{server.port}" if host is None else host)]
    headers += [] if origin is None else [("Origin", origin)]
    headers = [(name, value.format(**here)) for name, value in headers]
    path = f"/{getattr(server.gate, f'{kind}_token')}/"
    assert ask(server, path, headers, way)[0] == 403


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("names", [(), ("Host", "Host"), ("Host", "Origin", "Origin")])
def test_a_request_without_a_host_or_with_two_is_refused(server, names, way):
    right = f"{HOST}:{server.port}"
    values = {"Host": right, "Origin": f"http://{right}"}
    headers = [(name, values[name]) for name in names]
    path = f"/{server.gate.drive_token}/"
    assert ask(server, path, headers, way)[0] == 403


def test_a_page_of_another_viser_is_refused_before_viser_writes_of_it(server):
    path, headers = f"/{server.gate.drive_token}/", headers_of(server)
    for protocol in ("viser-v0.1.0", "chat", f"{server.gate.subprotocol}0"):
        assert ask(server, path, headers, "socket", protocol)[0] == 400


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/index.html",
        "/?token={token}",
        "/{token}x/",
        "/x{token}/",
        "/{short}/",
        "/{token}/index.html",
        "/{token}/../{token}/x",
        "/x/{token}/",
        "/%2e%2e/{token}/",
        "/{lower}/",
    ],
)
def test_without_the_whole_token_nothing_is_shown(server, path, way):
    token = server.gate.drive_token
    path = path.format(token=token, short=token[:-1], lower=token.lower())
    origin = f"http://{HOST}:{server.port}"
    assert ask(server, path, headers_of(server, origin=origin), way)[0] == 403


def test_the_two_tokens_are_long_random_and_new_each_time(server):
    other = gate.Gate(server.gate.subprotocol)
    tokens = {server.gate.drive_token, server.gate.watch_token}
    tokens |= {other.drive_token, other.watch_token}
    other.close()
    assert len(tokens) == 4
    assert min(map(len, tokens)) >= 32


@pytest.mark.parametrize("query", ["", "?gpu", "?fixedDpr=0.5"])
def test_no_page_can_show_this_one_inside_and_no_link_carries_its_address(
    server, query
):
    path = f"/{server.gate.drive_token}/{query}"
    _, headers = ask(server, path, headers_of(server), "page")
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cache-Control"] == "no-store"


def test_a_gate_that_viser_does_not_go_through_is_an_error(monkeypatch):
    def not_through(_):
        return contextlib.nullcontext()

    monkeypatch.setattr(gate, "serving", not_through)
    with pytest.raises(gate.GateError):
        open_server(0)


def test_a_gate_that_does_not_see_messages_is_an_error(monkeypatch):
    monkeypatch.delattr(gate.Visitor, "recv")
    monkeypatch.setattr(gate, "TRIED_FOR", 0.3)
    with pytest.raises(gate.GateError):
        open_server(0)


def test_other_web_sockets_of_the_process_are_left_alone():
    from websockets.asyncio import server as module

    before = module.serve
    own = open_server(0)
    try:
        assert module.serve is before
    finally:
        own.stop()


def test_nothing_that_a_stranger_sends_reaches_the_terminal_as_an_escape(caplog):
    own = open_server(0)
    try:

        def is_said():  # at most once a second
            with socket.create_connection((HOST, own.port)) as scan:
                scan.sendall(b"\x1b[31mPOST / HTTP/1.1\r\n\r\n")
                scan.recv(100)
            time.sleep(0.1)
            return caplog.records

        wait_until(is_said)
    finally:
        own.stop()
    assert all(record.getMessage().isprintable() for record in caplog.records)


# -- what passes -----------------------------------------------------------------------


def watching_attacks(session):
    """Everything with which a viewer could drive."""
    above = session.snapshot.tool.position + np.array([0.0, 0.0, 0.05])
    return {
        "start by key": lambda viewer: viewer.key("Start"),
        "reset by key": lambda viewer: viewer.key("Reset"),
        "demonstration": lambda viewer: viewer.set("Demonstration", value="Begin"),
        "pull": lambda viewer: viewer.drag("/pull", above),
        "drag": lambda viewer: viewer.drag("/drag", above),
        "lead": lambda viewer: viewer.drag("/lead", above),
        "another policy": lambda viewer: viewer.set("Policy", value="none"),
        "a switch": lambda viewer: viewer.press("Lead the tool: off"),
        "the camera": lambda viewer: viewer.press("Cover the camera: off"),
        "the speed": lambda viewer: viewer.set("Speed", value="x 2"),
        "what is shown": lambda viewer: viewer.press("Walls of the tool: on"),
    }


def test_a_watcher_sees_everything_may_stop_and_never_drives(served):
    session, page, server = served
    page.panel.leads.show(True)
    viewer, speed = Client(server.watch_address), session.pace.speed
    wait_until(lambda: "Lead the tool: on" in viewer.controls)
    viewer.controls["Lead the tool: off"] = viewer.controls["Lead the tool: on"]
    choice, begin = session.choice, session.snapshot
    for attack in watching_attacks(session).values():
        refused = server.gate.refused
        attack(viewer)
        wait_until(lambda refused=refused: server.gate.refused > refused)
    end = session.snapshot.stamp + 0.4
    wait_until(lambda: session.snapshot.stamp > end)
    assert page.driver_lock.driver is None
    assert session.choice is choice
    assert session.status.mode == "held"
    assert session.pace.speed == speed
    assert page.panel.leads.is_on
    assert page.panel.walls.is_on
    assert not session.is_covered
    assert not session.snapshot.pull.any()
    np.testing.assert_allclose(
        session.snapshot.tool.position, begin.tool.position, atol=1e-4
    )
    wait_until(lambda: viewer.notes)
    viewer.press(STOP)
    wait_until(lambda: session.is_stopped)
    resume(session)
    viewer.key(ESCAPE)
    wait_until(lambda: session.is_stopped)
    viewer.press("Resume")
    time.sleep(1.2)
    viewer.press("Resume")
    time.sleep(0.1)
    assert session.is_stopped
    viewer.close()


CHANGES = {
    "removed": {"removed": True},
    "removed and pressed": {"removed": True, "value": True},
    "disabled": {"disabled": True},
    "hidden": {"visible": False},
    "another name": {"uuid": "x"},
    "no callbacks": {"update_cb": []},
    "no properties": {"props": {}},
    "no button": {"is_button": False},
    "no synchronisation": {"sync_cb": None},
    "a list": {"value": [1, 2]},
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_no_message_makes_stop_dead(served, change):
    session, _, server = served
    driver, other = Client(server.address), Client(server.watch_address)
    session.start()
    wait_until(lambda: session.status.mode == "running")
    for label in (STOP, "Start", "Resume", "Policy"):
        if label in driver.controls:
            driver.set(label, **change)
    key = {"type": "CommandUpdateMessage", "uuid": driver.controls[ESCAPE]}
    driver.send({**key, "updates": {"disabled": True}})
    driver.send({"type": "RemoveCommandMessage", "uuid": driver.controls[ESCAPE]})
    driver.send({"type": "GuiRemoveMessage", "uuid": driver.controls[STOP]})
    driver.send({"type": "ResetGuiMessage"})
    time.sleep(0.1)
    assert not session.is_stopped
    other.press(STOP)
    wait_until(lambda: session.is_stopped)
    resume(session)
    driver.key(ESCAPE)
    wait_until(lambda: session.is_stopped and session.core.arm.is_held)
    driver.close()
    other.close()


def test_stop_of_a_page_that_was_built_anew_since_still_stops(served):
    session, _, server = served
    viewer, driver = Client(server.watch_address), Client(server.address)
    words, version = dict(viewer.controls), session.version
    driver.set("Policy", value="none")
    wait_until(lambda: session.version > version)
    wait_until(lambda: viewer.controls[STOP] != words[STOP])
    viewer.controls = words
    viewer.press(STOP)
    wait_until(lambda: session.is_stopped)
    viewer.close()
    driver.close()


@pytest.mark.parametrize("kind", ["ShareUrlRequest", "ShareUrlDisconnect"])
def test_a_client_opens_no_tunnel(served, monkeypatch, kind):
    import viser

    asked = []
    for name in ("request_share_url", "disconnect_share_url"):
        monkeypatch.setattr(viser.ViserServer, name, lambda *_, **__: asked.append(1))
    _, _, server = served
    driver = Client(server.address)
    refused = server.gate.refused
    driver.send({"type": kind})
    wait_until(lambda: server.gate.refused > refused)
    time.sleep(0.2)
    assert not asked
    driver.close()


@pytest.mark.parametrize(
    ("label", "value"),
    [
        ("Policy", "../../etc/passwd"),
        ("Policy", "x" * 400),
        ("Policy", True),
        ("Policy", 3),
        ("Arm", "grpc://evil.example:50051"),
        ("scheme", "nothing"),
        ("Demonstration", "Explode"),
        ("Speed", "x 1000"),
        ("Walls of the tool: on", False),
        ("Walls of the tool: on", 1),
        ("Walls of the tool: on", "yes"),
    ],
)
def test_a_value_that_the_control_cannot_have_changes_nothing(served, label, value):
    session, page, server = served
    driver, other = Client(server.address), Client(server.watch_address)
    choice, version, speed = session.choice, session.version, session.pace.speed
    refused = server.gate.refused
    driver.set(label, value=value)
    wait_until(lambda: server.gate.refused > refused)
    end = session.snapshot.stamp + 0.2
    wait_until(lambda: session.snapshot.stamp > end)
    assert session.choice is choice
    assert session.version == version
    assert session.pace.speed == speed
    assert page.panel.walls.is_on
    assert page.driver_lock.driver is None  # nonsense does not take the lock
    driver.close()
    other.close()


def test_uploads_are_not_kept(served):
    _, _, server = served
    driver = Client(server.address)
    refused = server.gate.refused
    where = {
        "transfer_uuid": "x",
        "source_component_uuid": driver.controls["Policy"],
    }
    about = {"filename": "a", "mime_type": "b", "part_count": 50, "size_bytes": 50_000}
    driver.send({"type": "FileTransferStartUpload", **where, **about})
    for part in range(5):
        content = {"part_index": part, "content": bytes(1000)}
        driver.send({"type": "FileTransferPart", **where, **content})
    wait_until(lambda: server.gate.refused >= refused + 6)
    time.sleep(0.2)
    assert "FileTransferPartAck" not in driver.kinds
    driver.close()


def test_on_the_replay_page_a_time_outside_is_dropped_and_a_watcher_turns_nothing(
    session,
):
    session.pull(session.snapshot.tool.position + np.array([0.0, 0.0, 0.05]))
    end = session.snapshot.stamp + 0.5
    wait_until(lambda: session.snapshot.stamp > end)
    session.close()
    recorded = Recorded.load(session.logger.files[-1])
    server = open_server(0)
    page = ReplayPage(server, (recorded,))
    driver, viewer = Client(server.address), Client(server.watch_address)
    for value in (math.nan, math.inf, -1.0, recorded.end + 1.0, "1", True):
        driver.set("Time [s]", value=value)
    viewer.set("Time [s]", value=0.2)
    viewer.press("Play / pause  (P)")
    wait_until(lambda: server.gate.refused == 8)
    assert page.now == 0.0
    driver.set("Time [s]", value=0.2)
    wait_until(lambda: page.now == 0.2)
    driver.close()
    viewer.close()
    page.close()
    server.stop()


# -- floods ----------------------------------------------------------------------------


def press_stop(session, viewer):
    """Press STOP, which holds the arm; benchmarks/cockpit_stop.py measures how soon."""
    viewer.press(STOP)
    wait_until(lambda: session.is_stopped and session.core.arm.is_held)


def flood_with(raw, count):
    def flood(viewer):
        for _ in range(count):
            viewer.send_bytes(raw)

    return flood


FLOODS = {
    "messages": flood_with(client.msgspec.msgpack.encode(client.CAMERA), 2000),
    "nothings": flood_with(b"", 20_000),
    "a long one": flood_with(bytes(100_000), 1),
    "long ones": flood_with(bytes(gate.MESSAGE_MAX), 200),
    "text": lambda viewer: [viewer._socket.send("x" * 1000) for _ in range(200)],
    "pings": lambda viewer: [viewer._socket.ping() for _ in range(20_000)],
}


@pytest.mark.parametrize("flood", FLOODS.values(), ids=FLOODS)
def test_a_client_that_floods_is_cut_and_others_stop_meanwhile(served, flood):
    session, _, server = served
    viewer, hostile = Client(server.watch_address), Client(server.watch_address)
    with contextlib.suppress(ConnectionClosed, OSError):
        flood(hostile)
    press_stop(session, viewer)
    wait_until(lambda: hostile.is_closed)
    assert not viewer.is_closed
    viewer.close()


def test_connections_that_ask_for_nothing_keep_nobody_out(served):
    session, _, server = served
    viewer, idle = Client(server.watch_address), []
    try:
        for _ in range(300):
            idle.append(socket.create_connection((HOST, server.port)))
            idle[-1].sendall(b"GET /")
        other = Client(server.address)
        press_stop(session, viewer)
        other.close()
    finally:
        for opened in idle:
            opened.close()
    viewer.close()


def test_many_watchers_do_not_keep_the_driver_out(served):
    _, _, server = served
    watchers = [Client(server.watch_address) for _ in range(gate.VIEWERS_MAX)]
    driver = Client(server.address)
    wait_until(lambda: len(server.viser.get_clients()) == gate.VIEWERS_MAX + 1)
    for viewer in (driver, *watchers):
        viewer.close()


def test_silent_watchers_do_not_keep_one_more_from_stopping(served):
    session, _, server = served
    silent = [Client(server.watch_address) for _ in range(3 * gate.VIEWERS_MAX)]
    wait_until(lambda: len(server.viser.get_clients()) == gate.VIEWERS_MAX)
    late = Client(server.watch_address)
    press_stop(session, late)
    for viewer in (late, *silent):
        with contextlib.suppress(Exception):
            viewer.close()


def test_no_more_may_drive_than_there_is_room_for(served):
    _, _, server = served
    drivers = [Client(server.address) for _ in range(gate.VIEWERS_MAX)]
    with pytest.raises(InvalidStatus) as refusal:
        Client(server.address)
    assert refusal.value.response.status_code == 503
    for viewer in drivers:
        viewer.close()


def test_each_of_many_stops_under_attack_stops(served):
    """100 here; 1,000 in benchmarks/cockpit_stop.py."""
    stop_under_attack = from_benchmarks("cockpit_stop").stop_under_attack
    session, _, server = served
    tries = stop_under_attack(session, server, 100)
    assert len(tries) == 100
    assert [what for what in tries if isinstance(what, str)] == []
