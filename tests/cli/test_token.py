"""The token of a service's address is in no message of a command."""

import os

import pytest

from dovetail.cli import run

SECRET = "a-secret-of-some-length"


@pytest.mark.parametrize(
    "words",
    [
        ["evaluate", "peg_square", "--arm", "grpc://127.0.0.1:1?token={}&perod=1ms"],
        ["evaluate", "peg_square", "--arm=grpc://127.0.0.1:1?token={}"],
        ["evaluate", "peg_square", "--arm", "grpc://192.0.2.1:1?token={}"],
        ["serve", "--arm", "grpc://127.0.0.1:1?period=1ms&token={}"],
        ["doctor", "--arm", "grpc://127.0.0.1:1?tok%65n={}&perod=1ms&token={}"],
        ["cockpit", "--arm", "grpc:/127.0.0.1:1?token={}", "--twin", "medium"],
    ],
)
def test_a_refusal_does_not_show_the_token(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run([word.format(SECRET, SECRET) for word in words]) != 0
    said = capsys.readouterr()
    assert SECRET not in said.out + said.err
    assert "DOVETAIL_TOKEN" not in os.environ


def test_what_was_in_the_environment_is_there_again(monkeypatch):
    monkeypatch.setenv("DOVETAIL_TOKEN", "of-the-environment")
    run(["evaluate", "peg_square", "--arm", f"grpc://127.0.0.1:1?token={SECRET}"])
    assert os.environ["DOVETAIL_TOKEN"] == "of-the-environment"
