"""The controller in closed loop with the exact plant, cycle by cycle."""

from dataclasses import dataclass

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec
from dovetail.robots.robot import Robot


@dataclass
class Run:
    """What happened: one row per cycle."""

    q: np.ndarray
    dq: np.ndarray
    a: np.ndarray
    a0: np.ndarray
    asked: np.ndarray  # without what pushes
    asked_x: np.ndarray
    ddx: np.ndarray
    position: np.ndarray
    speed: np.ndarray
    motor: np.ndarray
    disturbance: np.ndarray
    ddq: np.ndarray
    flags: list

    def bits(self, name: str) -> int:
        """All bits of a flag that were ever raised."""
        return int(np.bitwise_or.reduce([int(getattr(f, name)) for f in self.flags]))


@pytest.fixture(scope="session")
def run_loop(robot: Robot, q_home: np.ndarray):
    """Return a function that runs f*(q) for some cycles and gives a `Run`.

    `aim` are further fields of each Target.
    """
    chain = robot.chain()

    def run(
        limits: LimitConfig,
        f_star,
        task: str,
        *,
        cycles: int = 300,
        period: float = 1e-3,
        q=q_home,
        dq=None,
        push=(0.0, 0.0, 0.0),
        damping: float = 0.5,
        armature: float = 0.1,
        near_plane=None,
        aim=None,
    ) -> Run:
        controller = _core.Controller(  # tau_max may be below gravity elsewhere
            chain,
            OscConfig().params(),
            limits.params(),
            list(TaskSpec.parse(task).modes),
            period,
        )
        plant = _core.RigidPlant(
            chain, damping=np.full(7, damping), armature=np.full(7, armature)
        )
        plant.reset(q, np.zeros(7) if dq is None else dq)
        plant.set_external_force(np.array(push, dtype=float))
        pose = robot.tool_pose(q)
        controller.reset(q, pose.position, pose.quat_wxyz, dq=plant.read()[1])
        rows: dict[str, list] = {name: [] for name in Run.__dataclass_fields__}
        for _ in range(cycles):
            q, dq = plant.read()
            target = _core.Target(f_star=f_star(q), **(aim or {}))
            if near_plane is not None:
                target.near_plane = np.array(near_plane)
            result = controller.step(q, dq, target)
            q_mid = q + 0.5 * period * dq
            drift = chain.jacobian_dot_dq(q_mid, dq)
            M = chain.inertia_matrix(q_mid) + np.diag(limits.armature)
            asked = result.a - np.linalg.solve(M, controller.disturbance)
            rows["asked"].append(asked)
            rows["asked_x"].append((chain.jacobian(q_mid) @ asked + drift)[:3])
            rows["q"].append(q)
            rows["dq"].append(dq)
            rows["a"].append(result.a)
            rows["a0"].append(result.a0)
            rows["ddx"].append((chain.jacobian(q_mid) @ result.a + drift)[:3])
            rows["position"].append(chain.pose(q)[0])
            rows["speed"].append((chain.jacobian(q) @ dq)[:3])
            rows["motor"].append(result.tau + chain.gravity(q))
            rows["disturbance"].append(controller.disturbance)
            rows["flags"].append(result.flags)
            plant.apply(result.tau, period)
            rows["ddq"].append((plant.read()[1] - dq) / period)
        flags = rows.pop("flags")
        return Run(**{k: np.array(v) for k, v in rows.items()}, flags=flags)

    return run


@pytest.fixture(scope="session")
def rest_at(robot: Robot):
    """Return a function that gives a controller, an exact arm at rest, and its pose."""

    def begin(
        q: np.ndarray, osc: OscConfig, limits: LimitConfig, task: str, period: float
    ):
        controller = make_controller(robot, osc, limits, task, period)
        plant = _core.RigidPlant(
            robot.chain(),
            damping=limits.damping,
            armature=limits.armature,
        )
        plant.reset(q, np.zeros(7))
        start = robot.tool_pose(q)
        controller.reset(q, *start, dq=plant.read()[1])
        return controller, plant, start

    return begin
