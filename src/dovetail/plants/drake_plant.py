"""A plant in Drake: an engine that no policy was tuned on.

The arm is a discrete MultibodyPlant with the SAP solver. The tool is compliant and
meets rigid fixture and table in hydroelastic contact, whose pressure acts over areas.
So parts that fit closely need no points of contact that an engine would choose.

References:
    Castro, Permenter, Han 2022, An unconstrained convex formulation of compliant
    contact. Masterjohn et al. 2022, Velocity level approximation of pressure field
    contact patches.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.errors import MissingDependencyError, PlantError, install_command
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
from dovetail.workcell.parts import (
    Moving,
    Primitive,
    mass_centre_inertia,
    require_steppable,
)
from dovetail.workcell.workcell import Workcell

if TYPE_CHECKING:
    from dovetail import _core

STEP = 0.001
"""Longest physics step [s]."""
_MASS = 10.0
"""Mass behind the tool with which a contact time becomes a stiffness [kg]."""
_STRIP = 0.030 * 0.003
"""Area of contact that has this stiffness [m2]: a part 30 mm wide that stands on an
edge with 3 mm of its end. More area is stiffer, a corner softer."""
_DEPTH = 0.015
"""Depth of the material behind it [m], half the width of such a part."""
_DIVERGED = 50.0  # [rad/s]; the joints' limit is 2.4


def _import_drake() -> Any:
    try:
        import pydrake.all as drake
    except ImportError as error:
        raise MissingDependencyError(
            "plant 'drake' needs Drake, which is not installed: "
            f"{install_command('drake')}; or choose the plant 'mujoco'"
        ) from error
    return drake


class DrakePlant:
    """The workcell in Drake: torque control, gravity compensated inside."""

    def __init__(self, cell: Workcell, dynamics: DynamicsConfig | None = None) -> None:
        """Load the engine.

        Args:
            cell: What stands in it.
            dynamics: Physics; the default is the robot model's.

        Raises:
            MissingDependencyError: Drake is not installed.
        """
        self._drake = _import_drake()
        from dovetail import _core

        self.cell = cell
        self.robot: Robot = cell.loaded_robot()
        self._nominal = self.robot.chain()
        self._channel = _core.Channel()
        self._q = self._dq = np.zeros(7)
        self._push = self._force = self._peak = np.zeros(3)
        self._time = 0.0
        self._grasp = UNMOVED
        self.configure(dynamics or DynamicsConfig.of_robot(cell.robot))

    def configure(self, dynamics: DynamicsConfig) -> None:
        """Change the dynamics; call `reset` before the next torque."""
        self.dynamics = dynamics
        self._coulomb = np.array(dynamics.coulomb)
        self._worlds: dict[float, _World] = {}
        self._world: _World | None = None

    def attach_channel(self, channel: "_core.Channel") -> None:
        """Put a twin's delay and noise between controller and joints."""
        self._channel = channel

    def seed(self, seed: int) -> None:
        """Start the channel's noise again."""
        self._channel.seed(seed)

    def reset(self, q: Vec7, fixture: Pose) -> None:
        """Put the arm at rest at q [rad] and the fixture at its pose; time becomes 0.

        Raises:
            ConfigError: The fixture is out of reach, or q is not seven finite numbers.
        """
        q = require_configuration(q)
        self.cell.require_reachable(fixture)
        self._fixture = fixture
        self._world = self._world or self._world_of(STEP)
        self._begin(self._world, np.concatenate([q, self.cell.joint_starts]))
        self._channel.reset()
        self._coulomb = np.array(self.dynamics.coulomb)
        self._push = self._force = self._peak = np.zeros(3)
        self._time = 0.0
        self._measure()

    def _begin(self, world: "_World", q: Array) -> None:
        world.begin(q, np.zeros(len(q)), self._fixture)

    def _world_of(self, step: float) -> "_World":
        """Return the world with a physics step; the plant's is fixed in Drake."""
        if step not in self._worlds:
            self._worlds[step] = _World(
                self._drake, self.cell, self.dynamics, step, self._grasp
            )
        return self._worlds[step]

    def move_fixture(self, fixture: Pose) -> None:
        """Put the fixture at a pose at once, the arm's motion untouched.

        Raises:
            ConfigError: The fixture is out of reach.
        """
        self.cell.require_reachable(fixture)
        self._fixture = fixture
        self._ready().place(fixture)

    def grasp(self, offset: Pose) -> None:
        """Displace the held part in the fingers, from the next reset on.

        The worlds are built anew: shapes have their place from the beginning.

        Args:
            offset: The part's frame in the TCP's, which stays where it is.
        """
        self._grasp = offset
        self.configure(self.dynamics)

    def push(self, force: Vec3) -> None:
        """Push the TCP with a force [N], world axes, until the next push or `reset`."""
        self._push = np.array(force, dtype=float)

    def _ready(self) -> "_World":
        if self._world is None:
            raise PlantError("plant was not reset since it was built or configured")
        return self._world

    def _measure(self) -> None:
        q, dq = self._ready().state()
        self._q, self._dq = self._channel.measure(q[:7], dq[:7])

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
        world = self._ready()
        self._begin(world, world.state()[0])

    def apply(self, tau: Vec7, dt: float, drive: Vec7 | None = None) -> None:
        """Hold the overlay torque tau [Nm] for dt [s]; gravity is compensated inside.

        Args:
            tau: Overlay torque [Nm], which passes a twin's channel.
            dt: Time [s].
            drive: Torque of the arm's own drives [Nm], which does not.

        Raises:
            PlantError: The simulation diverged, or `reset` was not called.
        """
        world = self._ready()
        steps = physics_steps(dt, min(self.dynamics.physics_dt, STEP))
        h = dt / steps
        require_steppable(self.cell.moving(), h)
        if world.step != h:
            other = self._world_of(h)
            other.begin(*world.state(), self._fixture)
            self._world = world = other
        sent = self._channel.send(np.asarray(tau, dtype=float))
        self._peak = np.zeros(3)
        for _ in range(steps):
            motor = self._channel.receive(sent, h)
            if drive is not None:
                motor = motor + drive
            self._advance(world, motor)
        self._time += dt
        self._measure()

    def _advance(self, world: "_World", tau: Vec7) -> None:
        state = world.state()
        q, dq = state[0][:7], state[1][:7]
        is_sane = np.abs(dq).max() < _DIVERGED and np.isfinite(state[1]).all()
        if not is_sane:
            raise PlantError(
                f"Drake simulation diverged: joint speeds {state[1].round(1).tolist()} "
                f"rad/s at t = {self._time:.3f} s; reduce physics_dt or the torques, "
                "then reset"
            )
        if self.dynamics.gravity_compensation:
            tau = tau + self._nominal.gravity(q)
        if self._push.any():
            tau = tau + self._nominal.jacobian(q)[:3].T @ self._push
        tau = np.concatenate([tau, world.drive_parts(state[0][7:])])
        joints = self.cell.joints
        coulomb = np.array([*self._coulomb, *(joint.friction for joint in joints)])
        if coulomb.any():
            tau = tau + world.friction(tau, state[1], coulomb)
        world.advance(tau)
        self._force = world.contact_force()
        if self._force @ self._force > self._peak @ self._peak:
            self._peak = self._force

    def run_cycles(
        self,
        controller: "_core.Controller",
        target: "_core.Target",
        cycles: int,
        period: float,
    ) -> tuple[Array, Vec7, Vec7]:
        """Run the controller against the plant; see `Plant.run_cycles`."""
        return run_cycles(self, controller, target, cycles, period, self._time)

    def part_positions(self) -> Array:
        """Return the true positions of the parts' joints [rad, m]."""
        return self._ready().state()[0][7:]

    def contact_force(self) -> Vec3:
        """Return the force on the tool in the last physics step [N], world."""
        return self._force

    def contact_force_peak(self) -> Vec3:
        """Return the largest such force during the last `apply` [N], world."""
        return self._peak

    def tool_pose(self) -> Pose:
        """Return the true pose of the TCP in the world, from Drake's kinematics."""
        return self._ready().tool_pose()

    def close(self) -> None:
        """Release the engine; harmless when repeated."""
        self._world, self._worlds = None, {}


