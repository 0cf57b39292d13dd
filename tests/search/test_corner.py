"""The corner search: it finds what nobody sees, and asks for what it needs."""

import json

import numpy as np
import pytest

from dovetail.envs import registered
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.evaluation.trials import plan_trials
from dovetail.search.corner import SEARCH_AXES, CornerSearch
from dovetail.search.corner_config import CornerSearchConfig
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.trackers.covered import Covered
from extras import need


def make(shift, **settings):
    """The environment of a search, its fixture moved by `shift` [m] unseen."""
    tracker = Covered()
    tracker.shift = np.array([*shift, 0.0])
    options = {
        "task": SEARCH_AXES,
        "near_speed": 0.05,
        "theta_range": 0.3,
        "max_steps": 300,
        "tracker": tracker,
    } | settings
    env = registered.make(options.pop("env", "dovetail/PegInHole-v0"), **options)
    return env, require_contact_env(env)


def search(env, core, seed=3):
    """Search once; return the last info and the phases gone through."""
    actor = CornerSearch(core)
    observation, info = env.reset(seed=seed)
    phases = []
    while True:
        observation, _, ended, cut, info = env.step(actor(observation))
        phases.append(actor.phase)
        if ended or cut:
            return info, phases


@pytest.mark.parametrize("peg", ["square", "triangle", "round"])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.012, -0.016)])
def test_it_finds_a_fixture_that_was_moved_unseen(peg, shift):
    info, phases = search(*make(shift, peg=peg))
    assert info["success"]
    assert phases[0] == "go over"
    assert phases[-1] == "push"
    assert ("slide" in phases) == any(shift)


@pytest.mark.parametrize("peg", ["square", "triangle"])
@pytest.mark.parametrize("seed", [1, 5])  # the one turned left, the other right
def test_it_finds_a_fixture_that_is_turned_too(peg, seed):
    where = "late?delay=0.05&bias=0.005&turn=0.05"
    made = make((0.0, 0.0), peg=peg, tracker=where, twin="medium", tare=True)
    info, _ = search(*made, seed)
    assert info["success"]


@pytest.mark.parametrize(
    ("attempt", "then"),
    [(0, "slide"), (2, "rock")],
    ids=["held 1.8 mm high", "held askew by more than the gap lets in"],
)
def test_it_plugs_in_a_connector_that_is_held_wrong(attempt, then):
    env = registered.make(
        "dovetail/Connector-v0",
        arm="twin:medium",
        tracker="late?bias=0.002&turn=0.02",
        tare=True,
        near_speed=0.05,
        theta_range=0.3,
        f_scale=6.0,
        max_steps=300,
    )
    core = require_contact_env(env)
    actor, job = CornerSearch(core), plan_trials(3, 4, 0)[4 + attempt]
    place = core.task.trial_poses[job.pose].pose()
    observation, info = env.reset(seed=job.seed, options={"fixture": place})
    phases, ended, cut = [], False, False
    while not (ended or cut):
        observation, _, ended, cut, info = env.step(actor(observation))
        phases.append(actor.phase)
    assert info["success"]
    assert then in phases


def test_where_the_arm_may_not_be_quick_it_does_not_push_instead():
    env, core = make((0.012, -0.016), near_speed=0.02, max_steps=400)
    actor = CornerSearch(core)
    observation, _ = env.reset(seed=3)
    level = []  # f* while the corner slides, of 4 m/s2
    ended = cut = False
    while not (ended or cut):
        action = actor(observation)
        if actor.phase == "slide":
            level.append(np.hypot(action[0], action[1]))
        observation, _, ended, cut, _ = env.step(action)
    assert ended
    assert np.median(level) < 0.5  # 0.02 m/s needs 0.2, friction the rest


@pytest.mark.parametrize("clearance", [0.00006, 0.004])
def test_the_clearance_is_not_what_it_searches_for(clearance):
    info, _ = search(*make((0.0, 0.005), clearance=clearance, twin="medium", tare=True))
    assert info["success"]


def test_it_does_not_look_at_where_the_fixture_is():
    _, core = make((0.02, 0.0))
    env, _ = make((0.02, 0.0))
    del env
    actions = []
    for shift in ((0.02, 0.0), (0.0, 0.02)):
        env, core = make((0.0, 0.0))
        core.tracker.shift = np.array([*shift, 0.0])
        actor = CornerSearch(core)
        # The same fixture as seen, another true one, and nothing touched yet.
        seen = core.task.draw_fixture(np.random.default_rng(0))
        true = seen._replace(position=seen.position + core.tracker.shift)
        start = np.array([0.0, 0.5, 0.0, -1.2, 0.0, 1.4, 0.0])
        env.reset(seed=1, options={"fixture": true, "start": start})
        steps = []
        for _ in range(5):
            action = actor(np.zeros(0))
            steps.append(action)
            env.step(action)
        actions.append(steps)
    np.testing.assert_allclose(actions[0], actions[1], atol=1e-6)


