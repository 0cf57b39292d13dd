r"""A plant in PyBullet, the paper's simulator.

Bullet knows no rotor inertia, its joint damping is explicit, which is unstable on light
links at long steps, and its contacts see the links only. So each physics step solves

.. math:: (M + A + h D)\,a = \tau + \tau_f - c - g - D \dot q + J_c^T \lambda_{k-1}

with our own chain (MuJoCo's implicit integrator; :math:`\tau_f` is dry friction) and
sends :math:`M_b a + c_b + g_b - J_c^T \lambda_{k-1}`, which makes Bullet's chain, of
inertia `M_b`, move so. The contact force of the last step makes rest and every impact's
whole momentum those of the true inertia, one step late. Half of A is in the links of
`M_b`, which keeps this correction a contraction: the eigenvalues of
:math:`(J M_b^{-1} J^T)^{-1} J (M + A)^{-1} J^T` were 0.2 to 1.9 for A to 1 kg m2 over
the workspace; it diverges only at 2.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.errors import (
    ConfigError,
    MissingDependencyError,
    PlantError,
    install_command,
)
from dovetail.plants.bullet_parts import (
    FixturePiece,
    HeldPieces,
    contact,
    round_inertia,
)
from dovetail.plants.bullet_world import WORLD, BulletWorld, xyzw
from dovetail.plants.cycle_loop import run_cycles
from dovetail.plants.dry_friction import dry_friction
from dovetail.plants.plant import (
    DynamicsConfig,
    physics_steps,
    require_configuration,
)
from dovetail.poses import UNMOVED, Pose, quat_from_matrix
from dovetail.robots.robot import GRAVITY, Robot
from dovetail.types import Array, Vec3, Vec7
from dovetail.workcell.parts import Moving, mass_centre_inertia, require_steppable
from dovetail.workcell.workcell import Workcell

if TYPE_CHECKING:
    from dovetail import _core

_JOINTS = list(range(7))
_SPIN = 0.5
"""Share of the rotor inertia that is part of Bullet's links."""
_DIVERGED = 50.0  # [rad/s]; the joints' limit is 2.4, Bullet clamps at 100


def _import_pybullet() -> Any:
    try:
        import pybullet
    except ImportError as error:
        raise MissingDependencyError(
            "plant 'bullet' needs PyBullet, which is not installed: "
            f"{install_command('bullet')}; or choose the plant 'mujoco'"
        ) from error
    return pybullet


