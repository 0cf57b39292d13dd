"""An evaluation from settings to files, with a policy written by hand."""

import errno
import json
import os
import shlex
import shutil
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from dovetail.arms.local_arm import LocalArm
from dovetail.commands.command_line import parse
from dovetail.commands.evaluate import Evaluate
from dovetail.episode import Episode
from dovetail.errors import ArmError, ConfigError, DovetailError, LogError, PolicyError
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate, name_ground
from dovetail.evaluation.origin import command_line, shared_engine
from dovetail.learn.policy import Policy, find_policy
from dovetail.plants.twin import load_twin
from dovetail.robots.iiwa14 import iiwa14
from dovetail.settings import values_of
from dovetail.tasks.peg_in_hole.task import PegInHole

HEXAGON = {"peg": "hexagon"}


@pytest.fixture
def config(policy_file, tmp_path):
    return EvaluationConfig(
        policy=str(policy_file), twin="easy", tries=1, out=tmp_path / "out"
    )


@pytest.fixture(scope="module")
def finished(policy_file, tmp_path_factory):
    """One evaluation and what it printed."""
    out = tmp_path_factory.mktemp("evaluation") / "out"
    config = EvaluationConfig(policy=str(policy_file), twin="easy", tries=2, out=out)
    text = StringIO()
    return evaluate(config, Console(file=text, width=140)), text.getvalue()


def silent():
    return Console(file=StringIO())


def test_the_scripted_policy_inserts_on_a_twin(finished):
    evaluation, _ = finished
    assert evaluation.rows[-1].successes == evaluation.rows[-1].tries == 6
    assert evaluation.rows[-1].violations == 0


def test_every_file_is_there_and_named(finished):
    evaluation, _ = finished
    names = {path.name for path in evaluation.folder.iterdir()}
    assert names == {"paths.png", "forces.png", "report.json", "report.html", "logs"}
    assert names == {path.name for path in evaluation.files}


def test_the_table_is_printed_with_intervals_and_says_twin(finished):
    _, text = finished
    for word in ("twin easy (mujoco)", "Wilson 95 %", "6/6", "broken"):
        assert word in text
    assert "robot" not in text


def test_logs_load_and_agree_with_the_report(finished):
    evaluation, _ = finished
    tries = json.loads((evaluation.folder / "report.json").read_text())["tries"]
    for entry in tries:
        episode = Episode.load(evaluation.folder / "logs" / entry["log"])
        force = np.linalg.norm([episode[f] for f in ("fx", "fy", "fz")], axis=0)
        assert force.max() == pytest.approx(entry["force_peak"])
        assert episode["step"][-1] == entry["steps"] - 1


def test_report_names_seed_twin_and_machine(finished):
    evaluation, _ = finished
    content = json.loads((evaluation.folder / "report.json").read_text())
    assert content["config"]["twin file"]["engine"] == "mujoco"
    assert content["provenance"]["versions"]["mujoco"] == "3.17.0"
    assert content["policy"]["provenance"]["command"] == "written by hand"
    assert "--twin easy" in content["command"]


def test_two_workers_give_the_same_outcomes_as_one(config, finished):
    alone, _ = finished
    pair = evaluate(replace(config, tries=2, workers=2), silent())
    for one, two in zip(alone.outcomes, pair.outcomes, strict=True):
        assert one.numbers() == two.numbers()
        np.testing.assert_array_equal(one.course.path, two.course.path)


def test_tries_that_finished_before_the_disk_was_full_are_shown(config, monkeypatch):
    text, saved = StringIO(), []
    sync = os.fsync

    def fill_up(file):
        saved.append(file)
        if len(saved) == 4:
            raise OSError(errno.ENOSPC, "No space left on device")
        sync(file)

    monkeypatch.setattr(os, "fsync", fill_up)
    with pytest.raises(
        LogError, match=r"B_01\.npz.*free some space, then run it again"
    ):
        evaluate(replace(config, tries=2), Console(file=text, width=140))
    printed = text.getvalue()
    assert "(partial: 3 of 6 tries, no report)" in printed
    for cell in ("2/2", "1/1", "3/3"):
        assert cell in printed


