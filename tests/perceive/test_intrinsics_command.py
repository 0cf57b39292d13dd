"""`dovetail camera intrinsics` finds the lens of pictures, or says what is wrong."""

import re
import shutil

import numpy as np
import pytest

from dovetail.cli import run
from dovetail.envs.registered import find_cell
from dovetail.perceive.board import Board
from dovetail.perceive.camera import Lens, load_camera
from dovetail.perceive.opencv import opencv
from dovetail.perceive.simulated import Simulated
from dovetail.poses import Pose, compose, quat_from_vector, quat_multiply

from .scene import PLACE, beside

LENS = Lens(
    width=640, height=480, focal=(590.0, 600.0), centre=(328.0, 233.0),
    distortion=(-0.08, 0.04, 0.0, 0.0, 0.0),
)  # fmt: skip
ASIDE = np.array([-1.2, 0.0, 0.0, -1.0, 0.0, 0.5, 0.0])


@pytest.fixture(scope="module")
def taken(opengl, tmp_path_factory):
    """A folder with pictures of a board: tilted, and in every corner."""
    folder = tmp_path_factory.mktemp("pictures")
    board, rng = Board(side=0.12), np.random.default_rng(1)
    camera = beside(lens=LENS, board=board, at=(0.95, -0.25, 0.6))
    source = Simulated(camera, find_cell())
    facing = quat_from_vector(np.array([np.pi, 0.0, 0.0]))
    for number in range(16):
        x, y = 0.11 * rng.uniform(-1.0, 1.0), 0.07 * rng.uniform(-1.0, 1.0)
        turned = quat_from_vector(
            np.append(rng.uniform(-0.6, 0.6, 2), rng.uniform(-1, 1))
        )
        at = Pose(
            np.array([x, y, rng.uniform(0.28, 0.38)]), quat_multiply(turned, facing)
        )
        picture = source.still(ASIDE, PLACE, compose(camera.pose, at), number)
        opencv().imwrite(str(folder / f"{number:02d}.png"), picture)
    source.close()
    return folder


@pytest.fixture
def pictures(taken, tmp_path):
    return shutil.copytree(taken, tmp_path / "pictures")


def intrinsics(folder, out, *words):
    words = ["intrinsics", folder, "--out", out, "--side", "0.12", *words]
    return run(["camera", *map(str, words)])


def test_the_lens_is_found_and_nothing_is_overwritten(pictures, tmp_path, capsys):
    out = tmp_path / "lens.toml"
    opencv().imwrite(str(pictures / "dark.png"), np.zeros((480, 640), np.uint8))
    assert intrinsics(pictures, out) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "dark.png: no marker is in sight" in said
    assert "16 pictures, corners 0." in said
    assert "go: written to" in said
    camera = load_camera(out)
    found = np.array([*camera.lens.focal, *camera.lens.centre])
    gap = np.abs(found - [*LENS.focal, *LENS.centre])
    assert (gap < 4.0 * np.array(camera.lens.deviation) + 0.5).all()
    assert re.search(rf"focal lengths {found[0]:.1f} \+- \d", said)
    assert camera.source == "device:0"
    assert camera.made_by == "dovetail camera intrinsics"
    assert not camera.is_calibrated
    before = out.read_bytes()
    assert intrinsics(pictures, out) == 2
    assert "stays" in capsys.readouterr().err
    assert out.read_bytes() == before


def test_pictures_of_two_resolutions_are_refused(pictures, tmp_path, capsys):
    opencv().imwrite(str(pictures / "x.png"), np.zeros((240, 320), np.uint8))
    assert intrinsics(pictures, tmp_path / "lens.toml") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "x.png has 320 x 240 pixels, the first one 640 x 480" in said
    assert not (tmp_path / "lens.toml").exists()


def test_mirrored_pictures_and_another_board_are_named(pictures, tmp_path, capsys):
    for path in sorted(pictures.iterdir()):
        picture = opencv().imread(str(path), opencv().IMREAD_GRAYSCALE)
        opencv().imwrite(str(path), picture[:, ::-1])
    assert intrinsics(pictures, tmp_path / "lens.toml") == 2
    said = capsys.readouterr()
    assert "the picture is mirrored" in said.out
    assert "0 pictures show the board" in said.err


def test_another_board_is_named(taken, tmp_path, capsys):
    assert intrinsics(taken, tmp_path / "lens.toml", "--first-id", "8") == 2
    assert "another board is in sight" in " ".join(capsys.readouterr().out.split())
    assert not (tmp_path / "lens.toml").exists()