class BulletPlant:
    """The workcell in PyBullet: torque control, gravity compensated inside."""

    def __init__(self, cell: Workcell, dynamics: DynamicsConfig | None = None) -> None:
        """Connect to an engine of its own.

        Args:
            cell: What stands in it, of boxes and cylinders.
            dynamics: Physics; the default is the robot model's.

        Raises:
            MissingDependencyError: PyBullet is not installed.
            ConfigError: A part has a prism or another convex mesh.
        """
        if meshes := cell.meshes():
            mesh = meshes[0]
            raise ConfigError(
                f"plant 'bullet' cannot build the {mesh.kind} {mesh.name!r} of "
                f"{cell.name}: a convex mesh carries a 1 mm margin in PyBullet, more "
                "than a clearance; use plant 'mujoco', or boxes and cylinders"
            )
        if screw := next((m for m in cell.held.moving if m.joint.lead), None):
            raise ConfigError(
                f"plant 'bullet' cannot hold the screw {screw.joint.name!r} of "
                f"{cell.held.name}: it builds screws on a fixture only; use plant "
                "'mujoco' or 'drake'"
            )
        self._bullet = _import_pybullet()
        from dovetail import _core

        self.cell = cell
        self.robot: Robot = cell.loaded_robot()
        self._channel = _core.Channel()
        self._client = self._bullet.connect(self._bullet.DIRECT)
        self._nominal = self.robot.chain()
        self._body = -1
        self._fixture: list[int] = []
        self._pieces: list[FixturePiece] = []
        self._held: HeldPieces | None = None
        self._model_before = np.zeros((7, 7)), np.zeros(7)
        self._push = np.zeros(3)
        self._grasp = UNMOVED
        self._time = 0.0
        self._q = self._dq = np.zeros(7)
        self._force = self._peak = np.zeros(3)
        self._contact_torque = np.zeros(7)
        self.configure(dynamics or DynamicsConfig.of_robot(cell.robot))

    def configure(self, dynamics: DynamicsConfig) -> None:
        """Change the dynamics; call `reset` before the next torque."""
        from dovetail import _core

        robot = self.cell.rigid_robot(dynamics.inertia)
        scale = np.array(dynamics.mass_scale)
        self._mass = robot.links.mass * scale
        self._inertia = robot.links.inertia * scale[:, None, None]
        spin = np.zeros((7, 3, 3))
        spin[:, 2, 2] = _SPIN * np.array(dynamics.armature)
        self._body_inertia = self._inertia + spin
        self._com = robot.links.com
        self._gravity = np.add(GRAVITY, dynamics.gravity_residual)

        def chain(inertia: Array) -> "_core.Chain":
            position, rotation = robot.geometry.tool_in_link()
            return _core.Chain(
                origin_position=robot.geometry.origin_position,
                origin_rotation=robot.geometry.origin_rotation,
                mass=self._mass,
                com=robot.links.com,
                inertia=inertia,
                tool_position=position,
                tool_rotation=rotation,
                gravity=self._gravity,
            )

        self._true = chain(self._inertia)
        self._simulated = chain(self._body_inertia)
        self._armature = np.array(dynamics.armature)
        self._damping = np.array(dynamics.damping)
        self._coulomb = np.array(dynamics.coulomb)
        self.dynamics = dynamics
        self._body = -1

    def attach_channel(self, channel: "_core.Channel") -> None:
        """Put a twin's delay and noise between controller and joints."""
        self._channel = channel

    def seed(self, seed: int) -> None:
        """Start the channel's noise again."""
        self._channel.seed(seed)

    def reset(self, q: Vec7, fixture: Pose) -> None:
        """Put the arm at rest at q [rad] and the fixture at its pose; time becomes 0.

        The world is built anew: Bullet keeps contacts between steps, and a trial must
        not remember the last one.

        Raises:
            ConfigError: The fixture is out of reach, or q is not seven finite numbers.
        """
        q = require_configuration(q)
        self.cell.require_reachable(fixture)
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
        world = BulletWorld(p, client)
        table = world.add_fixed(self.cell.table.primitives, WORLD)
        self._fixture = world.add_fixed(self.cell.fixture.primitives, fixture)
        self._body = world.add_arm(
            self.robot,
            self.cell.tool_primitives(self._grasp),
            *self._links(),
        )
        for joint in _JOINTS:
            p.resetJointState(
                self._body, joint, float(q[joint]), physicsClientId=client
            )
        self._add_parts(fixture, table)
        self._channel.reset()
        self._coulomb = np.array(self.dynamics.coulomb)
        self._time = 0.0
        self._force = self._peak = np.zeros(3)
        self._contact_torque = np.zeros(len(self._all_joints()[0]))
        self._push = np.zeros(3)
        self._measure()

    def _links(self) -> tuple[tuple[Array, Array, Array], float, list[Moving]]:
        """Return masses, centres and inertias, friction, and what moves on the arm."""
        at = self.robot.geometry
        quat = quat_from_matrix(at.flange_rotation)
        moving = [
            m.moved(at.flange_position, quat)
            for m in self.cell.held_moving(self._grasp)
        ]
        links = [self._mass], [self._com], [self._body_inertia]
        scale = self.dynamics.mass_scale[6]
        for piece in moving:
            mass, com, inertia = mass_centre_inertia(piece.primitives)
            inertia = scale * round_inertia(inertia, piece.joint.axis)
            found = [scale * mass], [com - piece.joint.origin], [inertia]
            for numbers, more in zip(links, found, strict=True):
                numbers.append(np.array(more))
        mass, com, inertia = (np.concatenate(numbers) for numbers in links)
        return (mass, com, inertia), self.dynamics.contact_friction, moving

    def _add_parts(self, fixture: Pose, table: list[int]) -> None:
        """Add what moves on the fixture, and let move what is held."""
        p, client, moving = self._bullet, self._client, self._links()[2]
        scale, gravity = self.dynamics.mass_scale[6], self._gravity
        self._held = None
        if moving:
            self._held = HeldPieces(p, client, self._body, moving, scale, gravity)
        self._pieces = []
        apart = [*table, *self._fixture]
        for piece in self.cell.fixture.moving:
            added = FixturePiece(p, client, piece, fixture, apart)
            self._pieces.append(added)
            apart.append(added.body)

    def part_positions(self) -> Array:
        """Return the true positions of the parts' joints [rad, m]."""
        held = self._all_joints()[0][7:]
        return np.array([*held, *(piece.state()[0] for piece in self._pieces)])

    def move_fixture(self, fixture: Pose) -> None:
        """Put the fixture at a pose at once, the arm's motion untouched.

        Raises:
            ConfigError: The fixture is out of reach.
        """
        self.cell.require_reachable(fixture)
        world = BulletWorld(self._bullet, self._client)
        world.move_fixed(self._fixture, self.cell.fixture.primitives, fixture)
        for piece in self._pieces:
            piece.move(fixture)

    def grasp(self, offset: Pose) -> None:
        """Displace the held part in the fingers, from the next reset on.

        Args:
            offset: The part's frame in the TCP's, which stays where it is.
        """
        self._grasp = offset

    def push(self, force: Vec3) -> None:
        """Push the TCP with a force [N], world axes, until the next push or `reset`."""
        self._push = np.array(force, dtype=float)

    def _state(self) -> tuple[Vec7, Vec7]:
        q, dq = self._all_joints()
        return q[:7], dq[:7]

    def _all_joints(self) -> tuple[Array, Array]:
        """Return position and velocity of the arm's joints and of those it holds."""
        count = 7 + (0 if self._held is None else len(self._held.joints))
        states = self._bullet.getJointStates(
            self._body, list(range(count)), physicsClientId=self._client
        )
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def _measure(self) -> None:
        self._q, self._dq = self._channel.measure(*self._state())

    def read(self) -> tuple[Vec7, Vec7]:
        """Return the measured configuration [rad] and velocity [rad/s]."""
        return self._q, self._dq

    @property
    def command_delay(self) -> float:
        """Delay until an overlay torque acts [s]."""
        return self._channel.delay

    def drop_commands(self) -> None:
        """Forget overlay torques that are still on their way."""
        self._channel.reset()

    def close_brakes(self, torque: Vec7) -> None:
        """Add dry friction [Nm] to every joint, until `open_brakes` or `reset`."""
        self._coulomb = np.add(self.dynamics.coulomb, torque)

    def open_brakes(self) -> None:
        """Take the brakes' friction away, the arm at rest."""
        self._coulomb = np.array(self.dynamics.coulomb)
        q, _ = self._state()
        for joint in _JOINTS:
            self._bullet.resetJointState(
                self._body, joint, float(q[joint]), physicsClientId=self._client
            )

    def apply(self, tau: Vec7, dt: float, drive: Vec7 | None = None) -> None:
        """Hold the overlay torque tau [Nm] for dt [s]; gravity is compensated inside.

        Args:
            tau: Overlay torque [Nm], which passes a twin's channel.
            dt: Time [s].
            drive: Torque of the arm's own drives [Nm], which does not.

        Raises:
            PlantError: The simulation diverged, or `reset` was not called.
        """
        if self._body < 0:
            raise PlantError("plant was not reset since it was built or configured")
        p, client = self._bullet, self._client
        steps = physics_steps(dt, self.dynamics.physics_dt)
        h = dt / steps
        require_steppable(self.cell.moving(), h)
        p.setTimeStep(h, physicsClientId=client)
        sent = self._channel.send(np.asarray(tau, dtype=float))
        self._peak = np.zeros(3)
        for _ in range(steps):
            motor = self._channel.receive(sent, h)
            if drive is not None:
                motor = motor + drive
            forces = self._bullet_torque(motor, h)
            p.setJointMotorControlArray(
                self._body, list(range(len(forces))), p.TORQUE_CONTROL,
                forces=forces.tolist(), physicsClientId=client,
            )  # fmt: skip
            for piece in self._pieces:
                piece.drive(h, self._gravity)
            dq_before = self._all_joints()[1]
            p.stepSimulation(physicsClientId=client)
            self._read_contacts()
            self._add_stops(dq_before, forces, h)
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
        if self._push.any():
            tau = tau + self._true.jacobian(q)[:3].T @ self._push
        true, simulated = self._true, self._simulated
        M = true.inertia_matrix(q)
        M[_JOINTS, _JOINTS] += self._armature + h * self._damping
        bias = true.coriolis(q, dq) + true.gravity(q) + self._damping * dq
        contact = self._contact_torque
        if self._held is not None:
            return self._with_held(self._held, tau, M, bias, h)
        Minv = np.asarray(np.linalg.inv(M), dtype=np.float64)
        a = Minv @ (tau - bias + contact)
        if self._coulomb.any():
            a += Minv @ dry_friction(Minv, dq + h * a, self._coulomb, h)
        bias_simulated = simulated.coriolis(q, dq) + simulated.gravity(q)
        return simulated.inertia_matrix(q) @ a + bias_simulated - contact

    def _with_held(
        self, held: HeldPieces, tau: Vec7, M: Array, bias: Vec7, h: float
    ) -> Array:
        """Return the same of the arm's joints and of those that it holds.

        Args:
            held: What moves on the held part.
            tau: Torque of the arm's joints [Nm].
            M: True inertia of the arm without it, at its joints.
            bias: True bias of the arm without it.
            h: Physics step [s].
        """
        q, dq = self._all_joints()
        simulated, contact = self._simulated, self._contact_torque
        force, added = held.law(q[7:], dq[7:], h)  # first: it is in Bullet's model
        true, bias_true = held.model(simulated, q, dq, is_bullets=False)
        M_all, bias_all = self._model_before = self._bullet_model(held, q, dq)
        true[:7, :7] += M
        bias_true[:7] += bias
        own = np.arange(7, len(q))
        true[own, own] += added
        Minv = np.asarray(np.linalg.inv(true), dtype=np.float64)
        a = Minv @ (np.concatenate([tau, force]) - bias_true + contact)
        coulomb = np.append(self._coulomb, [joint.friction for joint in held.joints])
        if coulomb.any():
            a += Minv @ dry_friction(Minv, dq + h * a, coulomb, h)
        return M_all @ a + bias_all - contact

    def _bullet_model(
        self, held: HeldPieces, q: Array, dq: Array
    ) -> tuple[Array, Array]:
        """Return inertia matrix and bias of all the joints in Bullet."""
        arm = self._simulated
        M, bias = held.model(arm, q, dq, is_bullets=True)
        M[:7, :7] += arm.inertia_matrix(q[:7])
        bias[:7] += arm.coriolis(q[:7], dq[:7]) + arm.gravity(q[:7])
        return M, bias

    def _add_stops(self, dq_before: Array, forces: Array, h: float) -> None:
        """Add what stops of held joints did in a step to the contacts' torque."""
        if (held := self._held) is None:
            return
        M, bias = self._model_before
        q, dq = self._all_joints()
        explained = forces - bias + self._contact_torque
        unexplained = M @ (dq - dq_before) / h - explained
        held.note_stops(q[7:], unexplained[7:])
        self._contact_torque[7:] += held.stop

    def _read_contacts(self) -> None:
        """Sum the contacts on the arm: force [N] and joint torque [Nm]."""
        points = self._bullet.getContactPoints(
            bodyA=self._body, physicsClientId=self._client
        )
        self._force, self._contact_torque = np.zeros(3), np.zeros(7)
        if self._held is not None:
            at_joints = self._held.contact(points)
            self._contact_torque = np.concatenate([np.zeros(7), at_joints])
        if not points:
            return
        q, _ = self._state()
        tool, _ = self._true.pose(q)
        moment = np.zeros(3)
        for point in points:
            f, at = contact(point)
            self._force += f
            moment += np.cross(at - tool, f)
        wrench = np.concatenate([self._force, moment])
        torque = self._true.jacobian(q).T @ wrench
        self._contact_torque[:7] = torque

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
        """Return the force on the tool in the last physics step [N], world."""
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
        tool, axes = self.robot.geometry.tool_in_link()
        position, quat = p.multiplyTransforms(
            state[4], state[5], tool.tolist(), xyzw(quat_from_matrix(axes))
        )
        x, y, z, w = quat
        sign = -1.0 if w < 0.0 else 1.0
        return Pose(np.array(position), sign * np.array([w, x, y, z]))

    def close(self) -> None:
        """Disconnect from the engine; harmless when repeated."""
        if self._client >= 0:
            self._bullet.disconnect(physicsClientId=self._client)
            self._client = -1
