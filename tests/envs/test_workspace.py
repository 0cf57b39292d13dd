import re
from dataclasses import replace

import numpy as np
import pytest

from dovetail.arms.address import parse_address
from dovetail.control.config import LimitConfig
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import build_arm
from dovetail.envs.registered import make_env
from dovetail.envs.workspace import require_columns, require_drawn
from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z
from dovetail.robots.fr3 import fr3
from dovetail.robots.iiwa14 import iiwa14
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.workcell.cell_config import CellConfig
from dovetail.workcell.workcell import WALLS


def test_a_floor_inside_the_margin_that_hardware_needs_is_refused_with_the_remedy():
    local = make_env(PegInHole)
    facts, (low, high) = local.arm.facts, WALLS
    limits = LimitConfig.for_period(
        facts.robot, 0.005, hardware=True, x_min=low, x_max=high
    )
    local.arm.facts = replace(facts, limits=limits)
    hole = Pose(np.array([0.56, 0.0, 0.075]), quat_about_z(0.0))
    with pytest.raises(ConfigError, match=r"z = 0.0450 m.*1 or 2 ms, or") as error:
        local.reset(seed=0, options={"fixture": hole})
    said = str(error.value).partition("margins=model in the address of")[2]
    for scheme in re.findall(r"\w+:(?:/+)?", said):  # it is a key of what it names
        assert parse_address(f"{scheme}127.0.0.1?margins=model").margins == "model"
    assert "fri://" in said
    limits = LimitConfig.for_period(facts.robot, 0.002, hardware=True)
    local.arm.facts = replace(facts, limits=limits)
    local.reset(seed=0, options={"fixture": hole})
    local.close()


def built(task, robot, facts=None):
    """Return the cell of a robot, and its simulated arm."""
    cell = task.workcell(robot, facts)
    return cell, build_arm("mujoco", cell, TaskSpec.parse(task.axes))


def short_iiwa():
    """An iiwa whose forearm is 160 mm shorter."""
    robot = iiwa14()
    origins = robot.geometry.origin_position.copy()
    origins[4:6] *= 0.6
    geometry = replace(robot.geometry, origin_position=origins)
    return replace(robot, name="short", geometry=geometry)


def test_an_arm_that_is_too_short_for_some_fixture_is_refused_before_a_training():
    """It was refused where one was drawn out of its reach, in the midst of it."""
    task = PegInHole()
    for robot in (iiwa14(), fr3(), short_iiwa()):  # the last: its fixtures are nearer
        require_drawn(task, *built(task, robot))
    far = CellConfig(
        fixture_low=(0.60, -0.10, 0.09),
        fixture_high=(0.66, 0.20, 0.11),
        fixture_yaw=(0.0, 0.1),
    )
    with pytest.raises(ConfigError, match=r"fixture_low to fixture_high.*too far"):
        built(task, short_iiwa(), far)


def test_an_arm_whose_wrist_does_not_turn_to_level_fixtures_is_refused_too():
    task, robot = PegInHole(facing="robot"), iiwa14()
    require_drawn(task, *built(task, robot))
    room = np.where(np.arange(7) == 5, 0.2, robot.limits.q_max)
    limits = replace(robot.limits, q_min=-room, q_max=room)
    stiff = replace(robot, name="stiff", limits=limits)
    with pytest.raises(ConfigError, match=r"at the limit of joint .*A6") as refused:
        require_drawn(task, *built(task, stiff))
    assert refused.value.value == "stiff"


def test_a_column_that_the_arm_does_not_measure_is_refused():
    arm = make_env(PegInHole).arm
    columns = PegInHole().columns
    require_columns(arm, [*columns, "force"])
    traits = replace(arm.facts.traits, measures_contact=False)
    arm.facts = replace(arm.facts, traits=traits)
    require_columns(arm, columns)
    with pytest.raises(ConfigError, match="'force'"):
        require_columns(arm, [*columns, "force"])
    require_columns(arm, [*columns, "wrench"])
    blind = replace(arm.facts.limits, estimate_rate=0.0)
    arm.facts = replace(arm.facts, limits=blind)
    with pytest.raises(ConfigError, match=r"'wrench'.*estimate_rate is 0 1/s"):
        require_columns(arm, [*columns, "wrench"])
    arm.close()
