"""The control port: requests, and everything that is none."""

import json
import socket
import threading
import time
from contextlib import suppress

import numpy as np
import pytest

from dovetail.arms.cabinet_control import CabinetControl
from dovetail.cabinet import control_port
from dovetail.cabinet.config import Endpoint
from dovetail.cabinet.control_port import MAX_LINE
from dovetail.cabinet.protocol import SessionState
from dovetail.cabinet.signals import parse_signal
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError, ConfigError

from .client import mirror, wait_until
from .conftest import FIXTURE, Q_START, LightPlant

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState
WHERE = {"position": FIXTURE.position.tolist(), "quat_wxyz": FIXTURE.quat_wxyz.tolist()}
PLACE = {"do": "place", "q": Q_START.tolist(), "fixture": WHERE}


class Line:
    """One connection to the control port."""

    def __init__(self, address):
        self.socket = socket.create_connection(address, timeout=20.0)
        self.file = self.socket.makefile("rwb")

    def send(self, line):
        self.file.write(line + b"\n")
        self.file.flush()
        return self.read()

    def ask(self, **request):
        return self.send(json.dumps(request).encode())

    def read(self):
        return json.loads(self.file.readline())

    def close(self):
        self.file.close()
        self.socket.close()


@pytest.fixture
def cabinet(make, client):
    client.start()
    with make(io=(parse_signal("FRI.In_Bool:boolean:input"),)) as cabinet:
        yield cabinet


@pytest.fixture
def line(cabinet):
    line = Line(cabinet.control_address)
    yield line
    line.close()


def test_status_says_how_it_goes(line, client):
    client.wait_for(ACTIVE)
    status = line.ask(do="status")
    assert status["ok"]
    assert status["state"] == "COMMANDING_ACTIVE"
    assert status["quality"] in ("GOOD", "EXCELLENT")
    assert status["counts"]["sent"] > 80
    assert status["clock"] == "lockstep"


def test_a_client_of_another_robot_is_refused_by_both_names(cabinet):
    control = CabinetControl(str(cabinet.control_address))
    own, other = find_cell(), find_cell(robot="fr3")
    control.agree(own, 0.0)
    for ask in (
        lambda: control.agree(other, 0.0),
        lambda: control.place(Q_START, FIXTURE, cell=other),
    ):
        with pytest.raises(ArmError, match=r"robot is fr3, the cabinet's iiwa14") as no:
            ask()
        assert no.value.reason == "refused"
    control.place(Q_START, FIXTURE, cell=own)
    control.close()


def test_a_cabinet_that_is_still_starting_is_waited_for():
    with socket.create_server(("127.0.0.1", 0)) as probe:
        where = probe.getsockname()

    def start_late():
        time.sleep(0.2)
        with socket.create_server(where) as server:
            connection, _ = server.accept()
            with connection, connection.makefile("rwb") as file:
                file.readline()
                file.write(b'{"ok": true}\n')

    control = CabinetControl(f"{where[0]}:{where[1]}")
    with pytest.raises(ArmError) as no:
        control.agree(find_cell(), 0.1)
    assert no.value.reason == "no_control"
    starting = threading.Thread(target=start_late)
    starting.start()
    control.agree(find_cell(), 20.0)
    starting.join()
    control.close()


def test_a_robot_that_is_none_is_refused(line):
    for robot in ("{", json.dumps({"name": "arm"}), 5, ["fr3"], {}, None):
        for request in ({"do": "agree"}, PLACE):
            assert "robot" in line.ask(**request, robot=robot)["error"]


def test_a_wrong_number_in_a_request_does_not_spoil_the_log(make, client, tmp_path):
    client.start()
    path = tmp_path / "log"
    with make(log=path) as cabinet:
        line = Line(cabinet.control_address)
        line.send(b'{"do": "push", "force": [NaN, 1e999, 0], "duration": 1}')
        line.close()

    def refuse(constant):
        raise AssertionError(constant)

    texts = path.read_text().splitlines()
    lines = [json.loads(text, parse_constant=refuse) for text in texts]
    asked = next(line["request"] for line in lines if line["event"] == "request")
    assert asked["force"] == [None, None, 0]


