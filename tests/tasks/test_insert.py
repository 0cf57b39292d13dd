"""Inserting a part that a file describes; what its policy carries."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from dovetail.commands.command_line import find_task, parse
from dovetail.commands.train import Train
from dovetail.envs.log_facts import CELL, describe_cell
from dovetail.envs.registered import find_cell, make, make_task, task_of_file
from dovetail.errors import ConfigError, PolicyError
from dovetail.learn.config import TrainConfig
from dovetail.learn.policy_env import policy_settings
from dovetail.learn.spaces import describe_spaces, require_spaces
from dovetail.poses import Pose, matrix_from_quat
from dovetail.tasks.insert.task import HEXAGON, LENGTH_MAX, PAYLOAD_MAX, Insert
from dovetail.tasks.peg_in_hole.task import PegInHole
from extras import need

need("shapely")
EXAMPLES = Path(__file__).parent.parent.parent / "examples"
ENV = "dovetail/Insert-v0"
KEYED = str(EXAMPLES / "keyed_plug.toml")


def changed(**change):
    return json.dumps(json.loads(HEXAGON) | change)


def test_the_task_holds_the_files_content_and_not_its_path():
    task = Insert(part=KEYED)
    assert task.part.startswith("{")
    assert ".toml" not in task.part
    assert Insert(part=task.part).part == task.part
    assert task.gap() == pytest.approx(0.0004)
    assert task.depths() == pytest.approx((0.020, 0.018))
    assert task.describe()[0] == "keyed_plug"


@pytest.mark.parametrize("name", ["hexagon", "d_shaft", "keyed_plug"])
def test_what_is_held_stands_in_the_fixture_when_the_task_is_done(name):
    task = Insert(part=str(EXAMPLES / f"{name}.toml"))
    fixture = task.trial_poses[0].pose()
    goal = task.goal(fixture)
    R = matrix_from_quat(goal.quat_wxyz)
    held = task.held().corners @ R.T + goal.position
    T = matrix_from_quat(fixture.quat_wxyz)
    seen = (held - fixture.position) @ T
    depth, _ = task.depths()
    assert seen[:, 2].min() == pytest.approx(-depth)
    opening = task.outline().opening
    assert opening[:, 0].max() - seen[:, 0].max() == pytest.approx(task.gap(), abs=2e-4)
    # The key points the same way in the fixture and in the hand.
    assert seen[:, 1].max() == pytest.approx(opening[:, 1].max() - task.gap(), abs=2e-4)
    assert seen[:, 1].min() == pytest.approx(opening[:, 1].min() + task.gap(), abs=2e-4)


def test_starts_are_clear_of_the_fixture(rng):
    task = Insert(part=KEYED)
    cell = find_cell(ENV, part=KEYED)
    low = 0
    for _ in range(200):
        fixture = task.draw_fixture(rng)
        start = task.draw_start(rng, fixture)
        assert cell.is_free(start.position, fixture, 0.0)
        low += start.position[2] < fixture.position[2]
    assert low > 10


@pytest.mark.parametrize("shift", [0.0, 0.02])
def test_a_straight_push_goes_in_over_the_mouth_and_not_beside_it(shift):
    env = make(ENV, part=KEYED, max_steps=60)
    core = env.unwrapped

    def above(rng, fixture):
        goal = core.task.goal(fixture)
        beside = matrix_from_quat(fixture.quat_wxyz) @ [shift, 0.0, 0.02]
        return Pose(fixture.position + beside, goal.quat_wxyz)

    object.__setattr__(core.task, "draw_start", above)
    env.reset(seed=1)
    ended, info, forces = False, {}, []
    while not ended:
        *_, done, cut, info = env.step(np.array([0.0, 0.0, -0.5, 0.0]))
        ended = done or cut
        forces.append(info["contact_force_max"])
    env.close()
    assert info["success"] == (shift == 0.0)
    assert max(forces) < 100.0  # of the impact; the peg's is the same


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"density": 22000}, r"held part is .* kg; a WSG 50 holds 0 to 0\.4077 kg"),
        ({"outline": "hexagon 59", "density": 9000}, "kg; a WSG 50"),
        ({"length": 35}, "35 mm long; a WSG 50 holds 40 to 110 mm"),
        ({"outline": "rectangle 111 5", "density": 100}, "111 mm wide"),
        ({"length": 200}, "length is 0.2 m"),
        ({"gap": -0.3}, "gap is -0.0003 m"),
        ({"outline": "hexagon 20 mm"}, "without a unit"),
    ],
)
def test_a_part_that_cannot_be_held_or_inserted_is_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        Insert(part=changed(**change))


def pair(held, opening, z=-20, end=-20):
    fixture = [
        {"outline": "square 60", "cutouts": [opening], "z": [z, 0]},
        {"outline": "square 60", "z": [z - 5, z]},
    ]
    return json.dumps(
        {
            "units": "mm",
            "gap": 0.2,
            "held": {"shapes": [{"outline": held, "z": [end, end + 105]}]},
            "fixture": {"shapes": fixture},
        }
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (pair("hexagon 20", "hexagon 19"), "held_0_0' is 0.5.* mm inside .*fixture_0"),
        (pair("circle 20", "circle 19.9"), "mm inside the fixture's 'fixture_0"),
        (pair("hexagon 20", "hexagon 20.4", z=-19.9), "is 0.100 mm inside .*fixture_1"),
        (pair("hexagon 20", "hexagon 20.4", z=-111), "reaches 116 mm below"),
    ],
)
def test_parts_that_overlap_in_the_end_are_refused(text, words):
    with pytest.raises(ConfigError, match=words):
        Insert(part=text)


def test_parts_that_touch_in_the_end_are_fine():
    assert Insert(part=pair("hexagon 20", "hexagon 20")).gap() == 0.0002


@pytest.mark.parametrize(
    "options", [{}, {"tilt": 0.2}, {"facing": "robot"}], ids=["up", "tilted", "wall"]
)
def test_depth_is_paid_in_the_mouth_and_not_beside_the_fixture(options, rng):
    task = Insert(part=KEYED, **options)
    depth, done = task.depths()

    def paid(fixture, x, y, z):
        goal = task.goal(fixture)
        place = fixture.position + matrix_from_quat(fixture.quat_wxyz) @ [x, y, z]
        error = task.counted(place - goal.position, goal)
        return task.weigh(error, 0.0, False, 0.0)

    for _ in range(20):
        fixture = task.draw_fixture(rng)
        angle = rng.uniform(0.0, 2.0 * np.pi)
        aside = 0.03 * np.cos(angle), 0.03 * np.sin(angle)
        lower = (0.0, 0.3 * depth, depth, 2.0 * depth)
        levels = [paid(fixture, *aside, -z) for z in lower]
        assert np.ptp(levels) < 1e-12
        assert max(levels) < paid(fixture, 0.0, 0.0, 0.0)
        assert paid(fixture, *aside, 0.01) < levels[0]  # over it, height counts
        inside = [paid(fixture, 0.0005, 0.0, -z) for z in (0.0, 0.3 * depth, done)]
        assert inside == sorted(inside)
        assert inside[0] < inside[-1] - 0.5 * depth


def test_nothing_is_left_out_of_other_tasks_rewards(rng):
    task = PegInHole()
    goal, error = task.goal(task.draw_fixture(rng)), np.array([0.05, 0.0, -0.01])
    assert task.counted(error, goal) is error


def test_a_policy_of_one_depth_is_taken_for_another_where_it_sees_the_same():
    envs = [make(ENV, part=changed(depth=depth)) for depth in (20, 7)]
    cores = [env.unwrapped for env in envs]
    seen = []
    for core in cores:
        raw = np.zeros(len(core.scaling))
        goal = core.task.goal(core.task.trial_poses[0].pose())
        above = [0.001, -0.002, 0.003 + goal.depth()]  # the same place over the mouth
        raw[core.scaling.places["position"]] = above
        seen.append(core.scaling.scale(raw))
    require_spaces(describe_spaces(envs[0]), envs[1])
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-6)
    for env in envs:
        env.close()


@pytest.mark.parametrize("options", [{"tilt": 0.1}, {"facing": "robot"}])
def test_a_policy_of_one_depth_is_refused_where_its_zero_is_not_the_mouth(options):
    envs = [make(ENV, part=changed(depth=depth), **options) for depth in (20, 7)]
    with pytest.raises(PolicyError, match="zero is"):
        require_spaces(describe_spaces(envs[0]), envs[1])
    require_spaces(describe_spaces(envs[0]), envs[0])
    for env in envs:
        env.close()


def test_limits_of_the_gripper_are_those_of_its_data():
    assert pytest.approx(80.0 * 0.1 / 2.0 / 9.81) == PAYLOAD_MAX
    assert LENGTH_MAX == 0.110


def test_a_training_carries_the_part_and_a_policys_file_names_none():
    given = {"part": KEYED}
    config = TrainConfig(env=ENV, task_options=given)
    carried = config.policy_env()["part"]
    assert json.loads(carried)["outline"][4] == [3, 10]
    settings = policy_settings({"env_id": ENV, "env": {"part": carried}})
    assert make_task(ENV, settings | {"axes": None}).part == carried


@pytest.mark.parametrize(
    "part",
    [
        KEYED,
        "/dev/zero",
        "",
        3,
        '{"units": "mm"',
        '{"units": "mm", "outline": "hexagon 20", "depth": 1e999}',
        '{"held": "/etc/passwd", "units": "mm"}',
        "{" + " " * 1_000_001 + "}",
    ],
)
def test_a_strangers_policy_reads_no_file_and_is_not_believed(part):
    metadata = {"env_id": ENV, "env": {"part": part}}
    with pytest.raises((PolicyError, ConfigError)):
        make_task(ENV, policy_settings(metadata))


def test_part_on_a_command_line_chooses_the_task():
    words = ["--part", KEYED]
    assert find_task(words) is Insert
    assert find_task(["--env", "dovetail/PegInHole-v0"]) is PegInHole
    given = parse(Train, words)
    assert given.env == ENV
    assert json.loads(given.task_options["part"])["name"] == "keyed_plug"
    assert parse(Train, ["--env", ENV, f"--part={KEYED}"]).env == ENV


def test_parts_that_are_varied_choose_the_task_too():
    assert find_task(["--vary", f"part={KEYED}"]) is Insert
    assert find_task([f"--vary=tilt=0,0.1&part={KEYED}"]) is Insert
    assert find_task(["--vary", "peg=square,round"]) is PegInHole


def test_bullet_refuses_outlines():
    need("pybullet")
    from dovetail.plants.bullet_plant import BulletPlant

    with pytest.raises(ConfigError, match="1 mm margin"):
        BulletPlant(find_cell(ENV))


PAGE = EXAMPLES.parent / "docs" / "your-own-part.md"
BLOCKS = re.findall(r"```toml\n(.*?)```", PAGE.read_text(), re.S)


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_a_file_in_the_docs_is_built(block, tmp_path):
    (tmp_path / "part.toml").write_text(block)
    assert len(Insert(part=str(tmp_path / "part.toml")).fixture(0.0).primitives) > 1
    assert len(BLOCKS) == 2


def test_the_page_draws_every_piece_of_both_parts():
    import mujoco

    need("trimesh")
    from dovetail.cockpit.scene import triangles
    from dovetail.view.cell_model import cell_spec

    cell = find_cell(ENV, part=KEYED)
    model = cell_spec(cell).compile()
    areas = {}
    for shape in [*cell.held.primitives, *cell.fixture.primitives]:
        vertices, faces, _ = triangles(mujoco, model, model.geom(shape.name).id)
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        areas[shape.name] = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert min(areas.values()) > 1e-6
    # Two pieces make the plug's section; the seam between them counts twice.
    plug = areas["plug_0"] + areas["plug_1"] - 2 * 6 * 70e-6
    around, section = 2 * (24 + 14) + 2 * 3, 24 * 14 + 6 * 3
    assert plug == pytest.approx((around * 70 + 2 * section) * 1e-6, rel=1e-5)


def test_more_pieces_than_an_engine_can_bear_are_refused_before_they_are_built():
    ring = {"outline": "polygon 100 200", "cutouts": ["polygon 100 90"], "z": [-9, 0]}
    text = json.loads(pair("hexagon 20", "hexagon 20.4"))
    text["fixture"]["shapes"] = [ring] * 500
    with pytest.raises(ConfigError, match="more than 3000 convex pieces"):
        Insert(part=json.dumps(text))


def test_a_log_holds_the_part_and_a_strangers_log_reads_no_file():
    env = make(ENV, part=KEYED)
    facts = describe_cell(env)[CELL]
    env.close()
    again = task_of_file(facts["env_id"] or ENV, facts["task"])
    assert again.part == Insert(part=KEYED).part
    with pytest.raises(ConfigError, match="a path"):
        task_of_file(ENV, facts["task"] | {"part": KEYED})


def test_a_pair_of_boxes_and_cylinders_stands_in_bullet():
    need("pybullet")
    from dovetail.plants.bullet_plant import BulletPlant

    table = json.loads(pair("circle 20", "circle 20.4"))
    wall = {"outline": "rectangle 10 40", "z": [-20, 0]}
    table["fixture"]["shapes"] = [wall | {"at": [x, 0]} for x in (-15.2, 15.2)]
    plant = BulletPlant(find_cell(ENV, part=json.dumps(table)))
    fixture = Insert.trial_poses[0].pose()
    plant.reset(plant.robot.posture("down"), fixture)
    assert np.isfinite(plant.tool_pose().position).all()
    plant.close()


@pytest.mark.parametrize("options", [{}, {"tilt": 0.1}], ids=["level", "tilted"])
@pytest.mark.parametrize(
    ("depth", "raised"), [(20, 0.0), (30, 0.0), (40, 0.010), (60, 0.030)]
)
def test_a_deep_socket_stands_higher_wherever_it_is_placed(depth, raised, options, rng):
    text, usual = changed(depth=depth, length=100), Insert(**options)
    env = make(ENV, part=text, period=0.005, **options)
    core = env.unwrapped
    task, walls = core.task, find_cell(ENV, part=text).walls
    for pose, low in zip(task.trial_poses, usual.trial_poses, strict=True):
        assert pose.z - low.z == pytest.approx(raised)
        env.reset(seed=1, options={"fixture": pose.pose()})
    assert task.randomisation.middle[2] - 0.10 == pytest.approx(raised)
    assert task.trial_region.low[2] - 0.08 == pytest.approx(raised)
    for seed in range(20):
        env.reset(seed=seed)  # no fixture and no start is refused
        assert core.fixture.position[2] - depth / 1e3 > walls[0][2] + 0.015
    env.close()


def test_a_socket_that_is_too_deep_for_the_walls_is_refused():
    deep = Insert(part=changed(depth=60, floor=50, length=100))
    assert deep.trial_poses[0].z == pytest.approx(0.085 + 0.110 + 0.005 - 0.08)
    for floor, end, most in ((-111, -20, 0.115), (-75, -75, 0.070)):
        text = pair("hexagon 20", "hexagon 20.4", z=floor, end=end)
        with pytest.raises(ConfigError) as refused:
            Insert(part=text)
        assert refused.value.allowed[1] == pytest.approx(most)
