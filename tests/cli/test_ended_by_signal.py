"""A command that runs until it is told to end is told by any number of signals."""

import os
import signal
import subprocess
import sys

import pytest

from dovetail.commands.ended_by_signal import ended_by_signal


@pytest.mark.timeout(60)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_the_middle_of_another_one_does_not_block(number):
    """A `threading.Event` that they set waited for its own lock for ever."""
    burst = f"import os\nfor _ in range(20000): os.kill({os.getpid()}, {number:d})"
    with ended_by_signal() as end:
        sender = subprocess.Popen([sys.executable, "-c", burst])
        while sender.poll() is None:
            end.wait(1e-4)
        assert end.is_requested()
        assert end.wait()


def test_nothing_is_told_without_a_signal_and_handlers_come_back():
    before = signal.getsignal(signal.SIGTERM)
    with ended_by_signal() as end:
        assert not end.wait(0.001)
        assert not end.is_requested()
        assert signal.getsignal(signal.SIGTERM) is not before
    assert signal.getsignal(signal.SIGTERM) is before
