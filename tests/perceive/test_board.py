"""The print has the size that is said, and the markers that a detector looks for."""

import re

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.perceive.board import Board
from dovetail.perceive.opencv import opencv


@pytest.mark.parametrize(("first", "side"), [(0, 0.1), (579, 0.19), (8, 0.04)])
def test_a_detector_finds_the_corners_where_the_board_says(first, side):
    board = Board(first_id=first, side=side)
    picture = np.pad(board.picture(400), 20, constant_values=255)
    aruco = opencv().aruco
    found, ids, _ = aruco.ArucoDetector(board.dictionary).detectMarkers(picture)
    assert sorted(np.ravel(ids)) == list(board.ids)
    for name, corners in zip(np.ravel(ids), found, strict=True):
        expected = board.corners[name - first][:, :2] * [1.0, -1.0] + side / 2.0
        np.testing.assert_allclose(
            (corners[0] - 20.0) / 400 * side, expected, atol=0.006 * side
        )


def test_the_print_is_in_true_size():
    board = Board(side=0.12)
    svg = board.svg()
    assert 'width="120mm" height="120mm"' in svg
    assert svg.count("h3.4500v3.4500") == len(board.dark)
    pdf = board.pdf()
    box = re.search(rb"/MediaBox \[ *0 0 ([0-9.]+) ([0-9.]+)", pdf)
    points = [float(part) for part in box.groups()]
    np.testing.assert_allclose(points, [595.3, 841.9], atol=0.2)  # A4 [1/72 inch]


def test_markers_have_a_margin_of_a_cell_and_leave_the_opening_free():
    board = Board()
    reach = np.abs(board.corners[..., :2]).max(axis=2)
    assert board.side / 2.0 - reach.max() > board.cell
    assert reach.max(axis=1).min() > board.cut_out / 2.0
    inner = np.abs(board.corners[..., :2]).min(axis=(1, 2))
    assert np.all((inner > board.cut_out / 2.0) | (reach.max(axis=1) > board.pitch))


@pytest.mark.parametrize("settings", [{"side": 0.3}, {"first_id": 580}, {"side": "a"}])
def test_a_board_that_cannot_be_is_refused(settings):
    with pytest.raises(ConfigError, match="board"):
        Board(**settings)
