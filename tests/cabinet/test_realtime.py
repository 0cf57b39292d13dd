"""Real-time priority, asked for and refused."""

import os
import subprocess
import sys

from dovetail.cabinet.realtime import request_realtime


def test_where_it_is_not_permitted_the_message_says_what_to_do(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    message = request_realtime()
    assert "no real-time priority" in message
    assert "ulimit -r 99" in message


def test_it_is_given_or_explained():
    code = "from dovetail.cabinet.realtime import request_realtime as r; print(r(1))"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert "real-time priority" in result.stdout
