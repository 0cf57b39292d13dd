"""The doctor at an arm on periods that are not the usual one."""

import numpy as np
import pytest

from arms.loopback import lockstep_address
from dovetail.arms.address import parse_address
from dovetail.doctor.fri_arm import run_fri_checks
from dovetail.envs.registered import find_cell
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z, tool_down

HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
START = Pose(np.array([0.60, 0.0, 0.20]), tool_down(0.0))
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])


@pytest.mark.parametrize(("twin", "period"), [("medium", 0.001)])
def test_a_twin_passes_every_check(twin, period):
    plant = make_twin(load_twin(twin), find_cell())
    plant.reset(plant.robot.inverse_kinematics(START, Q_SEED), HOLE)
    with lockstep_address(plant, period=period) as address:
        found = list(run_fri_checks(parse_address(f"{address}&reset=move"), None))
    assert [c for c in found if c.status != "ok"] == []
    assert {c.name for c in found} >= {
        *("connection", "gravity, measured torque", "hold", "torques"),
        *("push, external torque", "messages", "delay", "cabinet's spring"),
    }
    assert f"{1e3 * period:g} ms x 1" in found[0].detail
