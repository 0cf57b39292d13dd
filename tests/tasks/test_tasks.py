"""Tasks: they do not know of each other, and a stranger's is as good as ours."""

import ast
import json
import shutil
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from rich.console import Console

from dovetail.envs import registered
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import (
    UnknownSettingError,
    find_cell,
    make_env,
    make_task,
    task_class,
)
from dovetail.errors import ConfigError
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.learn.config import TrainConfig
from dovetail.learn.policy import Policy
from dovetail.learn.spaces import describe_spaces
from dovetail.settings import values_of
from dovetail.tasks.connector.geometry import SECTIONS
from dovetail.tasks.connector.task import Connector
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.rail_clip.task import ClipStarts, RailClip
from dovetail.workcell.parts import Part, Primitive
from facts import about
from test_imports import modules, names_in

ROOT = Path(__file__).parent.parent.parent
TASKS = ROOT / "src" / "dovetail" / "tasks"
RING = "ring_over_post:RingOverPost-v0"


@pytest.fixture
def ring(tmp_path, monkeypatch):
    """The docs' task as a stranger has it: a file in the folder where he works."""
    shutil.copy(
        ROOT / "examples" / "06_ring_over_post.py", tmp_path / "ring_over_post.py"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


def other_tasks(source, own):
    """Tasks that a file in the folder of one imports, be it for its types alone."""
    known, package = modules("src"), f"dovetail.tasks.{own}"
    others = {p.name for p in TASKS.iterdir() if p.is_dir()} - {own}
    for node in ast.walk(ast.parse(source)):
        for name in names_in(node, package, known):
            yield from others.intersection(name.split(".")[2:3])


@pytest.mark.parametrize("path", sorted(TASKS.glob("*/*.py")), ids=str)
def test_no_task_imports_another(path):
    assert [*other_tasks(path.read_text(), path.parent.name)] == []


@pytest.mark.parametrize(
    "line",
    [
        "from dovetail.tasks.rail_clip.task import RailClip",
        "from dovetail.tasks import rail_clip",
        "import dovetail.tasks.rail_clip.din_rail as clip",
        "from ..rail_clip import task",
        "from .. import rail_clip",
    ],
)
def test_an_import_of_another_task_is_seen_however_it_is_written(line):
    assert set(other_tasks(line, "peg_in_hole")) == {"rail_clip"}
    assert set(other_tasks(line, "rail_clip")) == set()


def test_nothing_but_its_folder_names_the_clip():
    """The example of a task that is one folder and no line elsewhere."""
    for path in (ROOT / "src" / "dovetail").rglob("*.py"):
        if "rail_clip" not in path.parts:
            assert "rail_clip" not in path.read_text(), path


def test_the_rail_clip_draws_from_its_ranges():
    still = ClipStarts(
        middle=(0.88, 0.01, 0.39), half_range=0.0, distance=(0.05, 0.05), aside=0.0
    )
    env = make_env(RailClip, randomisation=still)
    for seed in range(3):
        _, info = env.reset(seed=seed)
        np.testing.assert_array_equal(env.fixture.position, [0.88, 0.01, 0.39])
        assert info["depth"] == pytest.approx(-0.05, abs=1e-4)
    assert env.task.has_fixed_fixture()
    env.close()


@pytest.mark.parametrize("make", [gym.make, registered.make])
def test_an_environment_has_what_its_task_needs_beside_the_usual(make):
    env = make("dovetail/RailClip-v0")
    assert env.unwrapped.config.theta_range == RailClip.training["theta_range"]
    env.close()
    env = make("dovetail/RailClip-v0", theta_range=0.1)  # what is given goes before it
    assert env.unwrapped.config.theta_range == 0.1
    assert env.unwrapped.config.f_scale == RailClip.training["f_scale"]
    env.close()


def test_a_setting_that_nobody_takes_is_refused_with_those_that_are():
    with pytest.raises(ConfigError, match=r"RailClip got .* argument 'peg'"):
        gym.make("dovetail/RailClip-v0", peg="square")
    with pytest.raises(ConfigError, check=about("speed")):
        EnvConfig(speed=1.0)


def test_an_unknown_keyword_is_refused_in_the_words_of_python():
    """TorchRL's GymEnv tries frameskip, and goes on where a TypeError says that."""
    with pytest.raises(TypeError) as caught:
        gym.make("dovetail/PegInHole-v0", frameskip=1, twim="easy")
    assert isinstance(caught.value, UnknownSettingError)
    assert "unexpected keyword argument 'frameskip'" in str(caught.value)
    assert "'twim' (did you mean twin?)" in str(caught.value)


def test_settings_go_to_their_section_and_come_back_flat():
    config = EnvConfig(near_speed=0.05, twin="easy", f_scale=[1, 2, 3])
    assert (config.near_speed, config.twin) == (0.05, "easy")
    assert values_of(config)["f_scale"] == (1, 2, 3)
    assert EnvConfig(**values_of(config)) == config


def test_a_cell_weighs_what_it_holds_and_refuses_what_does_not_fit():
    cell = find_cell(clearance=0.0002)
    with pytest.raises(ConfigError, match=r"-0.3 mm makes the clearance of 0.2 mm neg"):
        cell.widened(-0.0003)
    assert cell.widened(0.0003).fixture.corners.shape == cell.fixture.corners.shape
    with pytest.raises(ConfigError, match=r"a box, has the size .* give 3 numbers"):
        Part("brick", (Primitive("brick", "box", (0.1, 0.1), np.zeros(3)),))


def test_a_strangers_task_is_found_by_its_module(ring):
    assert task_class(RING).__name__ == "RingOverPost"
    assert make_task(RING, {"clearance": 0.002}).clearance == 0.002
    options = TrainConfig(env=RING).env_options()
    assert options["task"] == "XYZ:force ABC:hold"
    assert options["clearance"] == 0.003
    with pytest.raises(ConfigError, match=r"RingOverPost got .* argument 'peg'"):
        TrainConfig(env=RING, task_options={"peg": "round"})
    with pytest.raises(ConfigError, match=r"Python finds no module 'no_such'"):
        task_class("no_such:Task-v0")


def test_a_strangers_policy_is_evaluated_where_its_module_is_named(ring, tmp_path):
    shape = [(14, 3)]
    layers = [(np.zeros(s, np.float32), np.zeros(s[1], np.float32)) for s in shape]
    network = {"layers": [list(s) for s in shape], "activation": "relu"}
    env = {"max_steps": 2, "plant": "mujoco", "tare": False}
    made = gym.make(RING)
    metadata = {"network": network | {"output": "tanh"}, "env_id": RING, "env": env}
    metadata |= describe_spaces(made)
    file = tmp_path / "own.safetensors"
    Policy(layers, metadata).save(file)
    config = EvaluationConfig(
        policy=str(file), plant="mujoco", tries=1, out=tmp_path / "out"
    )
    quiet = Console(file=(tmp_path / "console.txt").open("w"))
    with pytest.raises(ConfigError, match=f"add --env {RING} if you trust it"):
        evaluate(config, quiet)
    result = evaluate(replace(config, env=RING, period=0.005), quiet)
    assert len(result.outcomes) == 2
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert "RingOverPost" in report["title"]


def test_another_robot_is_one_function_away(tmp_path, monkeypatch):
    (tmp_path / "long_arm.py").write_text(
        "from dataclasses import replace\n"
        "import numpy as np\n"
        "from dovetail.robots.iiwa14 import iiwa14\n"
        "def long_arm():\n"
        "    arm = iiwa14()\n"
        "    origins = np.array(arm.geometry.origin_position)\n"
        "    origins[4, 1] += 0.05\n"
        "    geometry = replace(arm.geometry, origin_position=origins)\n"
        "    return replace(arm, name='long', geometry=geometry)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    env = gym.make("dovetail/PegInHole-v0", robot="long_arm:long_arm").unwrapped
    env.reset(seed=0)
    assert env.arm.facts.robot.name == "long"
    usual = make_env(PegInHole)
    usual.reset(seed=0)
    np.testing.assert_allclose(
        env.state.tool.position, usual.state.tool.position, atol=1e-4
    )
    assert np.abs(env.state.q - usual.state.q).max() > 0.02
    for one in (env, usual):
        one.close()


@pytest.mark.parametrize("kind", ["sfp", "sc"])
def test_a_connectors_outline_is_its_port(kind):
    task = Connector(connector=kind)
    outline = task.outline()
    np.testing.assert_array_equal(outline.opening[0], outline.opening[-1])
    sides = np.ptp(outline.opening, axis=0)
    np.testing.assert_allclose(sides, SECTIONS[kind].port)
    plug = task.held().corners
    assert (sides >= np.ptp(plug[:, :2], axis=0) + 2.0 * task.clearance - 1e-9).all()
    assert outline.depth == task.depths()[0]
