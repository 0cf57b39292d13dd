"""A plant in MuJoCo, whose control loop runs in C++."""

import math
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dovetail.errors import PlantError
from dovetail.plants.mjcf import (
    build_mjcf,
    in_last_link,
    joint_name,
    model_positions,
    turns,
)
from dovetail.plants.plant import (
    CYCLE_COLUMNS,
    DynamicsConfig,
    physics_steps,
    require_configuration,
)
from dovetail.poses import Pose, compose, inverse, quat_from_matrix
from dovetail.robots.robot import GRAVITY, Robot
from dovetail.types import Array, Vec3, Vec7
from dovetail.workcell.parts import require_steppable
from dovetail.workcell.workcell import Workcell

if TYPE_CHECKING:
    from dovetail import _core


_HARD = (0.001, 1.0), (0.999, 0.9999, 0.001, 0.5, 2.0)
"""solref and solimp of closed brakes: as stiff as the physics step allows, which
MuJoCo sees to, where its usual friction creeps at some 1e-3 rad/s per Nm."""

_SOFTNESS = 0.3
"""Softness of contacts of the parts' pieces over MuJoCo's, which is for their mass: at
1, 7 N pressed a button of 6 g in by 40 um; at 0.1, a cylinder of 100 g rattled on the
tool with peaks of 13 N."""

_THREAD = 0.01
"""Softness of a screw's friction and stops over MuJoCo's, which is for its inertia: at
1, a nut of 12 g that its friction should hold crept by 0.15 rad/s under 100 N."""


def _library_path(mujoco: Any) -> str:
    """Find the libmujoco that the Python package has loaded."""
    folder = Path(mujoco.__file__).parent
    names = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    for name in names:
        found = sorted(folder.glob(name))
        if found:
            return str(found[0])
    raise PlantError(f"no MuJoCo library in {folder}; install mujoco again")


class _Begun(NamedTuple):
    """Control cycles that a thread of a pool runs."""

    pool: "_core.ThreadPool"
    slot: int
    target: "_core.Target"
    log: Array


