import re
from dataclasses import replace

import numpy as np
import pytest

from dovetail.arms.address import parse_address
from dovetail.control.config import LimitConfig
from dovetail.envs.registered import make_env
from dovetail.envs.workspace import require_columns
from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z
from dovetail.tasks.peg_in_hole.task import PegInHole
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
