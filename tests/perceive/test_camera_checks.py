"""What the doctor says of a camera: each fault alone, and a delay that is measured."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dovetail.arms.address import parse_address
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor.camera import (
    TASK,
    Watched,
    check_camera,
    check_exposure,
    check_rate,
    check_sharpness,
    run_camera_checks,
    watch_moving,
)
from dovetail.doctor.picture_delay import fit_delay
from dovetail.envs.arm_setup import build_arm
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.perceive.board import Board
from dovetail.perceive.camera import load_camera
from dovetail.perceive.edges import edge_width
from dovetail.perceive.opencv import opencv
from dovetail.perceive.rehearsal import board_of, viewpoint
from dovetail.perceive.simulated import Simulated
from dovetail.perceive.sources import Frame
from dovetail.plants.twin import load_twin

from .scene import beside
from .test_flange import EXAMPLE


def sines(t):
    return 0.006 * (np.sin(2.0 * np.pi * 1.1 * t) + np.sin(2.0 * np.pi * 1.9 * t))


@pytest.mark.parametrize("delay", [0.0, 0.0304, 0.05, 0.25, 0.39])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_planted_delay_is_found_as_surely_as_it_says(delay, noise):
    rng = np.random.default_rng(2)
    time = np.arange(-0.5, 1.2, 0.005)
    arrival = np.arange(0.05, 1.2, 1.0 / 30.0)
    turned = np.array([0.36, -0.48, 0.8])  # the camera's axes are its own
    seen = np.array([0.1, 0.0, 0.5]) + np.outer(sines(arrival - delay), turned)
    seen += noise * rng.normal(size=seen.shape)
    found = fit_delay(time, sines(time), arrival, seen)
    assert abs(found.delay - delay) < max(4.0 * found.deviation, 2e-4)
    assert found.deviation < 1e-3
    assert found.moved == pytest.approx(1.0, abs=0.02)


def test_what_does_not_move_with_the_arm_is_told():
    time, arrival = np.arange(-0.5, 1.2, 0.005), np.arange(0.05, 1.2, 1.0 / 30.0)
    seen = 1e-4 * np.random.default_rng(1).normal(size=(len(arrival), 3))
    assert fit_delay(time, sines(time), arrival, seen).moved < 0.1


@pytest.mark.parametrize("blur", [1.0, 1.6, 2.4])
def test_an_edge_is_as_wide_as_it_was_blurred(blur):
    picture = np.full((120, 120), 220, dtype=np.uint8)
    picture[40:80, 40:80] = 20
    corners = np.array([[[39.5, 39.5], [79.5, 39.5], [79.5, 79.5], [39.5, 79.5]]])
    blurred = opencv().GaussianBlur(picture, (0, 0), blur)
    width = edge_width(blurred, corners)
    assert width == pytest.approx(np.hypot(blur, 0.4), rel=0.15)
    assert (check_sharpness([width]).status == "ok") == (blur < 1.5)


@pytest.mark.parametrize(
    ("paper", "cut", "status", "advice"),
    [
        (40, 0.0, "broken", "more light"),
        (200, 0.0, "ok", ""),
        (200, 0.3, "broken", "too bright"),
    ],
)
def test_exposure_is_judged_by_the_paper(paper, cut, status, advice):
    picture = np.full((100, 100), paper, dtype=np.uint8)
    picture[:, : round(100 * cut)] = 255
    corners = np.array([[[0.0, 0.0], [99.0, 0.0], [99.0, 99.0], [0.0, 99.0]]])
    check = check_exposure(picture, corners)
    assert check.status == status
    assert advice in check.detail


@pytest.mark.parametrize(("rate", "status"), [(30.0, "ok"), (15.0, "broken")])
def test_the_rate_is_that_of_the_file_or_it_is_said(rate, status):
    check = check_rate(beside(), list(np.arange(20) / rate))
    assert check.status == status
    assert f"{rate:.1f} 1/s, the file says 30" in check.detail


CAMERA = beside(400, 300, 480.0)


@pytest.fixture(scope="module")
def watched(opengl):
    """What a camera of twin medium shows while the arm carries the board."""
    cell = find_cell()
    source = Simulated(CAMERA, cell, load_twin("medium").camera)
    task = TaskSpec.parse(TASK)
    arm = build_arm("twin:medium", cell, task, EnvConfig(period=0.005))
    q = viewpoint(CAMERA, cell, 0.04)
    yield watch_moving(arm, source, q, lambda q: board_of(CAMERA, cell, q))
    arm.close()
    source.close()


def by_name(camera, watched):
    return {check.name: check for check in check_camera(camera, watched)}


def test_the_delay_that_a_twin_declares_is_found(watched):
    found = by_name(CAMERA, watched)
    assert [check.status for check in found.values()] == ["ok"] * 7
    told = float(found["delay"].detail.split()[0])
    assert told == pytest.approx(50.0, abs=3.0)  # ms


@pytest.mark.parametrize("robot", ["iiwa14", "fr3"])
def test_a_camera_on_the_flange_is_not_moved_by_a_wall(opengl, robot):
    camera, cell = load_camera(EXAMPLE), find_cell(robot=robot)
    found = list(run_camera_checks(camera, None, cell, None, 0.005))
    assert found[-1].name == "delay"
    assert [check.status for check in found] == ["ok"] * 7


def test_a_file_that_is_wrong_about_its_camera_is_corrected(watched):
    found = by_name(replace(CAMERA, delay=0.02, rate=60.0), watched)
    assert found["rate"].status == found["delay"].status == "broken"
    assert re.search(r"write delay = 0\.0(4[89]|5[012])", found["delay"].detail)


def test_a_camera_that_shows_something_else_is_told_so(watched):
    found = by_name(beside(), watched)
    assert found["resolution"].status == "broken"
    assert "400 x 300 pixels, calibrated at 640 x 480" in found["resolution"].detail
    other = by_name(replace(CAMERA, board=Board(first_id=8)), watched)
    assert other["board"].status == "broken"
    assert "seen in 0 of" in other["board"].detail
    flipped = [f._replace(picture=f.picture[:, ::-1].copy()) for f in watched.frames]
    mirrored = by_name(CAMERA, replace(watched, frames=flipped[:5]))
    assert "the picture is mirrored" in mirrored["board"].detail
    assert by_name(CAMERA, Watched())["camera"].status == "broken"


@pytest.mark.parametrize(
    ("arm", "why"), [(None, "give --arm"), ("fri://127.0.0.1:30200", "was not moved")]
)
def test_without_an_arm_or_a_yes_the_delay_is_not_told(monkeypatch, arm, why):
    class Shown:
        def look(self, fixture, state):
            return Frame(np.zeros((480, 640), dtype=np.uint8), 0.05)

        def close(self):
            pass

    monkeypatch.setattr("dovetail.doctor.camera.open_source", lambda *_: Shown())
    camera = replace(beside(), source="device:0")
    address = None if arm is None else parse_address(arm)
    asked = []

    def refuse(question):
        asked.append(question)
        return False

    checks = list(run_camera_checks(camera, address, find_cell(), refuse, 0.005))
    assert len(asked) == (arm is not None)
    assert checks[0].name == "camera"
    assert checks[-1].name == "delay"
    assert checks[-1].status == "missing"
    assert why in checks[-1].detail


def test_a_recording_and_an_arm_elsewhere_are_refused():
    cell = find_cell()
    recording = replace(beside(), source="folder:shots")
    with pytest.raises(ConfigError, match="is a recording"):
        list(run_camera_checks(recording, None, cell, None, 0.005))
    address = parse_address("fri://127.0.0.1:30200")
    with pytest.raises(ConfigError, match="pictures of this camera are simulated"):
        list(run_camera_checks(beside(), address, cell, None, 0.005))
