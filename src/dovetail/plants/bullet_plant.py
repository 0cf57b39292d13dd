r"""A plant in PyBullet, the paper's simulator.

Bullet knows no rotor inertia, and its joint damping is explicit, which is unstable on
light links at long steps. So each physics step solves

.. math:: (M + A + h D)\,a = \tau - c - g - D \dot q

with our own chain, MuJoCo's implicit integrator to the letter, and asks Bullet for the
torque that gives this `a`. Contacts then act in Bullet's own solver; for them the rotor
inertia A is also part of each link's inertia about its joint's axis.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.errors import ConfigError, MissingDependencyError, PlantError
from dovetail.plants.cycle_loop import run_cycles
from dovetail.plants.plant import (
    DynamicsConfig,
    physics_steps,
    require_configuration,
)
from dovetail.poses import Pose, quat_from_matrix
from dovetail.robot import GRAVITY, Robot
from dovetail.scene import Primitive, SceneConfig
from dovetail.types import Array, Vec3, Vec7

if TYPE_CHECKING:
    from dovetail import _core

_JOINTS = list(range(7))
_DIVERGED = 200.0  # [rad/s]; the joints' limit is 2.4


def _import_pybullet() -> Any:
    try:
        import pybullet
    except ImportError as error:
        raise MissingDependencyError(
            "plant 'bullet' needs PyBullet, which is not installed: pip install "
            "'dovetail[bullet]' on Python 3.11; there is no wheel for later versions "
            "of Python, where plant 'mujoco' does the same"
        ) from error
    return pybullet


def _xyzw(quat_wxyz: Array) -> list[float]:
    w, x, y, z = (float(v) for v in quat_wxyz)
    return [x, y, z, w]


class BulletPlant:
    """The arm and the scene in PyBullet: torque control, gravity compensated inside."""

    def __init__(
        self, scene: SceneConfig, dynamics: DynamicsConfig | None = None
    ) -> None:
        """Connect to an engine of its own.

        Args:
            scene: Geometry of peg and hole; the triangle is refused.
            dynamics: Physics; the default is the model's.

        Raises:
            MissingDependencyError: PyBullet is not installed.
            ConfigError: The peg is a triangle.
        """
        if scene.peg == "triangle":
            raise ConfigError(
                "plant 'bullet' has no triangle peg: a convex mesh carries a 1 mm "
                "margin in PyBullet, more than the clearance; use plant 'mujoco', or "
                "peg 'square' or 'round'"
            )
        self._bullet = _import_pybullet()
        from dovetail import _core

        self.scene = scene
        self.robot: Robot = scene.robot()
        self._channel = _core.Channel()
        self._client = self._bullet.connect(self._bullet.DIRECT)
        self._nominal = self.robot.chain()
        self._body = -1
        self._time = 0.0
        self._q = self._dq = np.zeros(7)
        self._force = self._peak = np.zeros(3)
        self.configure(DynamicsConfig() if dynamics is None else dynamics)

    def configure(self, dynamics: DynamicsConfig) -> None:
        """Change the dynamics; call `reset` before the next torque."""
        from dovetail import _core

        robot = self.scene.robot(dynamics.inertia)
        scale = np.array(dynamics.mass_scale)
        self._mass = robot.mass * scale
        self._inertia = robot.inertia * scale[:, None, None]
        spin = np.zeros((7, 3, 3))
        spin[:, 2, 2] = dynamics.armature
        self._body_inertia = self._inertia + spin
        self._com = robot.com
        self._gravity = np.add(GRAVITY, dynamics.gravity_residual)

        def chain(inertia: Array) -> "_core.Chain":
            R = robot.flange_rotation
            return _core.Chain(
                origin_position=robot.origin_position,
                origin_rotation=robot.origin_rotation,
                mass=self._mass,
                com=robot.com,
                inertia=inertia,
                tool_position=robot.flange_position + R @ robot.tool_position,
                tool_rotation=R @ robot.tool_rotation,
                gravity=self._gravity,
            )

        self._true = chain(self._inertia)
        self._simulated = chain(self._body_inertia)
        self._armature = np.array(dynamics.armature)
        self._damping = np.array(dynamics.damping)
        self.dynamics = dynamics
        self._body = -1

    def attach_channel(self, channel: "_core.Channel") -> None:
        """Put a twin's delay and noise between controller and joints."""
        self._channel = channel

    def seed(self, seed: int) -> None:
        """Start the channel's noise again."""
        self._channel.seed(seed)

    def reset(self, q: Vec7, hole: Pose) -> None:
        """Put the arm at rest at q [rad] and the hole at its pose; time becomes 0.

        The world is built anew: Bullet keeps contacts between steps, and a trial must
        not remember the last one.

        Raises:
            ConfigError: The hole is out of reach, or q is not seven finite numbers.
        """
        q = require_configuration(q)
        self.scene.require_reachable(self.robot, hole)
        p, client = self._bullet, self._client
        p.resetSimulation(physicsClientId=client)
        p.setPhysicsEngineParameter(
            numSolverIterations=200,
            solverResidualThreshold=1e-10,
            contactBreakingThreshold=0.001,
            deterministicOverlappingPairs=1,
            enableConeFriction=1,
            physicsClientId=client,
        )
        p.setGravity(*self._gravity, physicsClientId=client)
        self._add_fixed([self.scene.table_primitive()], np.zeros(3), [0, 0, 0, 1])
        self._add_fixed(
            self.scene.block_primitives(), hole.position, _xyzw(hole.quat_wxyz)
        )
        self._body = self._add_arm()
        for joint in _JOINTS:
            p.resetJointState(
                self._body, joint, float(q[joint]), physicsClientId=client
            )
        self._channel.reset()
        self._time = 0.0
        self._force = self._peak = np.zeros(3)
        self._measure()

    def _add_shapes(self, parts: list[Primitive]) -> int:
        """Make one compound shape of boxes and cylinders; return its id."""
        p = self._bullet
        boxes = {"box": p.GEOM_BOX, "cylinder": p.GEOM_CYLINDER}
        return p.createCollisionShapeArray(
            shapeTypes=[boxes[part.kind] for part in parts],
            halfExtents=[
                list(part.size) if part.kind == "box" else [0.0, 0.0, 0.0]
                for part in parts
            ],
            radii=[part.size[0] for part in parts],
            lengths=[2.0 * part.size[-1] for part in parts],
            collisionFramePositions=[part.position.tolist() for part in parts],
            collisionFrameOrientations=[_xyzw(part.quat_wxyz) for part in parts],
            physicsClientId=self._client,
        )

    def _add_fixed(self, parts: list[Primitive], position: Vec3, quat: list) -> None:
        p, client = self._bullet, self._client
        # One body per part: Bullet's box-box contacts are best without compounds.
        for part in parts:
            place, turn = p.multiplyTransforms(
                list(position), quat, part.position.tolist(), _xyzw(part.quat_wxyz)
            )
            still = part._replace(
                position=np.zeros(3), quat_wxyz=np.array([1.0, 0.0, 0.0, 0.0])
            )
            body = p.createMultiBody(
                baseMass=0.0,
                baseCollisionShapeIndex=self._add_shapes([still]),
                basePosition=place,
                baseOrientation=turn,
                physicsClientId=client,
            )
            # Bullet multiplies the two coefficients: the tool carries the number.
            p.changeDynamics(body, -1, lateralFriction=1.0, physicsClientId=client)

    def _add_arm(self) -> int:
        """Build the serial chain with the simulated masses; return its body id."""
        p, client, robot = self._bullet, self._client, self.robot
        moments, axes = np.linalg.eigh(self._body_inertia)
        axes[np.linalg.det(axes) < 0.0, :, 0] *= -1.0
        tool = [self._in_link(part) for part in self.scene.tool_primitives()]
        body = p.createMultiBody(
            baseMass=0.0,
            linkMasses=self._mass.tolist(),
            linkCollisionShapeIndices=[-1] * 6 + [self._add_shapes(tool)],
            linkVisualShapeIndices=[-1] * 7,
            linkPositions=robot.origin_position.tolist(),
            linkOrientations=[
                _xyzw(quat_from_matrix(R)) for R in robot.origin_rotation
            ],
            linkInertialFramePositions=self._com.tolist(),
            linkInertialFrameOrientations=[_xyzw(quat_from_matrix(R)) for R in axes],
            linkParentIndices=_JOINTS,
            linkJointTypes=[p.JOINT_REVOLUTE] * 7,
            linkJointAxis=[[0.0, 0.0, 1.0]] * 7,
            physicsClientId=client,
        )
        for link in range(-1, 7):
            p.changeDynamics(
                body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
                lateralFriction=self.dynamics.contact_friction, physicsClientId=client,
            )  # fmt: skip
        for link in _JOINTS:
            p.changeDynamics(
                body, link, localInertiaDiagonal=moments[link].tolist(),
                physicsClientId=client,
            )  # fmt: skip
            # The velocity motor at zero speed is dry friction of this size, or off.
            p.setJointMotorControl2(
                body, link, p.VELOCITY_CONTROL, targetVelocity=0.0,
                force=self.dynamics.coulomb[link], physicsClientId=client,
            )  # fmt: skip
        return body

    def _in_link(self, part: Primitive) -> Primitive:
        """Move a part from the flange frame to the link-7 frame."""
        R = self.robot.flange_rotation
        position = self.robot.flange_position + R @ part.position
        return part._replace(position=position, quat_wxyz=quat_from_matrix(R))

    def _state(self) -> tuple[Vec7, Vec7]:
        states = self._bullet.getJointStates(
            self._body, _JOINTS, physicsClientId=self._client
        )
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def _measure(self) -> None:
        self._q, self._dq = self._channel.measure(*self._state())

    def read(self) -> tuple[Vec7, Vec7]:
        """Return the measured configuration [rad] and velocity [rad/s]."""
        return self._q, self._dq

    def apply(self, tau: Vec7, dt: float) -> None:
        """Hold the overlay torque tau [Nm] for dt [s]; gravity is compensated inside.

        Raises:
            PlantError: The simulation diverged, or `reset` was not called.
        """
        if self._body < 0:
            raise PlantError("plant was not reset since it was built or configured")
        p, client = self._bullet, self._client
        steps = physics_steps(dt, self.dynamics.physics_dt)
        h = dt / steps
        p.setTimeStep(h, physicsClientId=client)
        sent = self._channel.send(np.asarray(tau, dtype=float))
        self._peak = np.zeros(3)
        for _ in range(steps):
            motor = self._channel.receive(sent, h)
            forces = self._bullet_torque(motor, h)
            p.setJointMotorControlArray(
                self._body, _JOINTS, p.TORQUE_CONTROL, forces=forces.tolist(),
                physicsClientId=client,
            )  # fmt: skip
            p.stepSimulation(physicsClientId=client)
            self._force = self._sum_contact_force()
            if self._force @ self._force > self._peak @ self._peak:
                self._peak = self._force
        self._time += dt
        self._measure()

    def _bullet_torque(self, tau: Vec7, h: float) -> Vec7:
        """Return the torque that makes Bullet's arm move as the module's equation."""
        q, dq = self._state()
        if not np.abs(dq).max() < _DIVERGED:
            raise PlantError(
                f"Bullet simulation diverged: joint speeds {dq.round(1).tolist()} "
                f"rad/s at t = {self._time:.3f} s; reduce physics_dt or the torques, "
                "then reset"
            )
        if self.dynamics.gravity_compensation:
            tau = tau + self._nominal.gravity(q)
        true, simulated = self._true, self._simulated
        M = true.inertia_matrix(q)
        M[_JOINTS, _JOINTS] += self._armature + h * self._damping
        bias = true.coriolis(q, dq) + true.gravity(q) + self._damping * dq
        a = np.linalg.solve(M, tau - bias)
        return (
            simulated.inertia_matrix(q) @ a
            + simulated.coriolis(q, dq)
            + simulated.gravity(q)
        )

    def _sum_contact_force(self) -> Vec3:
        """Sum normal and friction forces on the arm's body [N], world axes."""
        points = self._bullet.getContactPoints(
            bodyA=self._body, physicsClientId=self._client
        )
        force = np.zeros(3)
        for point in points:
            normal, push = np.array(point[7]), point[9]
            force += normal * push
            force += np.array(point[11]) * point[10] + np.array(point[13]) * point[12]
        return force

    def run_cycles(
        self,
        controller: "_core.Controller",
        target: "_core.Target",
        cycles: int,
        period: float,
    ) -> tuple[Array, Vec7, Vec7]:
        """Run the controller against the plant; see `Plant.run_cycles`."""
        return run_cycles(self, controller, target, cycles, period, self._time)

    def contact_force(self) -> Vec3:
        """Return the force on peg and gripper in the last physics step [N], world."""
        return self._force

    def contact_force_peak(self) -> Vec3:
        """Return the largest such force during the last `apply` [N], world."""
        return self._peak

    def tool_pose(self) -> Pose:
        """Return the true pose of the TCP in the world, from Bullet's kinematics."""
        p = self._bullet
        state = p.getLinkState(
            self._body, 6, computeForwardKinematics=1, physicsClientId=self._client
        )
        R_flange = self.robot.flange_rotation
        tool = self.robot.flange_position + R_flange @ self.robot.tool_position
        rotation = quat_from_matrix(R_flange @ self.robot.tool_rotation)
        position, quat = p.multiplyTransforms(
            state[4], state[5], tool.tolist(), _xyzw(rotation)
        )
        x, y, z, w = quat
        sign = -1.0 if w < 0.0 else 1.0
        return Pose(np.array(position), sign * np.array([w, x, y, z]))

    def close(self) -> None:
        """Disconnect from the engine; harmless when repeated."""
        if self._client >= 0:
            self._bullet.disconnect(physicsClientId=self._client)
            self._client = -1
