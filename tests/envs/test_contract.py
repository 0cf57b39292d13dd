"""A task that breaks its contract fails when it is registered or made, by name."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from dovetail.arms.arm import ArmState, ToolState
from dovetail.envs.contract import TaskError
from dovetail.envs.registered import make_env, register_task
from dovetail.errors import ConfigError
from dovetail.poses import TOOL_DOWN, Pose, quat_about_z
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.task import Goal, Progress, Task
from dovetail.workcell.parts import Part, Primitive

from .fake_arm import FakeArm

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class Touch(Task):
    """Bring a pin to the top of a block."""

    axes: str = "XYZ:force A:pose BC:hold"
    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("middle", 0.6, 0.0, 0.1, 0.0),
    )

    def held(self):
        size, middle = (0.005, 0.03), np.array([0.0, 0.0, -0.03])
        return Part("pin", (Primitive("pin", "cylinder", size, middle, mass=0.05),))

    def fixture(self, widened):
        size, middle = (0.04, 0.04, 0.05), np.array([0.0, 0.0, -0.05])
        return Part("block", (Primitive("block", "box", size, middle),))

    def draw_fixture(self, rng):
        return Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))

    def draw_start(self, rng, fixture):
        return Pose(fixture.position + 0.05 * UP, TOOL_DOWN)

    def goal(self, fixture):
        return Goal(fixture.position, TOOL_DOWN, UP, float(fixture.position[2]))

    def judge(self, error, goal, state):
        return Progress(-float(error[2]), bool(error[2] < 0.001))


def broken(base=Touch, **members):
    return dataclass(frozen=True, kw_only=True)(type("Broken", (base,), members))


def test_a_whole_task_is_made_and_registered():
    register_task("Touch-v0", Touch)
    env = make_env(Touch)
    env.reset(seed=0)
    env.close()


def without(name):
    members = {k: v for k, v in vars(Touch).items() if k != name}
    kept = ("held", "fixture", "draw_fixture", "draw_start", "goal", "judge")
    members = {k: members[k] for k in (*kept, "trial_poses") if k in members}
    return broken(Task, axes="XYZ:force ABC:hold", **members)


@pytest.mark.parametrize("name", ["judge", "goal", "draw_start", "trial_poses"])
def test_a_task_that_lacks_a_part_is_not_registered(name):
    lacking = without(name)
    with pytest.raises(TaskError) as error:
        register_task("Lacking-v0", lacking)
    assert (error.value.task, error.value.member) == ("Broken", name)
    with pytest.raises(TaskError):
        make_env(lacking)


@pytest.mark.parametrize("poses", [(), [], ((0.6, 0.0, 0.1),), "A"])
def test_trial_poses_are_fixture_poses(poses):
    with pytest.raises(TaskError) as error:
        make_env(broken(trial_poses=poses))
    assert error.value.member == "trial_poses"


@pytest.mark.parametrize(
    ("method", "told"),
    [
        ("judge", True),
        ("judge", None),
        ("judge", (0.01, 1)),
        ("judge", Progress(float("nan"), False)),
        ("judge", Progress("deep", False)),
        ("weigh", float("nan")),
        ("weigh", None),
        ("draw_fixture", np.array([0.6, 0.0, 0.1])),
        ("draw_start", Pose(np.array([0.6, 0.0, np.nan]), TOOL_DOWN)),
        ("goal", Pose(np.array([0.6, 0.0, 0.1]), TOOL_DOWN)),
        ("goal", Goal(np.zeros(3), TOOL_DOWN, UP, float("inf"))),
    ],
)
def test_what_a_method_must_not_return_is_told_when_it_is_made(method, told):
    with pytest.raises(TaskError) as error:
        make_env(broken(**{method: lambda *_: told}))
    assert error.value.member == method


def test_a_field_without_a_value_is_named():
    bare = type("Bare", (Touch,), {"__annotations__": {"width": float}})
    with pytest.raises(TaskError) as error:
        make_env(dataclass(frozen=True, kw_only=True)(bare))
    assert error.value.member == "width"


@pytest.mark.parametrize("method", ["judge", "weigh"])
def test_a_number_that_is_none_ends_a_step_and_stops_the_arm(method):
    told = [Progress(0.01, False) if method == "judge" else -1.0]
    env = make_env(broken(**{method: lambda *_: told[0]}), FakeArm())
    env.reset(seed=0)
    env.step(np.zeros(4, dtype=np.float32))
    told[0] = Progress(np.nan, False) if method == "judge" else np.nan
    with pytest.raises(TaskError) as error:
        env.step(np.zeros(4, dtype=np.float32))
    assert error.value.member == method
    assert env.arm.is_stopped


def test_what_is_no_task_is_refused():
    with pytest.raises(ConfigError, match="inherit Task"):
        register_task("Nothing-v0", dict)


def test_the_page_says_of_each_field_of_the_state_what_it_holds():
    page = Path(__file__).parents[2] / "docs" / "your-own-task.md"
    table = [line for line in page.read_text().splitlines() if line.startswith("| `")]
    told = " ".join(line.split(" | ")[0] for line in table)
    fields = {name for name in ArmState._fields if name != "tool"}
    for name in fields | {f"tool.{name}" for name in ToolState._fields}:
        assert f"`{name}`" in told, name
