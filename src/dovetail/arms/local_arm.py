"""Controller and plant in this process."""

from typing import Any

import numpy as np

from dovetail import _core
from dovetail.arms.arm import ArmFacts, ArmState, ArmTraits, ToolState
from dovetail.arms.disturbance import Disturbance
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec
from dovetail.errors import ConfigError
from dovetail.plants.plant import CYCLE_COLUMNS, Plant
from dovetail.poses import Pose
from dovetail.robots.robot import Robot
from dovetail.types import Array, Vec3, Vec7

_NOTHING = np.empty(0)
"""Joints of parts that have none."""


class LocalArm:
    """An arm made of the controller and a plant, both here."""

    def __init__(
        self,
        plant: Plant,
        robot: Robot,
        osc: OscConfig,
        limits: LimitConfig,
        task: TaskSpec | str,
        period: float,
        *,
        address: str = "",
    ) -> None:
        """Build the controller over the plant.

        Args:
            plant: Where the torques go; closed with the arm.
            robot: The controller's model, tool included.
            osc: Operational-space law.
            limits: Limits, made for the same robot and period.
            task: Mode of each axis.
            period: Control period [s].
            address: Where it is, as an address is written.
        """
        self.plant = plant
        task = TaskSpec.parse(task) if isinstance(task, str) else task
        self.facts = ArmFacts(
            robot=robot,
            osc=osc,
            limits=limits,
            task=task,
            period=period,
            address=address,
            traits=ArmTraits(
                is_simulated=True,
                is_real_time=False,
                places_fixture=True,
                measures_contact=True,
                holds_its_weight=plant.dynamics.is_compensated(robot),
            ),
        )
        self.controller = make_controller(robot, osc, limits, task, period)
        self._period = period
        self._chain = robot.chain()
        self._stamp = 0.0
        self._moves = bool(plant.cell.joints)
        self.disturbance = Disturbance()
        self._cycles: dict[float, int] = {}  # of each duration

    def reset(self, q: Vec7, fixture: Pose) -> ArmState:
        """Put the arm at rest at q [rad], the fixture there; latch what is held."""
        self.plant.reset(q, fixture)
        self.disturbance.clear()
        q_m, dq_m = self.plant.read()
        hold = self.facts.robot.tool_pose(np.asarray(q, dtype=float))
        self.controller.reset(q_m, hold.position, hold.quat_wxyz)
        self._stamp = 0.0
        log = np.empty((0, len(CYCLE_COLUMNS)))
        seen = _core.summarize(self._chain, q_m, dq_m, log)  # position to flags
        tool = ToolState(*seen[:3])
        parts = self.plant.part_positions() if self._moves else _NOTHING
        return ArmState(0.0, q_m, dq_m, tool, *seen[3:], log, parts)

    def step(self, target: _core.Target, duration: float = 0.05) -> ArmState:
        """Follow the target for a duration [s], a whole number of periods.

        Raises:
            ConfigError: The duration is not a whole number of periods.
            PlantError: The simulation diverged.
        """
        cycles = self._cycles.get(duration) or self.count_cycles(duration)
        if self.disturbance.is_active:
            log, q, dq = self._run_disturbed(target, cycles)
        else:
            controller, period = self.controller, self._period
            log, q, dq = self.plant.run_cycles(controller, target, cycles, period)
        self._stamp += duration
        seen = _core.summarize(self._chain, q, dq, log)  # position to flags
        tool = ToolState(*seen[:3])
        parts = self.plant.part_positions() if self._moves else _NOTHING
        return ArmState(self._stamp, q, dq, tool, *seen[3:], log, parts)

    def count_cycles(self, duration: float) -> int:
        """Return how many control periods a duration [s] has.

        Raises:
            ConfigError: Not a whole number.
        """
        cycles = round(duration / self._period)
        if cycles < 1 or abs(cycles * self._period - duration) > 1e-9:
            raise ConfigError(
                f"duration is {duration} s, which is not a whole number of control "
                f"periods of {self._period} s"
            )
        self._cycles[duration] = cycles  # it is nearly always the same
        return cycles

    def _run_disturbed(
        self, target: _core.Target, cycles: int
    ) -> tuple[Array, Vec7, Vec7]:
        """Run the cycles one by one, with what disturbs them in between."""
        rows = []
        held = _core.Target(target)
        q, dq = self.plant.read()
        for _ in range(cycles):
            self.disturbance.before_cycle(self.plant, self._period)
            row, q, dq = self.plant.run_cycles(self.controller, held, 1, self._period)
            held.age += self._period
            self.disturbance.after_cycle(self.plant)
            rows.append(row)
        return np.vstack(rows), q, dq

    def push(self, force: Vec3, duration: float) -> None:
        """Push the TCP from now on with a force [N], world axes, for a duration [s].

        The duration is rounded up to control periods; a later push replaces this one.
        """
        self.disturbance.push(force, duration, self._period)

    def move_fixture(self, fixture: Pose, velocity: Vec3) -> None:
        """Put the fixture at a pose; it then moves at a velocity [m/s], world axes.

        It moves in every control period, until the next call or `reset`.

        Raises:
            ConfigError: The fixture is out of reach.
        """
        self.plant.move_fixture(fixture)
        self.disturbance.slide(fixture, velocity)

    def grasp(self, offset: Pose) -> None:
        """Displace the held part in the fingers, from the next reset on.

        Args:
            offset: The part's frame in the TCP's. The controller does not know of it.
        """
        self.plant.grasp(offset)

    def stop(self) -> None:
        """Do nothing: between two steps nothing moves."""

    def clear(self) -> None:
        """Do nothing: a stop has left nothing behind."""

    def statistics(self) -> dict[str, Any]:
        """Return that there is nothing to tell."""
        return {"notes": []}

    def seed(self, seed: int) -> None:
        """Start the plant's noise again."""
        self.plant.seed(seed)

    def close(self) -> None:
        """Close the plant."""
        self.plant.close()
