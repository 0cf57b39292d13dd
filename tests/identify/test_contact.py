"""Friction of contact: known where it was planted, and not told where it cannot be."""

import json
from dataclasses import replace

import numpy as np
import pytest

from dovetail.envs.config import EnvConfig
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.registered import make_task
from dovetail.episode import Episode
from dovetail.errors import ArmError, ConfigError, LogError
from dovetail.identify.contact_estimate import ContactEstimate, with_contact
from dovetail.identify.contact_friction import (
    contact_friction,
    friction_of,
    sliding_force,
)
from dovetail.identify.contact_log import (
    StripLog,
    contact_path,
    load_contact,
    save_strip,
)
from dovetail.identify.contact_motion import PRESSES, SPEED, START, Slide, play_strip
from dovetail.identify.excitation import EXCITED
from dovetail.identify.parameters import nominal_model
from dovetail.identify.plain_strip import Strip, plain_strips
from dovetail.identify.recorder import RecordConfig, record
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from dovetail.poses import Pose, quat_about_z, tool_down
from extras import need

X, Y, UP = np.eye(3)
PERIOD = 0.005
FACTS = {"robot": "arm", "task": "XYZ:force", "period": PERIOD}
LEVELS = np.array([0.0, 5.0, 10.0, 15.0, 20.0, 25.0])
"""Normal forces [N]."""


def slide(press, sign, along, force, speed=SPEED):
    """A way of 3 s at a constant speed, under a constant wrench's force [N]."""
    log = np.zeros((600, len(CYCLE_COLUMNS)))
    log[:, COLUMN["time"]] = PERIOD * np.arange(600)
    way = sign * speed * log[:, COLUMN["time"]]
    log[:, COLUMN["x"] : COLUMN["z"] + 1] = way[:, None] * along
    log[:, COLUMN["wrench_fx"] : COLUMN["wrench_fz"] + 1] = force
    return Slide(press, sign, log)


def strip_log(mu, along, joints=3.0, weight=(2.0, -1.0, 13.0)):
    """Slides of a part with friction mu, on an arm with friction and missed weight."""
    slides = [
        slide(
            press,
            sign,
            along,
            normal * UP - sign * (joints + mu * normal) * along + np.array(weight),
        )
        for press, normal in zip((0.0, *PRESSES), LEVELS, strict=True)
        for sign in (1, -1)
    ]
    return StripLog(along, UP, tuple(slides))


def points(mu, extra=0.0, strips=2):
    """T over N on strips whose joints have different friction."""
    return np.array(
        [np.stack([i + mu * LEVELS + extra, LEVELS + 10.0], 1) for i in range(strips)]
    )


@pytest.mark.parametrize("mu", [0.1, 0.45, 0.8])
def test_a_planted_friction_is_found_beside_joint_friction_and_missed_weight(mu):
    strips = strip_log(mu, X, joints=4.0), strip_log(mu, Y, joints=1.0)
    found = contact_friction(strips)
    assert found.value == pytest.approx(mu, abs=1e-9)
    assert found.half_width == pytest.approx(0.0, abs=1e-9)
    assert not found.reason


def test_what_joints_take_of_a_force_is_inside_the_interval():
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(200):
        extra = rng.normal(0.0, 0.5, len(LEVELS))  # the same on both strips
        found = friction_of(points(0.4, extra))
        inside += abs(found.value - 0.4) <= found.half_width
    assert inside > 180


def test_strips_that_disagree_widen_the_interval():
    both = points(0.4)
    both[1, :, 0] += 0.1 * both[1, :, 1]
    found = friction_of(both)
    assert found.value == pytest.approx(0.45)
    assert found.half_width > 0.05


def test_a_part_that_stuck_tells_nothing():
    stuck = points(0.4)
    stuck[0, 3:, :] = np.nan
    found = friction_of(stuck)
    assert found.value is None
    assert found.reason


@pytest.mark.parametrize("mu", [-0.2, 0.0, 7.0])
def test_a_friction_that_no_model_may_have_is_not_identified(mu):
    assert friction_of(points(mu)).reason


def test_a_wide_interval_is_not_identified_and_stays_out_of_the_model():
    extra = np.array([0.0, 3.0, -3.0, 3.0, -3.0, 3.0])
    found = friction_of(points(0.2, extra))
    assert found.value is not None
    assert found.reason
    model = nominal_model()
    assert with_contact(model, [found]) == model


def test_what_is_identified_is_the_models():
    known = ContactEstimate("contact_friction", "1", 0.5, 0.02)
    assert with_contact(nominal_model(), [known]).contact_friction == 0.5


def test_the_force_of_a_slide_is_its_mean_along_and_normal():
    force = sliding_force(slide(1.0, -1, Y, np.array([9.0, -2.0, 7.0])), Y, UP)
    assert force == pytest.approx([-2.0, 7.0])


@pytest.mark.parametrize("speed", [0.0, 0.2 * SPEED, -SPEED])
def test_what_does_not_go_its_way_has_no_sliding_force(speed):
    assert sliding_force(slide(1.0, 1, X, UP, speed), X, UP) is None