@pytest.mark.parametrize("facing", ["up", "robot"])
def test_it_goes_in_along_the_axis_of_a_tilted_hole_and_turns_about_it(facing):
    env, core = make((0.0, -0.01), facing=facing, tilt=0.2)
    info, _ = search(env, core, seed=0)
    assert core.task.goal(core.fixture).normal[2] < 0.99
    assert info["success"]


def test_it_goes_on_when_the_first_path_finds_nothing():
    env, core = make((0.0, 0.0), max_steps=400)
    actor = CornerSearch(core, CornerSearchConfig(drop=0.01, rings=(0.004,)))
    observation, _ = env.reset(seed=3)
    begun = 0
    for _ in range(400):
        before = actor.phase
        observation, _, ended, cut, _ = env.step(actor(observation))
        begun += (before, actor.phase) == ("slide", "go over")
        if ended or cut:
            break
    assert begun >= 1


def test_axes_that_do_not_tilt_are_refused_with_what_to_give():
    _, core = make((0.0, 0.0), task="XYZ:force A:pose BC:hold")
    with pytest.raises(ConfigError, match="add --task 'XYZ:force ABC:pose'"):
        CornerSearch(core)


@pytest.mark.parametrize(
    "wrong",
    [{"tilt": 0.6}, {"rings": ()}, {"rings": (0.2,)}, {"press": float("nan")}],
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        CornerSearchConfig(**wrong)


def test_what_is_pushed_off_the_fixture_goes_back_to_it():
    """It searched on beside the block, ever deeper."""
    env, core = make((0.0, 0.0), max_steps=200)
    actor = CornerSearch(core)
    observation, _ = env.reset(seed=3)
    success = ended = cut = is_pushed = False
    while not (ended or cut):
        if actor.phase in ("touch", "slide", "seat") and not is_pushed:
            is_pushed = True
            core.arm.push(np.array([40.0, 20.0, 20.0]), 0.6)
        observation, _, ended, cut, info = env.step(actor(observation))
        success = info["success"]
    assert is_pushed
    assert success


PIN = {"units": "mm", "outline": "circle 5", "depth": 8, "gap": 0.25, "length": 50}
PLUS = [[3, -1.2], [3, 1.2], [1.2, 1.2], [1.2, 3], [-1.2, 3], [-1.2, 1.2]]
PLUS += [[-x, -y] for x, y in PLUS]


def stepped(narrow, wide):
    """A shaft with a narrow end and its bore."""
    block = "square 50"
    bores = [
        {"outline": block, "cutouts": [f"circle {narrow + 0.6}"], "z": [-12, -5]},
        {"outline": block, "cutouts": [f"circle {wide + 0.6}"], "z": [-5, 0]},
    ]
    shaft = [
        {"outline": f"circle {narrow}", "z": [-12, -5]},
        {"outline": f"circle {wide}", "z": [-5, 35]},
    ]
    both = {"held": {"shapes": shaft}, "fixture": {"shapes": bores}}
    return {"units": "mm", "gap": 0.3, **both}


def insertion(table):
    """The environment of a part whose given pose is 2 mm and 20 mrad wrong."""
    env = registered.make(
        "dovetail/Insert-v0",
        part=json.dumps(table),
        task=SEARCH_AXES,
        near_speed=0.05,
        theta_range=0.3,
        max_steps=400,
        twin="medium",
        tracker="late?bias=0.002&turn=0.02",
    )
    return env, require_contact_env(env)


@pytest.mark.parametrize(
    "table",
    [PIN, PIN | {"outline": PLUS, "depth": 12, "gap": 0.4}, stepped(9, 18)],
    ids=["pin", "plus", "stepped"],
)
def test_it_inserts_any_part_that_a_file_describes(table):
    need("shapely")
    env, core = insertion(table)
    assert all(search(env, core, seed)[0]["success"] for seed in (1, 2))
    env.close()


LISTED = {
    "held": {"shapes": [{"outline": "square 20", "z": [-20, 60]}]},
    "fixture": {
        "shapes": [{"outline": "square 70", "cutouts": ["square 20.8"], "z": [-20, 0]}]
    },
}


@pytest.mark.parametrize("shift", [(0.009, 0.0), (-0.006, 0.0067)])
def test_a_part_of_listed_shapes_is_found_as_far_away_as_any(shift):
    need("shapely")
    table = {"units": "mm", "gap": 0.4} | LISTED
    made = make(shift, part=json.dumps(table), env="dovetail/Insert-v0")
    assert search(*made)[0]["success"]
    made[0].close()


@pytest.mark.parametrize(("radius", "share"), [(20, 1.0), (12, 1.0), (6, 0.5)])
def test_a_path_is_as_wide_as_the_opening_is_small(radius, share):
    need("shapely")
    rings = CornerSearchConfig().rings
    table = PIN | {"outline": f"circle {2 * radius - 0.5}", "length": 60}
    env, core = insertion(table | {"density": 1000})
    actor = CornerSearch(core)
    env.close()
    middle = actor._path[0]
    far = [np.hypot(*(point - middle)[:2]) for point in actor._path[1:]]
    closest = rings[0] if share == 1.0 else 0.5 * share * rings[0]
    assert min(far) == pytest.approx(closest, rel=0.01)
    assert max(far) == pytest.approx(share * rings[-1], rel=0.01)
    gaps = np.linalg.norm(np.diff(actor._path, axis=0), axis=1)
    assert np.median(gaps) <= share * 0.004 + 1e-9


def test_what_stops_at_a_step_inside_is_searched_for_there():
    need("shapely")
    env, core = insertion(stepped(9, 18))
    info, phases = search(env, core, 1)
    env.close()
    assert info["success"]
    assert "wind" in phases
    assert not core.task.outline().is_straight
    assert PegInHole().outline().is_straight


def insert(part, seed, **settings):
    """Search for a fixture [mm] whose believed pose is 2 mm and 20 mrad off."""
    need("shapely")
    options = {"task": SEARCH_AXES, "near_speed": 0.05, "theta_range": 0.3}
    options |= {"max_steps": 300, "tracker": "late?bias=0.002&turn=0.02"}
    options |= {"twin": "medium", "tare": True} | settings
    text = json.dumps({"units": "mm", "gap": 0.4} | part)
    env = registered.make("dovetail/Insert-v0", part=text, **options)
    return search(env, require_contact_env(env), seed)


PLATE = {"outline": "square 60", "z": [-23, -15]}


@pytest.mark.parametrize("word", ["circle", "square"])
@pytest.mark.parametrize("at", [[0, 0], [5, 0]], ids=["middle", "aside"])
def test_a_cap_goes_over_a_post(word, at):
    cap = {"outline": f"{word} 24", "cutouts": [f"{word} 12.8"], "z": [-15, 1]}
    stem = {"outline": "circle 16", "z": [1, 50]}
    post = {"outline": f"{word} 12", "z": [-15, 0], "at": at}
    held = {"shapes": [cap | {"at": at}, stem]}
    for seed in (1, 2):
        info, phases = insert(
            {"held": held, "fixture": {"shapes": [post, PLATE]}}, seed
        )
        assert info["success"]
        assert "slide" not in phases


def test_a_fork_that_no_corner_leads_is_put_down_upright():
    prongs = [
        {"outline": "rectangle 14 10", "at": [0, y], "z": [-14, 1]} for y in (-10, 10)
    ]
    stem = {"outline": "rectangle 14 30", "z": [1, 50]}
    bar = {"outline": "rectangle 40 9", "z": [-14, 0]}
    plate = PLATE | {"z": [-30, -22]}
    part = {"held": {"shapes": [*prongs, stem]}, "fixture": {"shapes": [bar, plate]}}
    info, phases = insert(part, 1, tracker="truth")
    assert info["success"]
    assert "slide" not in phases


def test_a_pocket_over_the_mouth_ends_at_a_step_too():
    _, core = make((0.0, 0.0))
    actor = CornerSearch(core)
    actor._opening.has_steps = True
    actor._surface, actor._part.end = 0.007, np.zeros(3)  # 7 mm below what it touched
    assert actor._is_at_step()
    actor._surface = 0.001
    assert not actor._is_at_step()


def test_what_is_under_a_plate_goes_out_before_it_goes_up():
    env, core = make((0.0, 0.0))
    env.reset(seed=3)
    actor = CornerSearch(core)
    actor._part.look(actor._led.on_part)
    actor._begin(actor._go_over)
    actor._part.corner = actor._part.end = np.array([0.02, 0.0, -0.01])
    for _ in range(13):
        actor._track.append(actor._part.end)
    actor._go_over()
    assert actor.phase == "go out"
    push, tilt = actor._go_out()
    assert tilt == 0.0
    assert push[0] > 0.0
    actor._steps = 100
    actor._go_out()
    assert actor.phase == "go over"


def around(x, y, wide, deep):
    """The corners of a rectangle about a place."""
    return [[x + i * wide / 2, y + j * deep / 2] for i, j in CORNERS]


CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
ROUND = {
    "held": [{"outline": "circle 4.8", "at": [x, 0], "z": [-15, 1]} for x in (-9, 9)],
    "fixture": [
        {"outline": "rectangle 18 30", "cutouts": ["circle 5.3"], "at": [x, 0]}
        for x in (-9, 9)
    ],
}
BLADES = ((0, 11, 4, 8), (-11, -11, 6, 4), (11, -11, 6, 4))
FLAT = {
    "held": [{"outline": around(*blade), "z": [-15, 1]} for blade in BLADES],
    "fixture": [
        {
            "outline": "square 50",
            "cutouts": [around(x, y, w + 0.5, d + 0.5) for x, y, w, d in BLADES],
        }
    ],
}


@pytest.mark.parametrize("pins", [ROUND, FLAT], ids=["round", "flat"])
def test_a_plug_with_several_pins_is_led_by_one_of_them(pins):
    """No corner of the outline around all pins falls in; each tilt met the plate."""
    need("shapely")
    held = [*pins["held"], {"outline": "rectangle 34 32", "z": [1, 30]}]
    plate = [shape | {"z": [-16, 0]} for shape in pins["fixture"]]
    both = {"held": {"shapes": held}, "fixture": {"shapes": plate}}
    env, core = insertion({"units": "mm", "gap": 0.25} | both)
    found = [search(env, core, seed) for seed in range(3)]
    env.close()
    assert core.task.outline().is_pin
    assert all(info["success"] for info, _ in found)
    assert any("seat" in phases for _, phases in found)


def around_a_tongue(top):
    """A shell around a socket's tongue, which ends at a height [mm]."""
    shell = {"outline": "rectangle 12 6", "cutouts": ["rectangle 11 4"], "z": [-12, 1]}
    mouth = ["rectangle 12.4 6.4"]
    fixture = [
        {"outline": "square 40", "cutouts": mouth, "z": [-12.5, 0]},
        {"outline": "square 40", "z": [-16, -12.5]},
        {"outline": "rectangle 10.4 3.4", "z": [-12.5, top]},
    ]
    roof = max(1, top + 1)
    held = [shell | {"z": [-12, roof]}, {"outline": "rectangle 20 12"}]
    held[1] |= {"z": [roof, 30 + roof]}
    both = {"held": {"shapes": held}, "fixture": {"shapes": fixture}}
    return {"units": "mm", "gap": 0.2} | both


def test_a_plug_around_a_tongue_slides_upright_over_its_socket():
    need("shapely")
    env, core = insertion(around_a_tongue(-1))
    found = [search(env, core, seed) for seed in range(5)]
    env.close()
    assert core.task.outline().is_divided
    assert sum(info["success"] for info, _ in found) >= 4
    assert any("wind" in phases for _, phases in found)


def test_a_spiral_begins_where_the_part_stands():
    """It hovered beside the place, and took the air for the surface."""
    need("shapely")
    env, core = insertion(around_a_tongue(-1))
    actor = CornerSearch(core)
    begun = []
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        actor.reset()
        ended = cut = False
        last = ""
        while not (ended or cut):
            action = actor(observation)
            if actor.phase == "wind" and last == "lower":
                begun.append(actor._part.end[2])
            last = actor.phase
            observation, _, ended, cut, _ = env.step(action)
    env.close()
    assert begun
    assert max(begun) < 0.001


def test_what_lands_on_a_tongue_above_the_mouth_goes_on():
    """It stayed there, lowered for ever: only next to the mouth was it a touch."""
    need("shapely")
    env, core = insertion(around_a_tongue(6))
    actor = CornerSearch(core)
    observation, _ = env.reset(seed=0)
    surfaces, ended, cut = {}, False, False
    while not (ended or cut):
        action = actor(observation)
        surfaces.setdefault(actor.phase, actor._surface)
        observation, _, ended, cut, _ = env.step(action)
    env.close()
    assert surfaces["wind"] > 0.005
    assert surfaces["go over"] < 0.001  # where it stood upright is no surface
