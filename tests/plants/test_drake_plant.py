"""Behaviour of Drake's plant beyond what every engine must do alike."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.errors import MissingDependencyError
from dovetail.evaluation.config import EvaluationConfig
from dovetail.evaluation.evaluate import evaluate
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import load_twin
from extras import need
from plants.conftest import HOLE, Q_BENT, start_above


@pytest.fixture
def drake():
    need("pydrake")


def test_without_drake_its_plant_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pydrake.all", None)
    with pytest.raises(MissingDependencyError, match=re.escape("drake")):
        make_plant("drake", find_cell())


def test_another_control_period_goes_on_from_the_same_state(drake):
    """A plant of Drake has one physics step: 2.5 ms are three of another length."""
    one, other = (make_plant("drake", find_cell()) for _ in range(2))
    tau = np.array([0.5, -0.3, 0.2, 0.1, 0.1, -0.05, 0.02])
    for plant in (one, other):
        plant.reset(Q_BENT, HOLE)
    for _ in range(20):
        one.apply(tau, 0.005)
    for period in [0.005] * 10 + [0.0025] * 20:
        other.apply(tau, period)
    np.testing.assert_allclose(one.read()[0], other.read()[0], atol=2e-5)


def test_contact_is_as_stiff_as_its_time_says(drake):
    """A quarter of the time is 16 times the stiffness, on the same face."""
    depths = []
    for time in (0.02, 0.005):
        plant = make_plant(
            "drake", find_cell(), replace(DynamicsConfig(), contact_time=time)
        )
        q = start_above(plant.robot, x=0.635, z=0.1)
        plant.reset(q, HOLE)
        chain, start = plant.robot.chain(), plant.robot.tool_pose(q).position
        for _ in range(200):
            q, dq = plant.read()
            pose = plant.robot.tool_pose(q)
            held = 2000.0 * (start - pose.position) * [1.0, 1.0, 0.0]
            wrench = [held[0], held[1], -30.0, 0.0, 0.0, 0.0]
            plant.apply(chain.jacobian(q).T @ wrench - 5.0 * dq, 0.005)
        depths.append(0.1 - plant.tool_pose().position[2])
    assert 8.0 < depths[0] / depths[1] < 24.0


def test_a_shipped_policy_inserts_on_a_twin_in_drake(drake, tmp_path):
    file = tmp_path / "medium-in-drake.toml"
    file.write_text(replace(load_twin("medium"), engine="drake").to_toml())
    config = EvaluationConfig(
        policy="peg_square", twin=str(file), tries=1, out=tmp_path / "out"
    )
    total = evaluate(config).rows[-1]
    assert total.successes == total.tries == 3
    assert total.violations == 0