def test_a_twin_in_the_engine_of_the_training_is_noted(config, finished, policy_file):
    evaluation, text = finished
    note = "training and this twin are both mujoco"
    assert note in text
    assert text.index(note) < text.index("Wilson")
    assert note in (evaluation.folder / "report.html").read_text()
    content = json.loads((evaluation.folder / "report.json").read_text())
    assert any(note in one for one in content["notes"])
    policy, cell = Policy.load(policy_file).metadata, PegInHole().workcell(iiwa14())
    assert "--plant bullet" in shared_engine(
        replace(config, twin=None, arm="twin:easy"), policy, cell
    )
    for other in (
        policy | {"env": policy["env"] | {"plant": "bullet"}},
        policy | {"provenance": {"config": {"arm": "twin:easy"}}},
    ):
        assert shared_engine(config, other, cell) == ""
    here = replace(config, twin=None, plant="mujoco")
    assert shared_engine(here, policy, cell) == ""


def test_where_bullet_cannot_build_a_part_another_engine_is_named(config, policy_file):
    policy = Policy.load(policy_file).metadata
    cell = PegInHole(peg="triangle").workcell(iiwa14())
    assert "--plant drake" in shared_engine(config, policy, cell)


def test_a_twin_file_of_the_users_own_works(config, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(replace(load_twin("easy"), torque_noise=0.5).to_toml())
    evaluation = evaluate(replace(config, twin=str(file)), silent())
    assert "twin mine (mujoco)" in evaluation.report.title


def test_an_ideal_plant_is_called_a_simulation(config):
    assert name_ground(replace(config, twin=None, plant="mujoco")) == (
        "simulation (mujoco)"
    )


CHANGES = [
    {"task_options": {"peg": "round", "clearance": 0.001}, "seed": 7},
    {"fixture_shift": 0.01, "search": "corner", "max_steps": 900},
    {"push": 30.0, "fixture_speed": 0.02, "start": "below"},
    {"tare": False, "fixture": (0.6, 0.0, 0.1, 0.2), "tries": 5},
    {"twin": None, "arm": "grpc://localhost:50051", "approach": True},
    {"twin": None, "plant": "bullet", "env": "dovetail/RailClip-v0", "robot": "fr3"},
    {"fixture_shift": 0.02, "accept_contact": True, "period": 0.0025},
    {"delay": 0.0125, "mass_error": 0.3, "payload_error": 1.5},
    {"fall_back": 0.0, "tracker": "late?bias=0.002", "video": True},
    {"grasp_error": 0.002, "grasp_turn": 0.04},
    {"cell": Path(__file__).parents[2] / "examples" / "cell.toml"},
]
NOT_TOLD = {"out", "workers", "keep_logs"}


def test_every_setting_is_changed_below():
    changed = set().union(*CHANGES) | NOT_TOLD | {"policy"}
    assert changed == set(values_of(EvaluationConfig(policy="peg_square")))


@pytest.mark.parametrize("change", CHANGES)
def test_the_printed_command_is_the_same_evaluation(config, change):
    asked = replace(config, **change)
    words = shlex.split(command_line(asked))[2:]
    read = parse(Evaluate, words)
    again = values_of(read)
    for name, value in values_of(asked).items():
        if name not in NOT_TOLD:
            assert again[name] == value, name


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"twin": None}, "either a plant or a twin.*mujoco, bullet.*easy"),
        ({"plant": "mujoco"}, "either a plant or a twin"),
        ({"twin": None, "plant": "gazebo"}, "gazebo.*mujoco, bullet"),
        ({"twin": "unreal"}, "unreal.*easy, hard, medium"),
        ({"twin": "missing.toml"}, "missing"),
        (
            {"task_options": {"peg": "hexagon"}},
            "hexagon.*square, triangle, round",
        ),
        ({"task_options": {"clearance": -0.001}}, "clearance"),
        ({"tries": 0}, "tries is 0"),
        ({"workers": 0}, "workers is 0"),
        ({"policy": "nobody"}, "no policy 'nobody'"),
    ],
)
def test_a_wrong_setting_is_named_with_what_is_known(config, change, words):
    with pytest.raises(DovetailError, match=words):
        evaluate(replace(config, **change), silent())


