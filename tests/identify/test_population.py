"""Populations: the same errors wherever they are evaluated, also when a worker dies."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from dovetail.errors import ConfigError, PlantError
from dovetail.identify.parameters import ParameterSet, nominal_model
from dovetail.identify.population import (
    Here,
    Processes,
    evaluate_population,
    make_population,
)
from dovetail.identify.recording import Recording
from extras import need


@pytest.fixture(scope="module")
def recording(folder):
    return Recording.load(folder)


@pytest.fixture(scope="module")
def models():
    values = np.linspace(-0.5, 0.5, 6)
    return [ParameterSet.parse("gravity_z").to_model(np.array([v])) for v in values]


@pytest.fixture(scope="module")
def expected(recording, models):
    return evaluate_population(models, Here(recording, "mujoco"))


@pytest.fixture
def processes(recording):
    population = Processes(recording, "mujoco", 2)
    yield population
    population.close()


def test_processes_give_the_same_errors_in_order(processes, models, expected):
    assert evaluate_population(models, processes) == expected
    assert len(set(expected)) == len(expected)


def test_the_evaluation_of_a_worker_that_died_is_done_again(
    processes, models, expected
):
    processes.errors(models[:1])
    os.kill(processes._workers[0].process.pid, signal.SIGKILL)
    assert evaluate_population(models, processes) == expected
    assert processes.deaths == 1


def test_workers_that_die_each_time_end_the_fit(recording, models, monkeypatch):
    monkeypatch.setattr("dovetail.identify.population._work", _die)
    population = Processes(recording, "mujoco", 1)
    with pytest.raises(PlantError, match="4 worker processes died at the same eval"):
        population.errors(models[:1])
    population.close()


def _die(*_):
    os._exit(1)


def test_what_is_wrong_in_a_worker_is_said_here(recording, models):
    population = Processes(recording, "gazebo", 1)
    with pytest.raises(ConfigError, match="known plants: mujoco, bullet"):
        population.errors(models[:1])
    population.close()


def test_workers_end_with_a_parent_that_was_killed(folder):
    """They would hold memory, and on a laptop the fan, for ever."""
    program = (
        "import sys, time; from dovetail.identify.recording import Recording\n"
        "from dovetail.identify.population import Processes\n"
        "if __name__ == '__main__':\n"
        "    p = Processes(Recording.load(sys.argv[1]), 'mujoco', 1)\n"
        "    print(p._workers[0].process.pid, flush=True)\n"
        "    time.sleep(60)\n"
    )
    words = [sys.executable, "-c", program, str(folder)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        parent.kill()
    end = time.monotonic() + 30.0
    while Path(f"/proc/{worker}").exists() and not _is_zombie(worker):
        assert time.monotonic() < end, "the worker outlives its parent"
        time.sleep(0.05)


def _is_zombie(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] == "Z"
    except FileNotFoundError:
        return True


def test_one_worker_stays_in_this_process(recording):
    assert isinstance(make_population(recording, "mujoco", 1), Here)


def test_a_cluster_gives_the_same_errors(recording, models, expected):
    need("ray")
    population = make_population(recording, "mujoco", 1, "local")
    try:
        assert evaluate_population(models, population) == expected
    finally:
        population.close()


def test_a_cluster_that_is_not_there_is_named(recording):
    need("ray")
    with pytest.raises(ConfigError, match=r"no Ray cluster answers at '127.0.0.1:1'"):
        make_population(recording, "mujoco", 1, "127.0.0.1:1")


def test_a_model_that_diverges_does_not_stop_the_others(recording, monkeypatch):
    here = Here(recording, "mujoco")
    errors = iter([None, np.zeros((5, 3))])
    monkeypatch.setattr(here._replay, "error", lambda _: next(errors))
    assert evaluate_population([nominal_model()] * 2, here) == [10.0, 0.0]
