"""Stages as tasks of Ray, started on this machine."""

import sys

import pytest

from dovetail.errors import ConfigError, DovetailError, MissingDependencyError
from dovetail.reproduce import cluster
from dovetail.reproduce.schedule import run_stages
from dovetail.reproduce.stage import LOG, read_done, stage_folder
from extras import need


@pytest.mark.timeout(600)
def test_ray_runs_the_stages_and_names_the_one_that_failed(tmp_path, toys, notes):
    need("ray")
    a, b = toys("a", value=2), toys("b", needs=("a",), of=["a"], value=1)
    bad = toys("bad", "refuse")
    try:
        executor = cluster.RayExecutor("local", workers=2)
    except DovetailError as error:
        if cluster.NOT_STARTED not in str(error):
            raise
        pytest.skip(  # ray-project/ray#65983: 15 s, hard-coded
            "Ray gives its agents 15 s, too few while this machine was busy: run "
            f"`pytest tests/reproduce/test_cluster.py` alone on an idle one ({error})"
        )
    try:
        tally = run_stages(tmp_path, [a, b, bad], executor, notes)
    finally:
        executor.close()
    assert executor.slots == 2
    assert read_done(tmp_path, b)["result"] == {"sum": 3}
    assert tally.failed == {"bad": "the toy is broken; take another"}
    assert (stage_folder(tmp_path, "bad") / LOG).exists()


def test_a_machine_that_does_not_see_the_results_folder_says_so(tmp_path):
    assert cluster.run_task(str(tmp_path), "a") == cluster.NOT_SHARED


@pytest.mark.parametrize("address", ["127.0.0.1:1", "ray://127.0.0.1:1", "nonsense"])
def test_an_address_without_a_cluster_is_refused_at_once(address):
    need("ray")
    with pytest.raises(ConfigError) as error:
        cluster.RayExecutor(address)
    assert f"no Ray cluster at {address!r} (" in str(error.value)
    assert "--cluster local" in str(error.value)


def test_a_ray_that_does_not_start_here_is_tried_twice_and_then_explained(monkeypatch):
    ray = need("ray")
    calls = []

    def init(address, **_):
        calls.append(address)
        raise Exception("The current node timed out during startup.\nmore")

    monkeypatch.setattr(ray, "init", init)
    with pytest.raises(DovetailError) as error:
        cluster.RayExecutor("local")
    assert calls == ["local", "local"]
    assert "Ray did not start on this machine (The current node" in str(error.value)
    assert "leave out --cluster" in str(error.value)


def test_without_ray_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingDependencyError, match="ray>="):
        cluster.RayExecutor("local")
