"""The golden vectors are what the readable controller gives; the C++ one, too."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from reference import ReferenceController

from dovetail import _core
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import find_cell

EXAMPLE = Path(__file__).parents[2] / "examples" / "07_golden_vectors.py"
GOLDEN = json.loads(EXAMPLE.with_name("golden.json").read_text())
CASES = GOLDEN["cases"]
TOLERANCE = 1e-8  # Nm


@pytest.mark.parametrize("case", CASES)
def test_the_readable_controller_gives_the_vectors(case):
    """From what the file says of the settings, and nothing else."""
    osc, limits = OscConfig(**GOLDEN["law"]), LimitConfig(**GOLDEN["limits"])
    robot, period = find_cell().loaded_robot(), GOLDEN["period"]
    controller = ReferenceController(robot, osc, limits, case["task"], period)
    given = {name: np.array(value) for name, value in case.items() if name != "task"}
    controller.reset(given["q"], given["position_hold"], given["quat_wxyz_hold"])
    target = _core.Target(given["f_star"], given["position_d"], given["quat_wxyz_d"])
    torque, *_ = controller.step(given["q"], given["dq"], target)
    np.testing.assert_allclose(torque, given["torque"], atol=TOLERANCE, rtol=0.0)


def test_the_file_has_the_model_that_it_was_made_with():
    robot = find_cell().loaded_robot().arrays()
    for name, value in GOLDEN["model"].items():
        np.testing.assert_allclose(robot[name], value, atol=1e-12)


def check(*words):
    command = [sys.executable, str(EXAMPLE), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1]


def test_one_command_checks_this_build_and_torques_from_elsewhere(tmp_path):
    assert check() == "the same to 1e-8 Nm"
    mine = tmp_path / "mine.json"
    torques = [case["torque"] for case in CASES]
    mine.write_text(json.dumps(torques))
    assert check("--check", str(mine)) == "the same to 1e-8 Nm"
    torques[5][3] += 1e-6  # Nm
    mine.write_text(json.dumps(torques))
    assert check("--check", str(mine)) == "not the same"