def test_place_puts_the_arm_there_and_restarts_the_motion(cabinet, line, client):
    client.wait_for(ACTIVE)
    q = (Q_START + 0.1).tolist()
    answer = line.ask(do="place", q=q, fixture=WHERE, seed=5)
    assert answer["ok"]
    client.wait_for(ACTIVE)
    wait_until(lambda: client.messages[-1].sequence > answer["sequence"] + 40)
    first = next(m for m in client.messages if m.sequence == answer["sequence"])
    assert int(first.state) == READY
    np.testing.assert_allclose(first.q_measured, q)
    assert cabinet.controller.body.plant.noise_seed == 5
    assert client.states == [WAIT, READY, C_WAIT, ACTIVE, READY, C_WAIT, ACTIVE]


def test_place_works_while_the_client_is_thinking(cabinet, line, client):
    client.wait_for(ACTIVE)
    client.answer = lambda message: None  # withholds its reply, as a learner may
    assert line.ask(**PLACE)["ok"]
    client.states.clear()
    client.answer = mirror
    client.wait_for(ACTIVE)


def test_fixture_moves_the_fixture_alone(cabinet, line, client):
    client.wait_for(ACTIVE)
    moved = {**WHERE, "position": [0.61, 0.01, 0.1]}
    assert line.ask(do="fixture", fixture=moved)["ok"]
    assert cabinet.controller.body.plant.fixture.position.tolist() == moved["position"]
    assert client.state is ACTIVE


def test_a_grasp_holds_from_the_next_place_on(cabinet, line, client):
    client.wait_for(ACTIVE)
    offset = {"position": [0.002, 0.0, -0.001], "quat_wxyz": [1.0, 0.0, 0.0, 0.0]}
    assert line.ask(do="grasp", offset=offset)["ok"]
    plant = cabinet.controller.body.plant
    assert plant.grasped is None
    assert line.ask(**PLACE)["ok"]
    assert plant.grasped.position.tolist() == offset["position"]
    far = {**offset, "position": [0.1, 0.0, 0.0]}
    assert not line.ask(do="grasp", offset=far)["ok"]


def test_a_fixture_cannot_move_faster_than_is_said(line, client):
    client.wait_for(ACTIVE)
    answer = line.ask(do="fixture", fixture=WHERE, velocity=[0.0, 2.0, 0.0])
    assert not answer["ok"]
    assert "velocity is 2 m/s; allowed is 0 to 1 m/s" in answer["error"]
    assert line.ask(do="fixture", fixture=WHERE, velocity=[0.0, 0.02, 0.0])["ok"]


def test_push_fault_io_truth_pause_resume_and_stop_are_served(line, client):
    client.wait_for(ACTIVE)
    assert line.ask(do="push", force=[1, 0, 0], duration=0.1)["ok"]
    assert line.ask(do="fault", text="delay=1ms")["ok"]
    assert line.ask(do="status")["faults"] == "delay=0.001s"
    assert line.ask(do="io", name="FRI.In_Bool", value=1)["ok"]
    assert line.ask(do="status")["io"] == {"FRI.In_Bool": 1.0}
    truth = line.ask(do="truth")
    assert len(truth["tool"]["position"]) == len(truth["contact_force_peak"]) == 3
    assert truth["contact_force_peak"][2] > 0.0
    assert line.ask(do="pause")["ok"]
    client.wait_for(READY)
    assert line.ask(do="resume")["ok"]
    client.wait_for(ACTIVE)
    assert line.ask(do="stop")["ok"]
    client.wait_for(IDLE)
    assert line.ask(do="status")["state"] == "IDLE"


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        ({}, "do is None; known: place, fixture, grasp, push, io, fault, pause"),
        ({"do": "fly"}, "do is 'fly'; known: place"),
        ({"do": ["place"]}, "known: place"),
        ({**PLACE, "q": [0.0] * 6}, "place: q is [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]; give"),
        ({**PLACE, "q": [0.0] * 8}, "give a list of 7 numbers"),
        ({**PLACE, "q": "zero"}, "give a list of 7 numbers"),
        ({**PLACE, "q": [True, *[0.0] * 6]}, "q[0] is True, which is no number"),
        ({**PLACE, "q": [1e300, *[0.0] * 6]}, "q[0] is 1e+300; give one within 1e6"),
        ({"do": "place", "q": [0.0] * 7}, "fixture is None; give"),
        ({**PLACE, "fixture": {**WHERE, "quat_wxyz": [0, 0, 0, 0]}}, "norm 0"),
        ({**PLACE, "fixture": {**WHERE, "position": [5, 0, 0.1]}}, "too far"),
        ({**PLACE, "seed": -1}, "seed is -1"),
        ({**PLACE, "seed": "x"}, "seed is 'x'"),
        ({**PLACE, "seed": 2**63}, "seed is 9223372036854775808"),
        (
            {"do": "push", "force": [1, 2], "duration": 1},
            "force is [1, 2]; give a list",
        ),
        ({"do": "push", "force": [1, 2, 3]}, "duration[0] is None"),
        ({"do": "push", "force": [1, 2, 3], "duration": -1}, "0 to 3600 s"),
        ({"do": "io", "name": "nothing", "value": 1}, "registered: FRI.In_Bool"),
        ({"do": "io", "name": "FRI.In_Bool", "value": 0.5}, "cannot be set to 0.5"),
        ({"do": "fault"}, "text is None"),
        ({"do": "fault", "text": "los=1"}, "known faults: loss"),
    ],
)
def test_a_wrong_request_is_answered_and_changes_nothing(line, request_, message):
    answer = line.ask(**request_)
    assert not answer["ok"]
    assert message in answer["error"]
    assert line.ask(do="status")["motion"] <= 1