@pytest.fixture
def saved(tmp_path):
    """A folder with the slides on two strips."""
    for number, along in enumerate((X, Y)):
        strip = Strip(np.zeros(3), along, UP, 0.02, tool_down(0.0))
        slides = strip_log(0.3, along).slides
        # As an episode's, the times of one strip go on.
        for i, one in enumerate(slides):
            one.log[:, COLUMN["time"]] += i * 600 * PERIOD
        save_strip(contact_path(tmp_path, number), FACTS, strip, slides)
    return tmp_path


def test_slides_are_read_as_they_were_written(saved):
    strips = load_contact(saved, FACTS)
    assert [strip.along.tolist() for strip in strips] == [X.tolist(), Y.tolist()]
    for strip in strips:
        ways = [(one.press, one.sign) for one in strip.slides]
        assert ways == [(p, s) for p in (0.0, *PRESSES) for s in (1, -1)]
    assert contact_friction(strips).value == pytest.approx(0.3)


def test_a_recording_without_slides_has_none(tmp_path):
    assert load_contact(tmp_path, FACTS) == ()


def test_slides_that_are_not_whole_are_refused(saved):
    contact_path(saved, 1).unlink()
    with pytest.raises(LogError, match="contact-01"):
        load_contact(saved, FACTS)


@pytest.mark.parametrize(
    "wrong",
    [
        {"robot": "another"},
        {"along": [1.0, 1.0, 0.0]},
        {"normal": None},
        {"slides": []},
        {"slides": [[0.0, 2]] * 12},
        {"slides": [[0.0, 1]] * 20},
        {"slides": ["way"]},
    ],
)
def test_slides_of_a_damaged_file_are_refused(saved, wrong):
    path = contact_path(saved, 0)
    episode = Episode.load(path)
    episode.metadata |= wrong
    episode.save(path)
    with pytest.raises(LogError):
        load_contact(saved, FACTS)


PLACE = Pose(np.array([0.6, 0.0, 0.09]), quat_about_z(0.3))


@pytest.fixture
def env():
    task = replace(make_task("dovetail/PegInHole-v0", {}), axes=EXCITED)
    env = ContactEnv(task, None, EnvConfig(near_press=1e3))
    yield env
    env.close()


def test_the_part_stays_on_its_strip(env):
    strips = plain_strips(env.task, env.cell, PLACE)
    half = 0.015  # of the peg [m]
    for strip in strips:
        across = np.cross(strip.normal, strip.along)
        middle = strip.middle - PLACE.position
        assert abs(middle @ strip.normal) < 1e-12
        beside = abs(middle @ across)
        assert beside - half > half + env.task.clearance  # off the hole
        assert beside + half < 0.05  # on the block
        assert abs(middle @ strip.along) + strip.half + half < 0.05


def test_a_fixture_without_a_plain_surface_is_refused():
    task = make_task("dovetail/RailClip-v0", {})
    cell = ContactEnv(task, None, EnvConfig()).cell
    with pytest.raises(ConfigError, match="--contact"):
        plain_strips(task, cell, PLACE)


@pytest.mark.parametrize(
    "shapes",
    [
        [{"outline": "rectangle 140 40", "cutouts": ["square 20.8"], "z": [-20, 0]}],
        [
            {"outline": "square 60", "cutouts": ["square 20.8"], "z": [-20, 0]},
            {"outline": "square 120", "z": [-30, -20]},
        ],
    ],
    ids=["narrow block", "boss on a plate"],
)
def test_a_strip_that_ends_beside_the_fixture_is_refused(shapes):
    need("shapely")
    held = [{"outline": "square 20", "z": [-20, 60]}]
    part = {"units": "mm", "gap": 0.4}
    part |= {"held": {"shapes": held}, "fixture": {"shapes": shapes}}
    task = make_task("dovetail/Insert-v0", {"part": json.dumps(part)})
    cell = ContactEnv(task, None, EnvConfig()).cell
    with pytest.raises(ConfigError, match="--contact"):
        plain_strips(task, cell, PLACE)


@pytest.mark.parametrize("lower", [0.08, 0.015, -0.008])
def test_where_there_is_no_surface_the_arm_is_stopped(env, lower):
    strip, _ = plain_strips(env.task, env.cell, PLACE)
    strip = strip._replace(middle=strip.middle + lower * strip.normal)
    robot = env.arm.facts.robot
    over = Pose(strip.middle + START * strip.normal, strip.quat_wxyz)
    q = robot.inverse_kinematics(over, robot.posture("down"))

    def begin():
        return env.arm.reset(q, PLACE)

    with pytest.raises(ArmError) as caught:
        play_strip(begin, env.arm, strip)
    assert caught.value.reason == "no_surface"


def test_a_recording_of_a_twin_tells_its_friction(tmp_path, quiet):
    twin = replace(nominal_model(), contact_friction=0.5, coulomb=(0.5,) * 7)
    file = tmp_path / "twin.toml"
    file.write_text(twin.to_toml())
    out = tmp_path / "log"
    config = RecordConfig(
        arm=f"twin:{file}", out=out, sequences=1, steps=2, contact=True
    )
    recording = record(config, quiet)
    found = contact_friction(load_contact(out, recording.metadata))
    assert not found.reason
    assert found.value == pytest.approx(0.5, rel=0.1)
    assert abs(found.value - 0.5) <= found.half_width