class MujocoPlant:
    """The workcell in MuJoCo: torque control, gravity compensated inside."""

    _begun: _Begun | None = None  # of the class: a plant that was not built ends, too

    def __init__(
        self,
        cell: Workcell,
        dynamics: DynamicsConfig | None = None,
        *,
        visual_meshes: bool = False,
    ) -> None:
        """Build the model.

        Args:
            cell: What stands in it.
            dynamics: Physics; the default is the robot model's.
            visual_meshes: Draw arm and tool by the meshes that they have.

        Raises:
            PlantError: MuJoCo's version is not the one the loop was compiled against.
        """
        import mujoco

        from dovetail import _core

        engine: Any = mujoco  # its stubs do not name what the package re-exports
        self._mujoco = engine
        self._core = _core
        self.cell = cell
        self.robot: Robot = cell.loaded_robot()
        text = build_mjcf(self.robot, cell, visual_meshes=visual_meshes)
        self.model = engine.MjModel.from_xml_string(text)
        self.data = engine.MjData(self.model)
        self._pushed = self._pushed_body()
        self._library = _library_path(engine)
        self._channel = _core.Channel()
        self._is_ready = False
        self._soft = self.model.dof_solref[:7].copy(), self.model.dof_solimp[:7].copy()
        self._moving = [
            self.model.body(joint_name(joint.name)).id for joint in cell.joints
        ]
        self._moving_mass = self.model.body_mass[self._moving].copy()
        self._moving_inertia = self.model.body_inertia[self._moving].copy()
        self._turns = turns(cell.joints)
        self._screws = [
            at for at, j in zip(self._turns, cell.joints, strict=True) if j.lead
        ]
        self._is_compensated: bool | None = None  # None: there is no loop yet
        self.configure(dynamics or DynamicsConfig.of_robot(cell.robot))

    def _pushed_body(self) -> int:
        """Return the body on which a force acts at the TCP.

        MuJoCo's forces act at a body's centre of mass: that of the massless flange is
        put at the TCP.
        """
        body = self.model.body("flange").id
        self.model.body_ipos[body] = self.robot.geometry.tool_position
        self.model.body_sameframe[body] = 0  # the centre is not the body's origin
        return body

    def configure(self, dynamics: DynamicsConfig) -> None:
        """Change the dynamics; call `reset` before the next torque."""
        self.drop_cycles()
        self.dynamics = dynamics
        model = self.model
        robot = self.cell.rigid_robot(dynamics.inertia)
        for i in range(7):
            body = model.body(f"link{i + 1}").id
            moments, axes = np.linalg.eigh(robot.links.inertia[i])
            if np.linalg.det(axes) < 0.0:
                axes[:, 0] = -axes[:, 0]
            scale = dynamics.mass_scale[i]
            model.body_mass[body] = robot.links.mass[i] * scale
            model.body_ipos[body] = robot.links.com[i]
            model.body_inertia[body] = moments * scale
            model.body_iquat[body] = quat_from_matrix(axes)
        model.dof_damping[:7] = dynamics.damping
        self._set_friction(dynamics.coulomb, self._soft)
        model.dof_armature[:7] = dynamics.armature
        model.geom_friction[:, 0] = dynamics.contact_friction
        model.geom_solref[:, 0] = dynamics.contact_time
        model.opt.gravity[:] = np.add(GRAVITY, dynamics.gravity_residual)
        self._mujoco.mj_resetData(model, self.data)
        self._configure_parts()
        self._set_constants()
        self._is_ready = False
        self._period = math.nan  # that the physics step is made for: none yet
        if self._is_compensated != dynamics.gravity_compensation:
            self._is_compensated = dynamics.gravity_compensation
            self._loop = self._make_loop()

    def _set_constants(self) -> None:
        """Compute what follows from masses and places; set softness of pieces."""
        model = self.model
        self._mujoco.mj_setConst(model, self.data)
        model.body_invweight0[self._moving] *= _SOFTNESS
        model.dof_invweight0[self._screws] *= _THREAD

    def _configure_parts(self) -> None:
        """Set what a mass scale and hard stops make of the parts' joints."""
        model, count = self.model, len(self._moving)
        scale = np.ones(count)
        scale[: len(self.cell.held.moving)] = self.dynamics.mass_scale[6]
        model.body_mass[self._moving] = self._moving_mass * scale
        model.body_inertia[self._moving] = self._moving_inertia * scale[:, None]
        for dof, joint in zip(self._turns, self.cell.joints, strict=True):
            model.dof_frictionloss[dof] = joint.friction
            model.dof_armature[dof] = joint.armature
            for solref, solimp in (
                (model.dof_solref, model.dof_solimp),
                (model.jnt_solref, model.jnt_solimp),
            ):
                solref[dof], solimp[dof] = _HARD
        model.eq_solref[:], model.eq_solimp[:] = _HARD

    def _make_loop(self) -> "_core.MujocoLoop":
        """Build the control loop over the model; its channel starts anew."""
        try:
            loop = self._core.MujocoLoop(
                self._library,
                self.model._address,
                self.data._address,
                self.robot.chain(),
                self._channel,
                self.dynamics.gravity_compensation,
            )
        except RuntimeError as error:
            raise PlantError(str(error)) from error
        none = self._core.PartJoint(
            stiffness=0.0, rest=0.0, damping=0.0, armature=0.0, detents=[]
        )
        laws = [none] * (self.model.nq - 7)  # also of the way of a screw
        for at, joint in zip(self._turns, self.cell.joints, strict=True):
            laws[at - 7] = joint.law
        loop.set_part_joints(laws)
        return loop

    def attach_channel(self, channel: "_core.Channel") -> None:
        """Put a twin's delay and noise between controller and joints."""
        self._channel = channel
        self._loop.set_channel(channel)

    def seed(self, seed: int) -> None:
        """Start the channel's noise again."""
        self._channel.seed(seed)
        self._loop.seed(seed)

    def reset(self, q: Vec7, fixture: Pose) -> None:
        """Put the arm at rest at q [rad] and the fixture at its pose; time becomes 0.

        Raises:
            ConfigError: The fixture is out of reach, or q is not seven finite numbers.
        """
        q = require_configuration(q)
        self.cell.require_reachable(fixture)
        self.drop_cycles()
        data = self.data
        self.open_brakes()
        self._mujoco.mj_resetData(self.model, data)
        joints, starts = self.cell.joints, self.cell.joint_starts
        data.qpos[:] = model_positions(q, joints, starts)
        data.mocap_pos[0] = fixture.position
        data.mocap_quat[0] = fixture.quat_wxyz
        self._loop.reset()
        self._is_ready = True

    def move_fixture(self, fixture: Pose) -> None:
        """Put the fixture at a pose at once, the arm's motion untouched.

        Raises:
            ConfigError: The fixture is out of reach.
        """
        self.cell.require_reachable(fixture)
        self.data.mocap_pos[0] = fixture.position
        self.data.mocap_quat[0] = fixture.quat_wxyz

    def grasp(self, offset: Pose) -> None:
        """Displace the held part in the fingers, from the next reset on.

        Args:
            offset: The part's frame in the TCP's, which stays where it is.
        """
        self.drop_cycles()
        model = self.model
        for shape in self.cell.held_primitives(offset):
            placed = in_last_link(shape, self.robot)
            pose, i = Pose(placed.position, placed.quat_wxyz), model.geom(shape.name).id
            if (mesh := model.geom_dataid[i]) >= 0:  # MuJoCo has moved its origin
                pose = compose(pose, Pose(model.mesh_pos[mesh], model.mesh_quat[mesh]))
            model.geom_pos[i], model.geom_quat[i] = pose
            model.geom_sameframe[i] = 0  # not the body's own frame
        at, tcp = self.robot.geometry, self.cell.tool_frame
        slipped = compose(compose(tcp, offset), inverse(tcp))
        flange = Pose(at.flange_position, quat_from_matrix(at.flange_rotation))
        for body in self._moving[: len(self.cell.held.moving)]:
            model.body_pos[body], model.body_quat[body] = compose(flange, slipped)
            model.body_sameframe[body] = 0
        self._set_constants()  # the boxes of the mid-phase, too
        self._is_ready = False

    def push(self, force: Vec3) -> None:
        """Push the TCP with a force [N], world axes, until the next push or `reset`."""
        self.data.xfrc_applied[self._pushed, :3] = force  # `reset` clears it

    def read(self) -> tuple[Vec7, Vec7]:
        """Return the measured configuration [rad] and velocity [rad/s]."""
        return self._loop.read()

    @property
    def command_delay(self) -> float:
        """Delay until an overlay torque acts [s]."""
        return self._channel.delay

    def drop_commands(self) -> None:
        """Forget overlay torques that are still on their way."""
        self._loop.drop_commands()

    def close_brakes(self, torque: Vec7) -> None:
        """Add dry friction [Nm] to every joint, until `open_brakes` or `reset`."""
        self._set_friction(np.add(self.dynamics.coulomb, torque), _HARD)

    def open_brakes(self) -> None:
        """Take the brakes' friction away, the arm at rest."""
        self._set_friction(self.dynamics.coulomb, self._soft)
        self.data.qvel[:] = 0.0

    def _set_friction(self, torque: Any, softness: Any) -> None:
        """Set dry friction [Nm] and the softness of its constraints."""
        self.model.dof_frictionloss[:7] = torque
        self.model.dof_solref[:7], self.model.dof_solimp[:7] = softness

    def apply(self, tau: Vec7, dt: float, drive: Vec7 | None = None) -> None:
        """Hold the overlay torque tau [Nm] for dt [s]; gravity is compensated inside.

        Args:
            tau: Overlay torque [Nm], which passes a twin's channel.
            dt: Time [s].
            drive: Torque of the arm's own drives [Nm], which does not.

        Raises:
            PlantError: The simulation diverged, or `reset` was not called.
        """
        if dt != self._period:
            self._prepare(dt)
        try:
            if drive is None:
                self._loop.apply(np.asarray(tau, dtype=float), self._steps)
            else:
                self._loop.apply(np.asarray(tau, dtype=float), self._steps, drive)
        except RuntimeError as error:
            raise PlantError(str(error)) from error

    def run_cycles(
        self,
        controller: "_core.Controller",
        target: "_core.Target",
        cycles: int,
        period: float,
    ) -> tuple[Array, Vec7, Vec7]:
        """Run the controller against the plant, all in C++; see `Plant.run_cycles`.

        Cycles of this target that `begin_cycles` has begun are waited for instead.
        """
        begun = self._begun
        try:
            if begun is None:
                if period != self._period:
                    self._prepare(period)
                log = np.empty((cycles, len(CYCLE_COLUMNS)))
                self._loop.run(controller, target, self._steps, log)
            else:
                log = begun.log
                begun.pool.finish(begun.slot)
                self._begun = None  # not before: an interrupt may come while it waits
        except RuntimeError as error:
            self._begun = None
            which = "" if begun is None else f"simulation {begun.slot} of the batch: "
            raise PlantError(f"{which}{error}") from error
        if begun is not None and (begun.target is not target or len(log) != cycles):
            raise PlantError(
                f"{len(log)} control cycles were begun, and then {cycles} asked for or "
                "another target: step an arm by what it has begun"
            )
        q, dq = self._loop.read()
        return log, q, dq

    def begin_cycles(
        self,
        pool: "_core.ThreadPool",
        slot: int,
        controller: "_core.Controller",
        target: "_core.Target",
        cycles: int,
        period: float,
    ) -> None:
        """Begin on a thread of a pool what the next `run_cycles` then ends.

        Until then nothing else may be done with plant and controller, but `reset`.

        Args:
            pool: Where the thread is.
            slot: The pool's slot for this plant.
            controller: See `run_cycles`, as for the rest; the target is copied.
            target: Held during all cycles.
            cycles: Number of control cycles.
            period: Control period [s].
        """
        if self._begun is not None:
            raise PlantError(
                "control cycles were begun and not ended: end the step, or reset"
            )
        if period != self._period:
            self._prepare(period)
        log = np.empty((cycles, len(CYCLE_COLUMNS)))
        pool.begin_run(slot, self._loop, controller, target, self._steps, log)
        self._begun = _Begun(pool, slot, target, log)

    def drop_cycles(self) -> None:
        """Wait for cycles that were begun, and forget what came of them."""
        if (begun := self._begun) is not None:
            with suppress(RuntimeError):  # diverged: so is what is forgotten
                begun.pool.finish(begun.slot)
            self._begun = None

    def _prepare(self, period: float) -> None:
        """Set the physics step for another control period."""
        if not self._is_ready:
            raise PlantError("plant was not reset since it was built or configured")
        # MuJoCo (refsafe) would make contacts softer than two steps show.
        dynamics = self.dynamics
        longest = min(dynamics.physics_dt, 0.5 * dynamics.contact_time)
        self._steps = physics_steps(period, longest)
        require_steppable(self.cell.moving(), period / self._steps)
        self.model.opt.timestep = period / self._steps
        self._period = period

    def part_positions(self) -> Array:
        """Return the true positions of the parts' joints [rad, m]."""
        return self.data.qpos[self._turns]

    def contact_force(self) -> Vec3:
        """Return the force on the tool in the last physics step [N], world."""
        return self._loop.contact_force()

    def contact_force_peak(self) -> Vec3:
        """Return the largest such force during the last `apply` [N], world."""
        return self._loop.contact_force_peak()

    def tool_pose(self) -> Pose:
        """Return the true pose of the TCP in the world, from MuJoCo's kinematics."""
        self._mujoco.mj_kinematics(self.model, self.data)
        site = self.data.site("tcp")
        rotation = np.array(site.xmat).reshape(3, 3)
        return Pose(np.array(site.xpos), quat_from_matrix(rotation))

    def __del__(self) -> None:
        """End cycles that were begun: a thread works in the memory of this plant."""
        self.drop_cycles()

    def close(self) -> None:
        """Do nothing: MuJoCo's memory belongs to Python."""