@pytest.mark.parametrize(
    "garbage",
    [
        b"hello",
        b"{",
        b"\xff\xfe\x00",
        b"[" * 30000,
        b'{"do":' + b"[" * 900 + b"]" * 900 + b"}",
        b'{"do": "place", "seed": ' + b"9" * 400 + b"}",
        b"[1, 2]",
        b"7",
        b"null",
        b"{}\n" * 200,
        b"GET / HTTP/1.1",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    ],
)
def test_what_is_no_json_object_is_answered_with_an_error_and_ends_the_connection(
    cabinet, line, garbage
):
    assert not line.send(garbage)["ok"]
    with suppress(ConnectionResetError):  # what it had still sent was not read
        assert line.file.readline() == b""
    again = Line(cabinet.control_address)
    assert again.ask(do="status")["ok"]
    again.close()


@pytest.mark.parametrize(
    "request_",
    [
        b'{"do": NaN}',
        b'{"do": "place", "q": [NaN, 0, 0, 0, 0, 0, 0]}',
    ],
)
def test_json_that_is_no_request_is_answered_with_an_error(line, request_):
    assert not line.send(request_)["ok"]
    assert line.ask(do="status")["ok"]


def test_a_request_in_the_body_of_an_http_post_is_not_served(cabinet, client):
    """As any web page can have a browser beside the cabinet send it."""
    client.wait_for(ACTIVE)
    body = b'\n{"do": "stop"}\n'
    head = (
        f"POST / HTTP/1.1\r\nHost: {cabinet.control_address}\r\n"
        f"Content-Type: text/plain\r\nContent-Length: {len(body)}\r\n\r\n"
    )
    page = Line(cabinet.control_address)
    page.socket.sendall(head.encode() + body)
    assert not page.read()["ok"]
    with suppress(ConnectionResetError):  # what it had still sent was not read
        assert page.file.readline() == b""
    page.close()
    assert cabinet.status()["state"] == "COMMANDING_ACTIVE"


def test_empty_lines_are_skipped(line):
    assert line.send(b"\n   \n" + b'{"do": "status"}')["ok"]


def test_several_requests_in_one_packet_are_all_answered(line):
    line.socket.sendall(b'{"do": "status"}\n{"do": "fly"}\n{"do": "sta')
    assert line.read()["ok"]
    assert not line.read()["ok"]
    line.socket.sendall(b'tus"}\n')
    assert line.read()["ok"]


def test_an_endless_line_is_refused_and_the_connection_closed(cabinet):
    line = Line(cabinet.control_address)
    line.socket.sendall(b"x" * (MAX_LINE + 10000))
    assert "more than" in line.read()["error"]
    assert line.socket.recv(10) == b""
    line.close()
    again = Line(cabinet.control_address)
    assert again.ask(do="status")["ok"]
    again.close()


