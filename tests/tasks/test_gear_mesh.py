"""Gears that mesh: the play of their teeth, and what a wrong turn does."""

import math

import gymnasium as gym
import numpy as np
import pytest

import dovetail  # noqa: F401  (registers the environments)
from dovetail.errors import ConfigError
from dovetail.poses import quat_about_z
from dovetail.tasks.gear_mesh.geometry import (
    BACKLASH,
    DEPTH,
    DISTANCE,
    MODULE,
    PITCH,
    SUCCESS_DEPTH,
    TEETH,
    half_thickness,
    tooth_outline,
)
from dovetail.tasks.gear_mesh.task import GearMesh


def turned(points, angle):
    c, s = math.cos(angle), math.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def distance(points, outline):
    """Return the smallest distance of points from the edges of an outline [m]."""
    ends = np.roll(outline, -1, axis=0)
    along = ends - outline
    apart = points[:, None] - outline
    share = (apart * along).sum(-1) / (along**2).sum(-1)
    nearest = outline + share.clip(0.0, 1.0)[..., None] * along
    return float(np.linalg.norm(points[:, None] - nearest, axis=-1).min())


def gap(turn):
    """Return the smallest distance between teeth of gears in mesh [m], one turned."""
    tooth = tooth_outline()
    ends = np.roll(tooth, -1, axis=0)
    dense = np.vstack([tooth + t * (ends - tooth) for t in np.linspace(0, 1, 60)])
    found = []
    for i in (-1, 0, 1):
        for j in range(TEETH // 2 - 2, TEETH // 2 + 2):
            other = [DISTANCE, 0.0]
            ours, theirs = i * PITCH + turn, (j + 0.5) * PITCH
            found += [
                distance(turned(dense, ours), turned(tooth, theirs) + other),
                distance(turned(dense, theirs) + other, turned(tooth, ours)),
            ]
    return min(found)


def test_teeth_in_mesh_have_half_the_play_on_either_side():
    expected = 0.5 * BACKLASH * math.cos(math.radians(20.0))
    assert gap(0.0) == pytest.approx(expected, rel=0.03)
    aside = 0.25 * expected / (MODULE * TEETH / 2.0 * math.cos(math.radians(20.0)))
    assert gap(aside) == pytest.approx(0.75 * expected, rel=0.03)


def test_a_tooth_is_convex_and_takes_half_of_the_pitch():
    outline = tooth_outline()
    edges = np.roll(outline, -1, axis=0) - outline
    after = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
    assert (turns < 0.0).all() or (turns > 0.0).all()
    radius = MODULE * TEETH / 2.0
    width = 2.0 * radius * half_thickness(radius)
    assert width == pytest.approx((math.pi * MODULE - BACKLASH) / 2.0)


def press(turn):
    """Return depth and success when the gear is pushed onto the shaft, so turned."""
    env = gym.make("dovetail/GearMesh-v0")
    _, info = env.reset(seed=3)
    for _ in range(150):
        x, y, z = info["position_error"]
        is_over = math.hypot(x, y) < 0.0007 or z < DEPTH
        push = -0.3 if is_over or z > DEPTH + 0.01 else 0.3
        action = np.array([-40.0 * x, -40.0 * y, push, turn / 0.2]).clip(-1.0, 1.0)
        _, _, ended, cut, info = env.step(action.astype(np.float32))
        if ended or cut:
            break
    env.close()
    return info["depth"], info["success"]


def test_aligned_teeth_mesh_and_others_stand_on_each_other():
    depth, success = press(0.0)
    assert success
    assert depth >= SUCCESS_DEPTH
    depth, success = press(0.5 * PITCH)
    assert not success
    assert depth == pytest.approx(0.008, abs=0.001)


def test_a_bore_that_would_be_smaller_than_its_shaft_is_refused():
    with pytest.raises(ConfigError):
        GearMesh(clearance=0.0001).fixture(-0.0002)


def test_starts_are_turned_by_more_than_half_a_tooth():
    task, rng = GearMesh(), np.random.default_rng(0)
    fixture = task.draw_fixture(rng)._replace(quat_wxyz=quat_about_z(0.2))
    starts = [task.draw_start(rng, fixture) for _ in range(200)]
    turns = [2.0 * math.atan2(s.quat_wxyz[2], s.quat_wxyz[1]) - 0.2 for s in starts]
    assert 0.5 * PITCH < np.abs(turns).max() <= 0.2 + 1e-9
