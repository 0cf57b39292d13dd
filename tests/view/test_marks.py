"""Pictures and films show where the fixture is believed, and the way of the tool."""

from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image

from dovetail.cli import run
from dovetail.envs.registered import find_cell
from dovetail.poses import Pose, quat_about_z, quat_multiply, tool_down
from dovetail.trackers.covered import Covered
from dovetail.trackers.truth import Truth
from dovetail.view.film import Film
from dovetail.view.marks import BELIEVED_COLOUR, PATH_COLOUR, is_elsewhere
from dovetail.view.renderer import Renderer
from dovetail.workcell.parts import Part, Primitive

CELL = find_cell()
ROBOT = CELL.loaded_robot()
PLACE = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
ABOVE = ROBOT.inverse_kinematics(
    Pose(PLACE.position + np.array([0.0, 0.0, 0.1]), tool_down(0.0)),
    ROBOT.posture("down"),
)
ID = "dovetail/PegInHole-v0"
DOWN = np.array([0.0, 0.0, -1.0, 0.0], dtype=np.float32)


def moved(x=0.0, y=0.0, turn=0.0):
    """Return another pose of the fixture: beside PLACE [m] and turned [rad]."""
    return Pose(PLACE.position + np.array([x, y, 0.0]), quat_about_z(turn))


def count(picture, colour, within=40):
    """How many pixels have a colour, each of red, green and blue within so much."""
    away = np.abs(picture.astype(int) - np.array(colour))
    return int((away <= within).all(axis=2).sum())


def differs(picture, other):
    return (np.abs(picture.astype(int) - other) > 8).any(axis=2)


@pytest.mark.parametrize(
    "believed",
    [moved(0.005), moved(0.0, -0.005), moved(turn=0.05), moved(0.02, 0.02, 0.3)],
)
def test_a_fixture_that_is_believed_elsewhere_is_drawn_there_too(renderer, believed):
    plain = renderer.draw(ABOVE, PLACE)
    picture = renderer.draw(ABOVE, PLACE, believed=believed)
    assert count(plain, BELIEVED_COLOUR) == 0
    assert count(picture, BELIEVED_COLOUR) > 80
    # What is behind it is seen through it: few of its pixels are another colour.
    changed = differs(picture, plain)
    far = np.abs(picture.astype(int) - plain).max(axis=2) > 90
    assert far.sum() < 0.3 * changed.sum()
    np.testing.assert_array_equal(renderer.draw(ABOVE, PLACE), plain)


@pytest.mark.parametrize("believed", [moved(0.005), moved(0.0, -0.005)])
def test_faces_in_one_plane_do_not_flicker(renderer, believed):
    """The top of the believed fixture lies in that of the true one: all is tinted."""
    plain = renderer.draw(ABOVE, PLACE)
    fixture = differs(plain, renderer.draw(ABOVE, moved(-5.0)))
    tinted = differs(renderer.draw(ABOVE, PLACE, believed=believed), plain)
    assert (tinted & fixture).sum() > 0.9 * fixture.sum()


@pytest.mark.parametrize(
    "believed", [PLACE, moved(1e-4), moved(turn=0.002), Pose(PLACE[0], -PLACE[1])]
)
def test_of_what_is_believed_rightly_nothing_is_drawn(renderer, believed):
    assert not is_elsewhere(believed, PLACE)
    plain = renderer.draw(ABOVE, PLACE)
    picture = renderer.draw(ABOVE, PLACE, believed=believed)
    np.testing.assert_array_equal(picture, plain)


def prism(widened_by):
    """A three-sided fixture, which is a mesh, lying on its side."""
    quat = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
    shape = Primitive("prism", "prism", (0.05, 0.04), np.array([0.02, 0, 0]), quat)
    return Part("prism", (shape,))


@pytest.mark.parametrize(
    "cell",
    [CELL, find_cell("dovetail/RailClip-v0"), replace(CELL, make_fixture=prism)],
    ids=["hole", "rail", "mesh"],
)
def test_it_has_the_shape_and_the_place_of_the_fixture(cell):
    """Where it is drawn is where the fixture would be seen, but for the frame."""
    away, there = moved(-5.0), moved(0.05, 0.08, 0.4)
    with closing(Renderer(cell)) as renderer:
        empty = renderer.draw(ABOVE, away)
        fixture = differs(renderer.draw(ABOVE, there), empty)
        ghost = differs(renderer.draw(ABOVE, away, believed=there), empty)
    assert fixture.sum() > 500
    assert (ghost & fixture).sum() > 0.9 * fixture.sum()


