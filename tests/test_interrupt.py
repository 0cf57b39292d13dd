"""Ctrl-C is noted once, said at once, never lost, and ends at once when repeated."""

import signal
import subprocess
import sys

import pytest

HEAD = """
import ctypes, gc, os, signal, subprocess, sys, threading, time
from dovetail.interrupt import Interrupt, ends_whole, left_to_the_parent
"""


def start(code):
    process = subprocess.Popen(
        [sys.executable, "-c", HEAD + code],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.timeout(120)
def test_the_first_ends_the_work_where_it_is_whole():
    process = start("""
with ends_whole("saving") as interrupt:
    print("ready", flush=True)
    while not interrupt.is_pressed():
        time.sleep(0.01)
    print("whole", flush=True)
    try:
        interrupt.check()
    except KeyboardInterrupt:
        print("raised", flush=True)
assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
""")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert out == "whole\nraised\n"
    assert "saving" in err
    assert process.returncode == 0


@pytest.mark.timeout(120)
def test_the_second_ends_a_process_that_does_not_look():
    process = start("""
with ends_whole("saving"):
    print("ready", flush=True)
    while True:
        ctypes.CDLL(None).sleep(60)
""")
    assert process.stderr is not None
    process.send_signal(signal.SIGINT)
    assert process.stderr.readline() == "\n"
    assert "saving" in process.stderr.readline()
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=60) == 130


@pytest.mark.timeout(120)
def test_one_that_comes_in_the_garbage_collector_is_not_lost():
    """As in JAX, whose callback of the collector drops KeyboardInterrupt."""
    process = start("""
def collected(phase, info):
    if phase == "start":
        os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass

with ends_whole("saving") as interrupt:
    gc.callbacks.append(collected)
    gc.collect()
    gc.callbacks.clear()
    print("ready", flush=True)
    while not interrupt.is_pressed():
        time.sleep(0.01)
""")
    process.communicate(timeout=60)
    assert process.returncode == 0


@pytest.mark.timeout(120)
def test_a_child_is_left_to_its_parent():
    process = start("""
wait = [sys.executable, "-c", "print('here', flush=True); import time; time.sleep(0.5)"]
with left_to_the_parent():
    child = subprocess.Popen(wait, stdout=subprocess.PIPE)
child.stdout.readline()
child.send_signal(signal.SIGINT)
print("ready", flush=True)
print(child.wait())
""")
    out, _ = process.communicate(timeout=60)
    assert out == "0\n"


@pytest.mark.timeout(120)
def test_in_another_thread_nothing_is_changed():
    process = start("""
def work():
    with ends_whole("saving") as interrupt:
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert not interrupt.is_pressed()

thread = threading.Thread(target=work)
thread.start()
thread.join()
print("ready", flush=True)
""")
    assert process.wait(timeout=60) == 0
