"""Text of the other end stands on a terminal and does nothing there."""

import io

import pytest

from dovetail.cli import Terminal
from dovetail.commands.cabinet import describe_status
from dovetail.commands.doctor import Doctor
from dovetail.doctor.check import Check
from dovetail.errors import ArmError, ConfigError, LogError
from dovetail.printable import printable

HOSTILE = "a\x1b[2Jb\x9b1mc\u202ed\x07\ne\ud800"
STATUS = {
    "state": "IDLE",
    "quality": "POOR",
    "rate": 0.0,
    "time": 0.0,
    "counts": {},
    "stop_reason": HOSTILE,
}


def shown(text):
    """What a terminal is sent, without line breaks: the terminal makes them."""
    return text.replace("\n", "")


def test_what_can_be_seen_stays_as_it_is():
    assert printable("Prüfstand A1: 0.3 Nm ✓") == "Prüfstand A1: 0.3 Nm ✓"


def test_what_cannot_be_seen_is_written_as_an_escape():
    assert printable(HOSTILE).isprintable()
    assert r"a\x1b[2Jb\x9b1mc" in printable(HOSTILE)
    assert printable("one\ntwo", keep="\n") == "one\ntwo"


@pytest.mark.parametrize("kind", [ArmError, ConfigError, LogError])
def test_an_error_that_quotes_it_is_printable(kind):
    assert shown(str(kind(f"it said {HOSTILE}"))).isprintable()


def test_a_terminal_shows_it():
    file = io.StringIO()
    console = Terminal(file=file, force_terminal=False)
    console.print(HOSTILE)
    console.print(HOSTILE, soft_wrap=True, highlight=False)
    assert shown(file.getvalue()).isprintable()


def test_the_line_of_a_cabinet_is_one_line():
    assert describe_status(STATUS).isprintable()


def test_a_check_of_the_doctor_is_one_line(monkeypatch):
    check = Check("connection", "ok", f"FRI from {HOSTILE}")
    monkeypatch.setattr("dovetail.commands.doctor.run_checks", lambda: iter([check]))
    file = io.StringIO()
    assert Doctor().run(Terminal(file=file, force_terminal=False)) == 0
    assert file.getvalue().rstrip("\n").isprintable()


def test_an_error_of_a_service_is_printable():
    problems = pytest.importorskip("dovetail.rpc.problems")
    pb = problems.pb
    said = problems.error_of(pb.Problem(kind="PlantError", text=HOSTILE[:-1]))
    assert str(said).isprintable()
    wrong = pb.Problem()
    wrong.fields.add(path="q\x1b[0m", value="1", allowed="0\nok  hold")
    assert str(problems.error_of(wrong)).isprintable()
