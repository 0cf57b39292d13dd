"""An arm without physics: the tool goes where it is told, at once."""

import numpy as np

from dovetail.arms.arm import ArmFacts, ArmState, ArmTraits, ToolState
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.poses import tool_down


class FakeArm:
    """`place(...)` says what the next state measures; Targets are recorded."""

    def __init__(self, task="XYZ:force A:pose BC:hold", period=0.005):
        cell = find_cell()
        robot = cell.loaded_robot()
        self.facts = ArmFacts(
            robot=robot,
            osc=OscConfig.for_period(period),
            limits=LimitConfig.for_period(
                robot, period, x_min=cell.walls[0], x_max=cell.walls[1]
            ),
            task=TaskSpec.parse(task),
            period=period,
            traits=ArmTraits(
                is_simulated=False,
                is_real_time=False,
                places_fixture=True,
                measures_contact=True,
                holds_its_weight=True,
            ),
        )
        self.targets = []
        self.closed = False
        self.place()

    def place(self, position=(0.6, 0.0, 0.2), yaw=0.0, velocity=(0, 0, 0), **extra):
        log = np.zeros((10, len(CYCLE_COLUMNS)))
        log[:, CYCLE_COLUMNS.index("x")] = position[0]
        log[:, CYCLE_COLUMNS.index("y")] = position[1]
        log[:, CYCLE_COLUMNS.index("z")] = position[2]
        self.state = ArmState(
            0.0,
            np.asarray(extra.get("q", np.full(7, 0.1)), dtype=float),
            np.zeros(7),
            ToolState(
                np.asarray(position, dtype=float),
                tool_down(yaw),
                np.array([*velocity, 0.0, 0.0, 0.0], dtype=float),
            ),
            np.asarray(extra.get("force", (0.0, 0.0, 0.0)), dtype=float),
            np.asarray(extra.get("wrench", np.zeros(6)), dtype=float),
            0,
            extra.get("log", log),
        )

    def reset(self, q, hole):
        self.start, self.hole = q, hole
        return self.state

    def step(self, target, duration=0.05):
        assert duration == 0.05
        self.targets.append(
            (
                np.array(target.f_star),
                np.array(target.position_d),
                np.array(target.quat_wxyz_d),
            )
        )
        return self.state

    def seed(self, seed):
        pass

    is_stopped = False

    def stop(self):
        self.is_stopped = True

    def close(self):
        self.closed = True
