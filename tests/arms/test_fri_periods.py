"""The whole road at every period of the wire: twin, cabinet, FRI, controller."""

import numpy as np
import pytest

from dovetail.control.config import LimitConfig, OscConfig
from dovetail.plants.twin import load_twin, make_twin

from .loopback import CabinetArm
from .test_fri_session import CELL, HOLE, START, TASK, push


@pytest.mark.parametrize("twin", ["easy", "medium", "hard"])
@pytest.mark.parametrize("period", [0.001, 0.002, 0.005])
def test_every_twin_is_driven_for_a_second_in_one_motion(twin, period):
    plant = make_twin(load_twin(twin), CELL)
    plant.reset(START, HOLE)
    osc = OscConfig.for_period(period, force_damping=[16.0] * 3 + [0.0] * 3)
    limits = LimitConfig.for_period(CELL.loaded_robot(), period, hardware=True)
    arm = CabinetArm(plant, osc, limits, TASK, period)
    try:
        arm.reset(START, HOLE)
        for i in range(20):
            state = arm.step(push(0.0, (1.0, -1.0)[i // 10]))
            assert (np.abs(state.dq) < plant.robot.limits.dq_max).all()
        assert state.stamp == pytest.approx(1.0)
        status = arm.ask("status")
        assert status["counts"].get("active_missed", 0) == 0
        assert status["counts"].get("stops", 0) == 0
    finally:
        arm.close()