def test_connections_that_vanish_leave_the_others_served(cabinet, line, rng):
    for _ in range(30):
        other = socket.create_connection(cabinet.control_address)
        other.sendall(rng.bytes(50) + b"\n" + b'{"do": "status"}\n')
        other.close()
    assert line.ask(do="status")["ok"]


def test_300_silent_connections_neither_lock_the_port_nor_end_a_live_one(cabinet, line):
    assert line.ask(do="status")["ok"]
    idle = [socket.create_connection(cabinet.control_address) for _ in range(300)]
    late = Line(cabinet.control_address)
    assert late.ask(do="status")["ok"]
    assert line.ask(do="status")["ok"]
    for connection in idle:
        connection.close()
    late.close()


def test_300_connections_that_asked_once_do_not_lock_the_port(cabinet):
    control = CabinetControl(str(cabinet.control_address))
    control.request("status")
    many = []
    for _ in range(300):
        many.append(Line(cabinet.control_address))
        assert many[-1].ask(do="status")["ok"]
    assert control.request("status")["ok"]  # its own was closed: it opens another
    control.close()
    for other in many:
        other.close()


def test_a_connection_that_asks_nothing_is_closed(cabinet, monkeypatch):
    monkeypatch.setattr(control_port, "SILENCE_MAX", 0.1)
    silent = Line(cabinet.control_address)
    silent.socket.sendall(b'{"do": ')
    assert silent.file.readline() == b""
    silent.close()


def test_an_answer_that_is_not_fetched_makes_nobody_wait(cabinet, line):
    greedy = socket.socket()
    greedy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    greedy.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # no bursts as one
    greedy.connect(cabinet.control_address)
    greedy.settimeout(1.0)
    times = []
    with suppress(ConnectionError):  # the port drops it once nothing more fits
        while len(times) < 1999:
            greedy.sendall(b'{"do": "status"}\n' * 50)  # fewer than MAX_LINES
            begin = time.monotonic()
            assert line.ask(do="status")["ok"]
            times.append(time.monotonic() - begin)
    assert len(times) < 1999
    assert max(times) < 1.0
    greedy.close()


def test_a_refusal_steers_no_terminal():
    control = CabinetControl("127.0.0.1:1")
    told = {"ok": False, "error": "\x1b[2J\nok  all well"}
    control._exchange = lambda line: json.dumps(told).encode()
    with pytest.raises(ArmError) as raised:
        control.request("status")
    assert str(raised.value).isprintable()


def test_a_control_port_in_use_is_said(make, cabinet):
    taken = cabinet.control_address
    with pytest.raises(ConfigError, match=f"control port {taken} cannot be opened"):
        make(control=Endpoint(*taken))


def test_a_udp_port_in_use_is_said(make, cabinet):
    taken = cabinet.address
    with pytest.raises(ConfigError, match="the port is in use"):
        make(bind=Endpoint(*taken))


def test_a_cabinet_that_does_not_run_answers_so(make, monkeypatch):
    monkeypatch.setattr("dovetail.cabinet.cabinet._REQUEST_TIME", 0.05)
    cabinet = make(LightPlant())
    assert cabinet.request({"do": "status"})["error"] == "the cabinet does not run"


def test_no_control_port_is_needed(make):
    assert make(control=None).control_address is None


def test_a_request_that_breaks_the_plant_is_answered(cabinet, line, client):
    client.wait_for(ACTIVE)

    def fail(seed):
        raise TypeError("no such noise")

    cabinet.controller.body.plant.seed = fail
    answer = line.ask(**{**PLACE, "seed": 1})
    assert "place failed: TypeError('no such noise')" in answer["error"]
    assert cabinet.is_running


def test_a_cabinet_that_has_failed_says_why(make, client):
    client.start()
    with make() as cabinet:
        client.wait_for(ACTIVE)

        def fail():
            raise RuntimeError("for this test")

        cabinet.controller.body.plant.read = fail
        wait_until(lambda: not cabinet.is_running)
        error = cabinet.request({"do": "status"})["error"]
        assert error == "the cabinet does not run: RuntimeError: for this test"
    client.wait_for(IDLE)