@pytest.mark.parametrize("change", [{"task_options": HEXAGON}, {"workers": 0}])
def test_a_wrong_setting_leaves_no_folder(config, change):
    with pytest.raises(DovetailError):
        evaluate(replace(config, **change), silent())
    assert not config.out.exists()


def test_a_folder_with_old_results_is_refused(config):
    config.out.mkdir()
    (config.out / "report.html").touch()
    with pytest.raises(ConfigError, match="not empty"):
        evaluate(config, silent())


def test_a_policy_cut_short_is_refused(config, policy_file, tmp_path):
    weights = tmp_path / "cut.safetensors"
    weights.write_bytes(policy_file.read_bytes()[:-40])
    sidecar = policy_file.with_suffix(".json").read_text()
    weights.with_suffix(".json").write_text(sidecar)
    with pytest.raises(PolicyError, match="cut"):
        evaluate(replace(config, policy=str(weights)), silent())


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("stack", 4, "observation"),
        ("task", "XYZ:force ABC:hold", "task|action"),
        ("arm", "fri://127.0.0.1:30299", "sets 'arm'.*not a policy's to choose"),
        ("theta_range", 0.4, "axis A means 0.4 at 1 here and 0.2"),
        ("wheels", 4, "sets 'wheels'.*not a policy's to choose.*known: task"),
    ],
)
def test_a_policy_of_another_task_or_size_is_refused(
    config, policy_file, tmp_path, key, value, words
):
    content = json.loads(policy_file.with_suffix(".json").read_text())
    content["env"][key] = value
    other = tmp_path / "other.safetensors"
    other.write_bytes(policy_file.read_bytes())
    other.with_suffix(".json").write_text(json.dumps(content))
    with pytest.raises(PolicyError, match=words):
        evaluate(replace(config, policy=str(other)), silent())


def test_why_the_arm_ended_a_try_is_said_and_kept(config, monkeypatch, tmp_path):
    def fail(*_):
        raise ArmError("the cable is out", "motion_ended")

    monkeypatch.setattr(LocalArm, "step", fail)
    asked = replace(config, tries=1, workers=1, tare=False)
    text = StringIO()
    found = evaluate(asked, Console(file=text, width=200))
    said = text.getvalue()
    assert "3 tries ended before their time: motion_ended (3)" in said
    assert "the first: the cable is out" in said
    report = json.loads((found.folder / "report.json").read_text())
    assert {row["stopped_text"] for row in report["tries"]} == {"the cable is out"}


def test_laxer_contact_is_said_before_the_tries_and_kept_with_them(
    config, policy_file, tmp_path
):
    policy = Policy.load(policy_file)
    env = policy.metadata["env"] | {"near_speed": 5.0}
    lax = Policy(policy.layers, policy.metadata | {"env": env}).save(tmp_path / "lax")
    text = StringIO()
    asked = replace(config, policy=str(lax), tries=1)
    evaluation = evaluate(asked, Console(file=text, width=200))
    note = "near_speed 5 m/s (default 0.02)"
    assert text.getvalue().count(note) == 1
    assert text.getvalue().index(note) < text.getvalue().index("tries")
    assert any(note in one for one in evaluation.report.notes)
    robot = {"arm": "fri://127.0.0.1:30299", "fixture": (0.6, 0.0, 0.1, 0.0)}
    with pytest.raises(ConfigError, match="say --accept-contact"):
        evaluate(replace(asked, twin=None, **robot), silent())
    command = command_line(replace(asked, accept_contact=True))
    assert parse(Evaluate, shlex.split(command)[2:]).accept_contact


def test_either_file_or_the_bare_name_finds_a_policy(policy_file):
    bare = policy_file.with_suffix("")
    for path in (policy_file, policy_file.with_suffix(".json"), bare):
        assert find_policy(str(path)) == policy_file


def test_the_folder_of_a_training_finds_its_policy(policy_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run, unfinished = tmp_path / "run", tmp_path / "peg_square"
    for folder in (run, unfinished):
        folder.mkdir()
    shutil.copy(policy_file, run / "policy.safetensors")
    assert find_policy("run") == Path("run/policy.safetensors")
    # A folder of a shipped policy's name is in nobody's way.
    assert find_policy("peg_square").parent != unfinished
    with pytest.raises(ConfigError, match=r"peg_square is a folder without policy\."):
        find_policy(str(unfinished))