def make_env(**options):
    return gym.make(ID, render_mode="rgb_array", disable_env_checker=True, **options)


def test_an_environment_shows_its_path_from_reset_on(renderer):
    with closing(make_env()) as env:
        env.reset(seed=0)
        begin = count(env.render(), PATH_COLOUR)
        for _ in range(40):
            env.step(DOWN)
        went = count(env.render(), PATH_COLOUR)
        env.reset(seed=0)
        assert begin == count(env.render(), PATH_COLOUR) == 0
    assert went > 40


@pytest.mark.parametrize("shift", [0.0, 0.01])
def test_an_environment_shows_what_its_tracker_believes(renderer, shift):
    tracker = Covered()
    tracker.shift = np.array([shift, 0.0, 0.0])
    with closing(make_env(tracker=tracker)) as env:
        env.reset(seed=0)
        env.step(DOWN)
        core, seen = env.unwrapped, count(env.render(), BELIEVED_COLOUR)
        away = core.fixture.position - core.believed.position
        np.testing.assert_allclose(away, tracker.shift, atol=1e-12)
    assert seen > 80 if shift else seen == 0


class Creeping(Truth):
    """Moves its estimate in place, as a camera that reuses its buffer does."""

    def reset(self, fixture, seed):
        super().reset(Pose(fixture.position.copy(), fixture.quat_wxyz), seed)

    def update(self, fixture, state):
        self._fixture.position[0] += 0.001


def test_what_was_believed_at_a_step_stays_what_it_was():
    """A film keeps the poses: one that changed in place would change all of it."""
    with closing(gym.make(ID, tracker=Creeping(), disable_env_checker=True)) as env:
        core, places = env.unwrapped, []
        env.reset(seed=0)
        for _ in range(3):
            env.step(np.zeros(4, dtype=np.float32))
            places.append(core.believed)
    first, *later = (float(place.position[0]) for place in places)
    np.testing.assert_allclose(later, [first + 0.001, first + 0.002], atol=1e-12)


@pytest.mark.parametrize("believed", [PLACE, moved(0.01)])
def test_a_film_shows_the_way_and_what_was_believed(renderer, tmp_path, believed):
    film, up = Film(), np.array([0.0, 0.0, 0.1])
    for step in range(20):
        way = np.array([-0.005 * step, 0.004 * step, 0.0])
        state = SimpleNamespace(
            q=ABOVE,
            tool=SimpleNamespace(position=PLACE.position + up + way),
            contact_force=np.zeros(3),
            parts=np.zeros(0),
        )
        film.add(state, PLACE, believed)
    with Image.open(film.write(tmp_path / "a.gif", renderer)) as shown:
        pictures = []
        for frame in (0, shown.n_frames - 1):
            shown.seek(frame)
            pictures.append(np.asarray(shown.convert("RGB")))
    ways = [count(picture, PATH_COLOUR) for picture in pictures]
    assert ways[0] == 0
    assert ways[1] > 60
    for picture in pictures:
        seen = count(picture, BELIEVED_COLOUR)
        assert seen > 80 if believed is not PLACE else seen == 0


def test_films_of_an_evaluation_show_both(renderer, tmp_path):
    out = tmp_path / "late"
    words = ["demo", "--tries", "1", "--tracker", "late?bias=0.005&turn=0.05"]
    assert run([*words, "--video", "--out", str(out)]) == 0
    for name in "ABC":
        with Image.open(out / f"{name}.gif") as film:
            film.seek(film.n_frames - 1)
            picture = np.asarray(film.convert("RGB"))
        assert count(picture, BELIEVED_COLOUR) > 60
        assert count(picture, PATH_COLOUR) > 20


def test_a_hair_is_a_fifth_of_a_millimetre_or_three_milliradians():
    assert is_elsewhere(moved(0.0003), PLACE)
    assert is_elsewhere(moved(turn=0.003), PLACE)
    tilted = quat_multiply(
        PLACE.quat_wxyz, np.array([np.cos(0.01), np.sin(0.01), 0, 0])
    )
    assert is_elsewhere(PLACE._replace(quat_wxyz=tilted), PLACE)
    assert not is_elsewhere(moved(np.nan), PLACE)