class _World:
    """A MultibodyPlant of one physics step, with its state."""

    def __init__(
        self,
        drake: Any,
        cell: Workcell,
        dynamics: DynamicsConfig,
        step: float,
        grasp: Pose,
    ) -> None:
        self._drake, self.step = drake, step
        self._armature = np.array(dynamics.armature)
        self._damping = np.array(dynamics.damping)
        builder = drake.DiagramBuilder()
        plant, scene = drake.AddMultibodyPlantSceneGraph(builder, step)
        plant.set_contact_model(drake.ContactModel.kHydroelasticWithFallback)
        approximation = drake.DiscreteContactApproximation.kSap
        plant.set_discrete_contact_approximation(approximation)
        gravity = np.add(GRAVITY, dynamics.gravity_residual)
        plant.mutable_gravity_field().set_gravity_vector(gravity)
        self._plant = plant
        self._joints: list[Any] = []
        self._law = [joint.law for joint in cell.joints]
        self._add_arm(cell, dynamics, grasp)
        friction = dynamics.contact_friction
        table = self._add_shapes(
            plant.world_body(), "table", cell.table.primitives, self._rigid(friction)
        )
        fixed = self._add_fixture(cell, friction)
        for ids in (self._tool_ids, table | fixed):  # one part's shapes do not collide
            apart = drake.CollisionFilterDeclaration()
            apart.ExcludeWithin(drake.GeometrySet(list(ids)))
            scene.collision_filter_manager().Apply(apart)
        plant.Finalize()
        self._places = [joint.position_start() for joint in self._joints]
        self._speeds = [joint.velocity_start() for joint in self._joints]
        self._damping = np.append(
            self._damping, [joint.damping for joint in cell.joints]
        )
        self._diagram = builder.Build()
        self._simulator = drake.Simulator(self._diagram)
        self._context = self._simulator.get_mutable_context()
        self._own = plant.GetMyMutableContextFromRoot(self._context)
        self._steps = 0
        self._torques = plant.get_applied_generalized_force_input_port()
        self._results = plant.get_contact_results_output_port()
        self._pressed = plant.get_generalized_contact_forces_output_port(
            self._joints[0].model_instance()
        )

    def _transform(self, position: Array, rotation: Array) -> Any:
        drake = self._drake
        return drake.RigidTransform(drake.RotationMatrix(rotation), position)

    def _pose(self, pose: Pose) -> Any:
        drake = self._drake
        w, x, y, z = pose.quat_wxyz / np.linalg.norm(pose.quat_wxyz)
        return drake.RigidTransform(drake.Quaternion(w, x, y, z), pose.position)

    def _add_arm(self, cell: Workcell, dynamics: DynamicsConfig, grasp: Pose) -> None:
        drake, plant = self._drake, self._plant
        robot = cell.rigid_robot(dynamics.inertia)
        links, scale = robot.links, np.array(dynamics.mass_scale)
        parent = plant.world_body()
        for i in range(7):
            inertia = links.inertia[i] * scale[i]
            body = plant.AddRigidBody(
                f"link_{i + 1}",
                drake.SpatialInertia.MakeFromCentralInertia(
                    float(links.mass[i] * scale[i]),
                    links.com[i],
                    drake.RotationalInertia(
                        *np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]
                    ),
                ),
            )
            origin = self._transform(
                robot.geometry.origin_position[i], robot.geometry.origin_rotation[i]
            )
            joint = plant.AddJoint(
                drake.RevoluteJoint(
                    f"A{i + 1}",
                    plant.AddFrame(
                        drake.FixedOffsetFrame(
                            f"at_{i + 1}", parent.body_frame(), origin
                        )
                    ),
                    body.body_frame(),
                    [0.0, 0.0, 1.0],
                    float(self._damping[i]),
                )
            )
            motor = plant.AddJointActuator(f"motor_{i + 1}", joint)
            motor.set_default_rotor_inertia(float(self._armature[i]))
            motor.set_default_gear_ratio(1.0)
            self._joints.append(joint)
            parent = body
        self._link = parent
        flange = self._transform(
            robot.geometry.flange_position, robot.geometry.flange_rotation
        )
        stiffness = 4.0 * _MASS / dynamics.contact_time**2
        modulus = stiffness * _DEPTH / _STRIP
        soft = drake.ProximityProperties()
        drake.AddCompliantHydroelasticProperties(0.01, modulus, soft)
        self._add_contact(soft, dynamics.contact_friction, dynamics.contact_time)
        self._tool_ids = self._add_shapes(
            parent, "tool", cell.tool_primitives(grasp), soft, flange
        )
        self._tool = self._transform(*robot.geometry.tool_in_link())
        self._carried = {parent.index()}
        for piece in cell.held_moving(grasp):
            body, ids = self._add_moving(
                parent, flange, piece, soft, dynamics.mass_scale[6]
            )
            self._carried.add(body.index())
            self._tool_ids |= ids

    def _rigid(self, friction: float) -> Any:
        hard = self._drake.ProximityProperties()
        self._drake.AddRigidHydroelasticProperties(0.01, hard)
        self._add_contact(hard, friction, 0.0)
        return hard

    def _add_contact(self, properties: Any, friction: float, time: float) -> None:
        drake = self._drake
        drake.AddContactMaterial(
            friction=drake.CoulombFriction(friction, friction), properties=properties
        )
        properties.AddProperty("material", "relaxation_time", 0.5 * time)

    def _add_moving(
        self, parent: Any, at: Any, piece: Moving, properties: Any, scale: float
    ) -> tuple[Any, set[Any]]:
        """Add what moves on a body; return its body and shapes.

        Args:
            parent: The body.
            at: Frame of the piece's part in the body's.
            piece: What moves.
            properties: Of contact.
            scale: Of its mass and inertia.
        """
        drake, plant, joint = self._drake, self._plant, piece.joint
        mass, com, I = mass_centre_inertia(piece.primitives)
        I = scale * I
        body = plant.AddRigidBody(
            joint.name,
            drake.SpatialInertia.MakeFromCentralInertia(
                scale * mass,
                com,
                drake.RotationalInertia(*np.diag(I), I[0, 1], I[0, 2], I[1, 2]),
            ),
        )
        ids = self._add_shapes(body, joint.name, piece.primitives, properties)
        origin = drake.RigidTransform(joint.origin)
        frames = [
            plant.AddFrame(drake.FixedOffsetFrame(f"{joint.name}_{k}", frame, place))
            for k, (frame, place) in enumerate(
                (
                    (parent.body_frame(), at.multiply(origin)),
                    (body.body_frame(), origin),
                )
            )
        ]
        about = joint.axis, *joint.stops, joint.damping
        if joint.kind == "slide":
            made = drake.PrismaticJoint(joint.name, *frames, *about)
        elif joint.kind == "hinge":
            made = drake.RevoluteJoint(joint.name, *frames, *about)
        else:
            turn = joint.axis, joint.pitch, joint.damping
            made = drake.ScrewJoint(joint.name, *frames, *turn)
            made.set_position_limits(*([stop] for stop in joint.stops))
        added = plant.AddJoint(made)
        motor = plant.AddJointActuator(f"{joint.name}_inertia", added)
        motor.set_default_rotor_inertia(joint.armature)
        motor.set_default_gear_ratio(1.0)
        self._joints.append(added)
        return body, ids

    def _add_fixture(self, cell: Workcell, friction: float) -> set[Any]:
        """Add the fixture and what moves on it; return their shapes."""
        drake, plant = self._drake, self._plant
        self._place = plant.AddFrame(
            drake.FixedOffsetFrame(
                "fixture_place", plant.world_frame(), drake.RigidTransform()
            )
        )
        body = plant.AddRigidBody(
            "fixture", drake.SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)
        )
        plant.WeldFrames(self._place, body.body_frame())
        hard = self._rigid(friction)
        ids = self._add_shapes(body, "fixture", cell.fixture.primitives, hard)
        for piece in cell.fixture.moving:
            still = drake.RigidTransform()
            ids |= self._add_moving(body, still, piece, hard, 1.0)[1]
        return ids

    def _add_shapes(
        self,
        body: Any,
        owner: str,
        parts: Iterable[Primitive],
        properties: Any,
        frame: Any = None,
    ) -> set[Any]:
        drake, found = self._drake, set()
        for part in parts:
            if part.kind == "box":
                shape = drake.Box(*(2.0 * np.array(part.size)))
            elif part.kind == "cylinder":
                shape = drake.Cylinder(part.size[0], 2.0 * part.size[1])
            else:
                shape = drake.Convex(part.vertices().T, part.name)
            place = self._pose(Pose(part.position, part.quat_wxyz))
            if frame is not None:
                place = frame.multiply(place)
            name = f"{owner}_{part.name}"
            found.add(
                self._plant.RegisterCollisionGeometry(
                    body, place, shape, name, properties
                )
            )
        return found

    def begin(self, q: Array, dq: Array, fixture: Pose) -> None:
        """Put arm, parts' joints and fixture somewhere, at time 0."""
        self._context.SetTime(0.0)
        self._steps = 0
        self.place(fixture)
        self._plant.SetPositions(self._own, self._ordered(q, self._places))
        self._plant.SetVelocities(self._own, self._ordered(dq, self._speeds))
        self._torques.FixValue(self._own, np.zeros(len(q)))
        self._simulator.Initialize()

    def place(self, fixture: Pose) -> None:
        """Put the fixture somewhere at once."""
        self._place.SetPoseInParentFrame(self._own, self._pose(fixture))

    def _ordered(self, values: Array, places: list[int]) -> Array:
        """Return numbers of the joints, the arm's first, in the engine's order."""
        ordered = np.empty(len(values))
        ordered[places] = values
        return ordered

    def state(self) -> tuple[Array, Array]:
        """Return true positions and velocities of the joints, the arm's seven first."""
        plant, own = self._plant, self._own
        q, dq = plant.GetPositions(own), plant.GetVelocities(own)
        return q[self._places], dq[self._speeds]

    def drive_parts(self, q: Array) -> Array:
        """Return the forces of springs and detents, and set their implicit damping."""
        h = self.step
        for i, (law, at) in enumerate(zip(self._law, q, strict=True), start=7):
            self._damping[i] = law.implicit_damping(at, h)
            self._joints[i].SetDamping(self._own, self._damping[i])
        return np.array([law.force(at) for law, at in zip(self._law, q, strict=True)])

    def friction(self, tau: Array, dq: Array, coulomb: Array) -> Array:
        """Return the torque of dry friction in the next step [Nm, N]."""
        plant, own, h = self._plant, self._own, self.step
        order = self._speeds
        M = plant.CalcMassMatrix(own)[np.ix_(order, order)]
        M = M + h * np.diag(self._damping)
        bias = plant.CalcBiasTerm(own) - plant.CalcGravityGeneralizedForces(own)
        bias = bias[order]
        Minv = np.linalg.inv(M)
        force = tau - bias - self._damping * dq
        if len(force) > 7:  # the contact of the step before, on parts
            force[7:] += self._pressed.Eval(own)[order[7:]]
        return dry_friction(Minv, dq + h * (Minv @ force), coulomb, h)

    def advance(self, tau: Array) -> None:
        """Hold joint torques [Nm, N] for a step."""
        self._torques.FixValue(self._own, self._ordered(tau, self._speeds))
        # Not the time plus a step: rounded up, it would lie past the next update, and
        # two steps would be made at once.
        self._steps += 1
        self._simulator.AdvanceTo(self._steps * self.step)

    def contact_force(self) -> Vec3:
        """Return the force on the tool [N], world."""
        results = self._results.Eval(self._own)
        force = np.zeros(3)
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            on_tool = info.bodyB_index() in self._carried
            force += (1.0 if on_tool else -1.0) * info.contact_force()
        for i in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(i)
            on_tool = info.contact_surface().id_M() in self._tool_ids
            force += (1.0 if on_tool else -1.0) * info.F_Ac_W().translational()
        return force

    def tool_pose(self) -> Pose:
        """Return the true pose of the TCP."""
        link = self._plant.EvalBodyPoseInWorld(self._own, self._link)
        pose = link.multiply(self._tool)
        return Pose(pose.translation(), quat_from_matrix(pose.rotation().matrix()))
