"""`--period`: one way to write it, in every command."""

import json

import pytest

from dovetail.cli import run

FRI = "fri://127.0.0.1:1?control=127.0.0.1:2"
COMMANDS = (
    ("evaluate", "peg_square", "--twin", "easy"),
    ("demo",),
    ("train",),
    ("identify", "record", "--out", "RECORDING"),
    ("serve",),
)


def exit_code(words):
    try:
        return run(list(words))
    except SystemExit as stop:  # tyro's own
        return stop.code


def say(words, capsys):
    """Run a command line that fails at once; return its error, lines joined."""
    assert exit_code(words) == 2
    return " ".join(capsys.readouterr().err.replace("│", " ").split())


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
@pytest.mark.parametrize("period", ["3ms", "4ms", "0.006s"])
def test_a_period_that_is_none_is_refused_at_once(command, period, capsys, tmp_path):
    words = [word.replace("RECORDING", str(tmp_path / "log")) for word in command]
    error = say([*words, "--period", period], capsys)
    assert "allowed: 1, 2, 2.5 and 5 ms; take" in error
    assert "period is" in error
    assert not (tmp_path / "log").exists()


@pytest.mark.parametrize("command", [*COMMANDS, ("cabinet",)], ids=" ".join)
@pytest.mark.parametrize("text", ["5", "ms", "fast", "nanms"])
def test_a_period_without_number_or_unit_is_refused(command, text, capsys):
    error = say([*command, "--period", text], capsys)
    assert f"--period is '{text}'; give a number and its unit" in error


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["cabinet", "--period", "2.5ms"], "send period is 2.5 ms; allowed are whole"),
        (["evaluate", "peg_square", "--arm", FRI, "--period", "2.5ms"], "FRI knows"),
        (["serve", "--arm", "fri://127.0.0.1:1", "--period", "2.5ms"], "FRI knows"),
        (
            ["evaluate", "peg_square", "--arm", f"{FRI}&period=1ms", "--period", "2ms"],
            "period is 2ms and the arm's address says 1ms; give one of them",
        ),
        (["doctor", "--arm", "fri://127.0.0.1:1?period=3ms"], "arm period is 3 ms"),
    ],
)
def test_what_fri_cannot_send_is_refused(words, message, capsys):
    assert message in say(words, capsys)


def test_an_evaluation_says_its_period_wherever_it_is_read(tmp_path, capsys):
    words = ["evaluate", "peg_square", "--twin", "easy", "--tries", "1"]
    words += ["--max-steps", "2", "--no-keep-logs", "--period", "2.5ms"]
    assert run([*words, "--out", str(tmp_path / "out")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "control period 2.5 ms" in printed
    assert "control period is 2.5 ms, the policy's training had 5 ms" in printed
    content = json.loads((tmp_path / "out/report.json").read_text())
    assert content["control period [s]"] == 0.0025
    assert content["config"]["environment"]["period"] == 0.0025
    assert "--period 2.5ms" in content["command"]
    page = (tmp_path / "out/report.html").read_text()
    assert "at a control period of 2.5 ms" in page
