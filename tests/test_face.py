"""What most programs need is imported from `dovetail`, and loaded when it is used."""

import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import dovetail

ROOT = Path(__file__).parents[1]
PROMISED = [
    "PegInHole",
    "Task",
    "register_task",
    "ContactEnv",
    "EnvConfig",
    "Controller",
    "Target",
    "OscConfig",
    "LimitConfig",
    "TaskSpec",
    "Robot",
    "iiwa14",
    "Workcell",
    "Part",
    "Tool",
    "Pose",
    "LocalArm",
    "FriArm",
    "RemoteArm",
    "ArmState",
    "Twin",
    "load_twin",
    "Policy",
    "train",
    "TrainConfig",
    "evaluate",
    "EvaluationConfig",
    "Episode",
]
HEAVY = ("mujoco", "jax", "torch", "stable_baselines3", "matplotlib", "cv2", "grpc")
OUTWARD = [
    ROOT / "README.md",
    *ROOT.glob("docs/*.md"),
    *ROOT.glob("examples/*.py"),
]


def names():
    return [name for name in dovetail.__all__ if name != "__version__"]


@pytest.mark.parametrize("name", names())
def test_each_name_is_there_and_says_what_it_is(name):
    value = getattr(dovetail, name)
    assert name in dir(dovetail)
    if inspect.isclass(value) or inspect.isroutine(value):
        assert (value.__doc__ or "").strip()
        assert value.__name__ == name


def test_the_promised_names_are_among_them():
    assert set(PROMISED) <= set(names())


def test_importing_loads_nothing_heavy():
    loaded = f"import sys, dovetail; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", loaded], capture_output=True, text=True, check=True
    )
    assert set(ast.literal_eval(done.stdout)) <= {"mujoco"}  # see mujoco_gl


@pytest.mark.parametrize("path", OUTWARD, ids=lambda path: path.name)
def test_examples_and_pages_import_from_dovetail_alone(path):
    inner = re.findall(r"^\s*(?:from|import) dovetail[._]\S*", path.read_text(), re.M)
    assert inner == []
    assert not re.search(r"\b_core\.", path.read_text())
