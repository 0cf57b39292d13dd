"""Angles beside pictures: taken by a whole turn where that is meant, or refused."""

import numpy as np
import pytest
from PIL import Image

from dovetail.errors import ConfigError
from dovetail.perceive.recorded import COLUMNS, POSES, read_shots
from dovetail.robots.iiwa14 import iiwa14

ANGLES = np.array([
    [-0.4, 0.5, 0.1, -1.2, -0.02, 1.0, 2.0],
    [0.3, -0.6, -2.9, 1.1, 0.4, -1.9, -0.7],
])  # fmt: skip
WRAPPED = np.mod(ANGLES, 2.0 * np.pi)


def folder(path, angles):
    lines = [",".join(COLUMNS)]
    for number, q in enumerate(angles):
        Image.fromarray(np.zeros((8, 8), np.uint8)).save(path / f"{number}.png")
        lines.append(",".join([f"{number}.png", *map(repr, map(float, q))]))
    (path / POSES).write_text("\n".join(lines) + "\n")
    return path


def read(path, angles, robot=None):
    said = []
    shots = list(read_shots(folder(path, angles), robot or iiwa14(), said.append))
    return np.array([shot.q for shot in shots]), said


def test_angles_in_range_stay_as_they_are(tmp_path):
    found, said = read(tmp_path, ANGLES)
    assert (found == ANGLES).all()
    assert said == []


def test_angles_of_0_to_2_pi_are_taken_by_a_whole_turn_and_that_is_said(tmp_path):
    found, said = read(tmp_path, WRAPPED)
    assert found == pytest.approx(ANGLES)
    assert len(said) == 1
    changed = [name for name in COLUMNS[1:] if name in said[0]]
    assert changed == ["q1", "q2", "q3", "q4", "q5", "q6", "q7"]


def test_angles_of_minus_2_pi_to_0_are_taken_too(tmp_path):
    found, _ = read(tmp_path, WRAPPED - 2.0 * np.pi)
    assert found == pytest.approx(ANGLES)


def test_degrees_are_named_and_none_of_them_is_turned(tmp_path):
    with pytest.raises(ConfigError, match="degrees"):
        read(tmp_path, np.degrees(ANGLES))


def test_degrees_are_not_said_of_angles_within_a_turn(tmp_path):
    angles = ANGLES.copy()
    angles[1, 3] = 3.1  # beyond 2.09, and 2 pi less is below -2.09
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, angles)
    assert "these are degrees" not in str(caught.value)
    assert "line 3: q4 is 3.1 rad" in str(caught.value)


def test_more_than_a_turn_is_refused(tmp_path):
    angles = ANGLES.copy()
    angles[0, 0] += 4.0 * np.pi
    with pytest.raises(ConfigError, match="line 2: q1"):
        read(tmp_path, angles)
