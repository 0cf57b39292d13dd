"""MUJOCO_GL names what is not there: what draws nothing goes on, a picture says so."""

import ctypes.util
import os
import subprocess
import sys

import pytest

from dovetail.plants.mujoco_plant import MujocoPlant

OSMESA = ctypes.util.find_library("OSMesa")


def run_demo(asked, out, *more):
    words = (*("demo", "--tries", "1", "--out", str(out)), *more)
    return subprocess.run(
        [sys.executable, "-m", "dovetail", *words],
        env={**os.environ, "MUJOCO_GL": asked},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


NOT_HERE = pytest.mark.skipif(OSMESA is not None, reason="OSMesa is here")


@pytest.mark.parametrize("asked", ["nonsense", pytest.param("osmesa", marks=NOT_HERE)])
def test_a_command_that_draws_nothing_goes_on(asked, tmp_path):
    done = run_demo(asked, tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")


@NOT_HERE
def test_a_video_names_what_there_is_not_in_one_line(tmp_path):
    done = run_demo("osmesa", tmp_path / "out", "--video")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "MUJOCO_GL is osmesa, and OSMesa is not here" in done.stderr
    assert "apt install libosmesa6" in done.stderr


def test_a_plant_that_could_not_be_built_goes_in_silence():
    MujocoPlant.__new__(MujocoPlant).__del__()
