"""A policy holds the robot of a file: its notes are said, and its name is reported."""

import json
from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

from dovetail.envs.registered import make
from dovetail.errors import ConfigError
from dovetail.evaluation.compare import ComparisonConfig, compare
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.learn.policy import Policy
from dovetail.learn.spaces import describe_spaces
from dovetail.robots.fr3 import fr3
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot_text import write_robot_text

NOTES = ("told.urdf: the flange is link_7", "told.urdf: two meshes are not drawn")
TEXT = write_robot_text(replace(iiwa14(), name="told", notes=NOTES))
FR3 = write_robot_text(replace(fr3(), name="told"))


def of(policy_file, path, text, *, same_scaling=True):
    """Write the scripted policy as one that was trained with a file's robot."""
    told = Policy.load(policy_file)
    env = told.metadata["env"] | {"robot": text}
    metadata = told.metadata | {"env": env}
    metadata["provenance"] = {"command": f"dovetail train --robot '{text}'"}
    if not same_scaling:
        made = make(metadata["env_id"], **env)
        metadata |= describe_spaces(made)
        made.close()
    return str(Policy(told.layers, metadata).save(path))


@pytest.fixture
def policy(policy_file, tmp_path):
    return of(policy_file, tmp_path / "told", TEXT)


def once_on_a_line_each(text):
    lines = text.splitlines()
    return all(lines.count(f"note: {note}") == 1 for note in NOTES)


def test_notes_are_printed_once_before_the_tries(policy, tmp_path):
    text = StringIO()
    config = EvaluationConfig(policy=policy, twin="easy", tries=1, out=tmp_path / "out")
    found = evaluate(config, Console(file=text, width=200))
    assert once_on_a_line_each(text.getvalue())
    assert text.getvalue().index(NOTES[1]) < text.getvalue().index("tries")
    assert set(NOTES) < set(found.report.notes)
    assert "robot told" in found.report.title


def test_a_report_names_the_robot_and_leaves_its_numbers_to_the_policy(
    policy, tmp_path
):
    config = EvaluationConfig(policy=policy, twin="easy", tries=1, out=tmp_path / "out")
    evaluate(config, Console(file=StringIO()))
    for name in ("report.json", "report.html"):
        assert "origin_position" not in (tmp_path / "out" / name).read_text()
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["config"]["environment"]["robot"] == "told"
    assert report["policy"]["env"]["robot"] == "told"
    command = report["policy"]["provenance"]["command"]
    assert command == "dovetail train --robot 'FILE of told'"


def test_another_robot_than_the_trainings_is_noted(policy, tmp_path):
    config = EvaluationConfig(
        policy=policy, plant="mujoco", robot="iiwa14", tries=1, out=tmp_path / "out"
    )
    found = evaluate(config, Console(file=StringIO()))
    said = "the robot of the tries is iiwa14, that of the policy's training told"
    assert said in found.report.notes
    assert not set(NOTES) & set(found.report.notes)


def test_a_comparison_says_the_notes_once(policy, policy_file, tmp_path):
    other = of(policy_file, tmp_path / "other", TEXT)
    config = ComparisonConfig(
        policies=(policy, other), twin="easy", tries=1, out=tmp_path / "out"
    )
    text = StringIO()
    compare(config, Console(file=text, width=200))
    assert once_on_a_line_each(text.getvalue())


def test_two_robots_of_one_name_are_not_compared(policy, policy_file, tmp_path):
    other = of(policy_file, tmp_path / "other", FR3, same_scaling=False)
    config = ComparisonConfig(
        policies=(policy, other), twin="easy", tries=1, out=tmp_path / "out"
    )
    with pytest.raises(ConfigError) as refused:
        compare(config, Console(file=StringIO()))
    assert refused.value.name == "robot"
    assert not (tmp_path / "out").exists()
