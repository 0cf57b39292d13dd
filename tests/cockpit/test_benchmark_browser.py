"""The driven browser of tests and benchmarks ends with the process that opened it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from extras import need

from .conftest import BENCHMARKS, from_benchmarks, wait_until

need("selenium")
OPEN = """
import cockpit_browser, time
browser = cockpit_browser.open_browser()
print(browser.caps["chrome"]["userDataDir"], flush=True)
time.sleep(100)
"""


def has_process_with(word):
    """Whether a program of this machine has a word in its command line."""
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if word.encode() in file.read_bytes():
                return True
        except OSError:  # it has just ended
            continue
    return False


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_killed_process_leaves_no_browser_behind(number):
    if why := from_benchmarks("cockpit_browser").missing():
        pytest.skip(why)
    environment = {**os.environ, "PYTHONPATH": BENCHMARKS}
    words = [sys.executable, "-c", OPEN]
    with subprocess.Popen(
        words, env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        profile = process.stdout.readline().strip()
        assert has_process_with(profile)
        process.send_signal(number)
    wait_until(lambda: not has_process_with(profile), timeout=20.0)
