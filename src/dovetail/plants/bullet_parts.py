"""Joints of parts in PyBullet: on the fixture bodies of their own, on the arm links.

Both are stepped linearly implicitly, see `workcell/joints.py`. Bullet knows no rotor
inertia and no implicit spring. A piece of the fixture therefore gets the inertia
:math:`A + h (D + h k)` beside its own, and its weight back. The pieces that the arm
holds are links of it: `BulletPlant` adds that inertia in its own equation.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dovetail.plants.bullet_world import BulletWorld, xyzw
from dovetail.poses import Pose, matrix_from_quat, quat_from_matrix
from dovetail.types import Array, Mat33, Vec3
from dovetail.workcell.joints import Joint
from dovetail.workcell.parts import Moving, mass_centre_inertia

if TYPE_CHECKING:
    from dovetail import _core

_AHEAD = 1e-5
"""Time over which the Jacobian's change is measured [s]."""
_SLIDER = 1e-3
"""Share of a screw's mass that its sliding link has."""
_GEAR_ERP, _GEAR_FORCE = 0.2, 1e6
"""Share of a screw's slip that a step takes back, and the most it does [N]."""
AT_STOP = {"slide": 1e-4, "hinge": 1e-3}
"""Distance from a stop in which its force is looked for [m, rad]."""


def set_stops(bullet: Any, client: int, body: int, link: int, joint: Joint) -> None:
    """Give a link its stops."""
    low, high = joint.stops
    bullet.changeDynamics(
        body, link, jointLowerLimit=low, jointUpperLimit=high, physicsClientId=client
    )


def axis_frame(axis: Vec3) -> Mat33:
    """Return a rotation whose z is an axis."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def round_inertia(inertia: Mat33, axis: Vec3) -> Mat33:
    """Return an inertia that is round about an axis, and the same about it."""
    about = float(axis @ inertia @ axis)
    across = (float(np.trace(inertia)) - about) / 2.0
    along = np.outer(axis, axis)
    return across * (np.eye(3) - along) + about * along


class FixturePiece:
    """A moving piece of the fixture: a fixed base with one link.

    A screw has two: one that slides, with a thousandth of the mass, and on it the
    piece, which turns. Bullet's solver of contacts keeps their ratio, as of two gears.
    """

    def __init__(
        self, bullet: Any, client: int, piece: Moving, fixture: Pose, apart: list[int]
    ) -> None:
        """Add it to the world.

        Args:
            bullet: The pybullet module.
            client: Its connection.
            piece: What moves.
            fixture: Pose of its part.
            apart: Bodies that it passes through.
        """
        self._bullet, self._client = bullet, client
        self.joint = piece.joint
        self._mass, com, inertia = mass_centre_inertia(piece.primitives)
        joint = self.joint
        still = Pose(-joint.origin, np.array([1.0, 0.0, 0.0, 0.0]))
        shapes = [s.moved(*still) for s in piece.primitives]
        kinds = [
            bullet.JOINT_PRISMATIC if joint.kind == "slide" else bullet.JOINT_REVOLUTE
        ]
        frame = axis_frame(joint.axis)
        shape = BulletWorld(bullet, client).add_shapes(shapes)
        before = 1 if joint.lead else 0
        self._link = before
        self._slider = _SLIDER * self._mass * before
        zeros, upright = [[0.0] * 3] * before, [[0.0, 0.0, 0.0, 1.0]] * before
        self.body = bullet.createMultiBody(
            baseMass=0.0,
            basePosition=list(fixture.position),
            baseOrientation=xyzw(fixture.quat_wxyz),
            linkMasses=[self._slider] * before + [self._mass - self._slider],
            linkCollisionShapeIndices=[-1] * before + [shape],
            linkVisualShapeIndices=[-1] * (before + 1),
            linkPositions=[*zeros, joint.origin.tolist()],
            linkOrientations=[*upright, [0.0, 0.0, 0.0, 1.0]],
            linkInertialFramePositions=[*zeros, (com - joint.origin).tolist()],
            linkInertialFrameOrientations=[*upright, xyzw(quat_from_matrix(frame))],
            linkParentIndices=list(range(before + 1)),
            linkJointTypes=[bullet.JOINT_PRISMATIC] * before + kinds,
            linkJointAxis=[joint.axis.tolist()] * (before + 1),
            physicsClientId=client,
        )
        self._about = float(joint.axis @ inertia @ joint.axis)
        self._across = float(np.trace(inertia) - self._about) / 2.0
        for link in range(before + 1):
            bullet.changeDynamics(
                self.body, link, linearDamping=0.0, angularDamping=0.0,
                jointDamping=0.0, lateralFriction=1.0, physicsClientId=client,
            )  # fmt: skip
            bullet.setJointMotorControl2(
                self.body, link, bullet.VELOCITY_CONTROL, force=0.0,
                physicsClientId=client,
            )  # fmt: skip
        set_stops(bullet, client, self.body, self._link, joint)
        for other in apart:
            for link in range(-1, bullet.getNumJoints(other, physicsClientId=client)):
                bullet.setCollisionFilterPair(
                    self.body, other, self._link, link, 0, physicsClientId=client
                )
        if joint.lead:
            self._couple(joint.lead)
        bullet.resetJointState(
            self.body, self._link, joint.start, physicsClientId=client
        )
        self._added = -1.0

    def _couple(self, lead: float) -> None:
        """Let the piece slide as it turns."""
        p, client, way = self._bullet, self._client, self.joint.start * lead
        p.resetJointState(self.body, 0, way, physicsClientId=client)
        gear = p.createConstraint(
            self.body, 0, self.body, 1, p.JOINT_GEAR,
            self.joint.axis.tolist(), [0.0] * 3, [0.0] * 3, physicsClientId=client,
        )  # fmt: skip
        p.changeConstraint(
            gear, gearRatio=-lead, relativePositionTarget=0.0, erp=_GEAR_ERP,
            maxForce=_GEAR_FORCE, physicsClientId=client,
        )  # fmt: skip

    def move(self, fixture: Pose) -> None:
        """Put its part somewhere at once."""
        self._bullet.resetBasePositionAndOrientation(
            self.body, list(fixture.position), xyzw(fixture.quat_wxyz),
            physicsClientId=self._client,
        )  # fmt: skip

    def state(self) -> tuple[float, float]:
        """Return position and velocity [rad, m and per s]."""
        state = self._bullet.getJointState(
            self.body, self._link, physicsClientId=self._client
        )
        return state[0], state[1]

    def drive(self, h: float, gravity: Vec3) -> None:
        """Set the force of the next step [s], with gravity [m/s2]."""
        p, client, joint = self._bullet, self._client, self.joint
        q, dq = self.state()
        damping = joint.law.implicit_damping(q, h)
        added = joint.armature + h * damping
        if added != self._added:
            self._set_inertia(added)
        force = joint.law.force(q) - damping * dq
        if joint.kind == "slide":
            x, y, z, w = p.getLinkState(self.body, 0, physicsClientId=client)[5]
            axis = matrix_from_quat(np.array([w, x, y, z])) @ joint.axis
            force -= added * float(axis @ gravity)  # Bullet lets the added mass fall
        if joint.friction:  # a motor to rest, solved together with contacts and stops
            p.setJointMotorControl2(
                self.body, self._link, p.VELOCITY_CONTROL, force=joint.friction,
                physicsClientId=client,
            )  # fmt: skip
        p.setJointMotorControl2(
            self.body, self._link, p.TORQUE_CONTROL, force=force, physicsClientId=client
        )

    def _set_inertia(self, added: float) -> None:
        self._added = added
        is_slide = self.joint.kind == "slide"
        about = self._about + (0.0 if is_slide else added)
        self._bullet.changeDynamics(
            self.body,
            self._link,
            mass=self._mass - self._slider + (added if is_slide else 0.0),
            localInertiaDiagonal=[self._across, self._across, about],
            physicsClientId=self._client,
        )


def contact(point: Any) -> tuple[Vec3, Vec3]:
    """Return force [N] and place [m] of a contact on its first body, world axes."""
    f = np.array(point[7]) * point[9]
    f += np.array(point[11]) * point[10] + np.array(point[13]) * point[12]
    return f, np.array(point[5])


def at_joint(joint: Joint, axis: Vec3, origin: Vec3, f: Vec3, at: Vec3) -> float:
    """Return what a force does at a joint [Nm, N], all in world axes."""
    if joint.kind == "slide":
        return float(axis @ f)
    return float(axis @ (np.cross(at - origin, f) + joint.lead * f))


class _Place(NamedTuple):
    """Place of a link, world axes."""

    R: Mat33
    axis: Vec3
    origin: Vec3
    centre: Vec3


class HeldPieces:
    """The moving pieces of the held part: links after the arm's seven."""

    def __init__(
        self,
        bullet: Any,
        client: int,
        body: int,
        pieces: list[Moving],
        scale: float,
        gravity: Vec3,
    ) -> None:
        """Let the links move.

        Args:
            bullet: The pybullet module.
            client: Its connection.
            body: The arm.
            pieces: What moves, in the frame of the arm's last link.
            scale: Of their masses and inertias.
            gravity: Of the world [m/s2].
        """
        self._bullet, self._client, self._body = bullet, client, body
        self._pieces, self._gravity = pieces, gravity
        rigid = [mass_centre_inertia(piece.primitives) for piece in pieces]
        self._mass = [scale * mass for mass, _, _ in rigid]
        self._inertia = [scale * inertia for _, _, inertia in rigid]
        self._simple = [
            round_inertia(inertia, piece.joint.axis)
            for inertia, piece in zip(self._inertia, pieces, strict=True)
        ]
        self._added = np.zeros(len(pieces))
        self._centre = [
            com - piece.joint.origin
            for (_, com, _), piece in zip(rigid, pieces, strict=True)
        ]
        self.joints = [piece.joint for piece in pieces]
        self.stop = np.zeros(len(pieces))
        for i, joint in enumerate(self.joints, start=7):
            set_stops(bullet, client, body, i, joint)
            bullet.resetJointState(body, i, joint.start, physicsClientId=client)

    def law(self, q: Array, dq: Array, h: float) -> tuple[Array, Array]:
        """Return the joints' own forces, and the inertia beside the links'."""
        damping = [
            j.law.implicit_damping(at, h) for j, at in zip(self.joints, q, strict=True)
        ]
        force = [j.law.force(at) for j, at in zip(self.joints, q, strict=True)]
        added = [j.armature + h * d for j, d in zip(self.joints, damping, strict=True)]
        for i, inertia in enumerate(added):
            if inertia != self._added[i]:
                self._set_inertia(i, inertia)
        return np.array(force) - np.array(damping) * dq, np.array(added)

    def _set_inertia(self, index: int, added: float) -> None:
        """Let a link of Bullet's have inertia at its joint, beside its own.

        Without it a stop's or a contact's impulse would stop the link alone.
        """
        self._added[index] = added
        mass, inertia = self._of_bullet(index)
        moments, axes = np.linalg.eigh(self._simple[index])
        axis = self.joints[index].axis
        moments[int(np.argmax(np.abs(axes.T @ axis)))] = axis @ inertia @ axis
        self._bullet.changeDynamics(
            self._body,
            7 + index,
            mass=mass,
            localInertiaDiagonal=moments.tolist(),
            physicsClientId=self._client,
        )

    def _of_bullet(self, index: int) -> tuple[float, Mat33]:
        """Return mass [kg] and inertia [kg m2] of a link of Bullet's, link axes."""
        added, axis = self._added[index], self.joints[index].axis
        if self.joints[index].kind == "slide":
            return self._mass[index] + added, self._simple[index]
        more = added * np.outer(axis, axis)
        return self._mass[index], self._simple[index] + more

    def model(
        self, chain: "_core.Chain", q: Array, dq: Array, *, is_bullets: bool
    ) -> tuple[Array, Array]:
        """Return what the pieces add to inertia matrix and bias, gravity included.

        Newton's and Euler's equations of each, with its Jacobian to all joints.

        Args:
            chain: The arm.
            q: Positions of the arm's joints and of these.
            dq: Velocities.
            is_bullets: Whether the pieces are those of Bullet's or the true ones.
        """
        J = chain.jacobian(q[:7])
        tip = chain.pose(q[:7])[0]
        ahead = chain.jacobian(q[:7] + _AHEAD * dq[:7])
        drift = (ahead - J) @ dq[:7] / _AHEAD  # acceleration at constant speeds
        w = J[3:] @ dq[:7]
        M, bias = np.zeros((len(q), len(q))), np.zeros(len(q))
        for i, piece in enumerate(self._pieces):
            at = self._place(i)
            u, o, c = at.axis, at.origin - tip, at.centre - at.origin
            is_slide = piece.joint.kind == "slide"
            linear, angular = np.zeros((3, len(q))), np.zeros((3, len(q)))
            linear[:, :7] = J[:3] + np.cross(J[3:], o + c, axis=0)
            angular[:, :7] = J[3:]
            linear[:, 7 + i] = u if is_slide else np.cross(u, c)
            angular[:, 7 + i] = 0.0 if is_slide else u
            turning = angular @ dq
            a = drift[:3] + np.cross(drift[3:], o) + np.cross(w, np.cross(w, o))
            alpha = drift[3:] + np.cross(w, turning)
            a += np.cross(alpha, c) + np.cross(turning, np.cross(turning, c))
            if is_slide:
                a += 2.0 * np.cross(w, u * dq[7 + i])
            mass, inertia = self._mass[i], self._inertia[i]
            if is_bullets:
                mass, inertia = self._of_bullet(i)
            inertia = at.R @ inertia @ at.R.T
            M += mass * linear.T @ linear + angular.T @ inertia @ angular
            bias += linear.T @ (mass * (a - self._gravity))
            bias += angular.T @ (inertia @ alpha + np.cross(turning, inertia @ turning))
        return M, np.asarray(bias, dtype=np.float64)

    def _place(self, index: int) -> "_Place":
        """Return where a link is, world axes."""
        link = self._bullet.getLinkState(
            self._body, 7 + index, computeForwardKinematics=1,
            physicsClientId=self._client,
        )  # fmt: skip
        x, y, z, w = link[5]
        R = matrix_from_quat(np.array([w, x, y, z]))
        axis = R @ self.joints[index].axis
        origin = np.array(link[4])
        return _Place(R, axis, origin, origin + R @ self._centre[index])

    def contact(self, points: Any) -> Array:
        """Return what contacts do at the joints [Nm, N]."""
        sums = np.zeros(len(self.joints))
        for i, joint in enumerate(self.joints):
            at = self._place(i)
            for point in points:
                if point[3] == 7 + i:
                    sums[i] += at_joint(joint, at.axis, at.origin, *contact(point))
        return sums

    def note_stops(self, q: Array, rest: Array) -> None:
        """Keep what the stops did in a step: the force that nothing else explains.

        Args:
            q: Joint positions after it.
            rest: Such forces [Nm, N].
        """
        for i, joint in enumerate(self.joints):
            low, high = joint.stops
            near = AT_STOP[joint.kind]
            force = 0.0
            if q[i] < low + near:
                force = max(0.0, rest[i])
            elif q[i] > high - near:
                force = min(0.0, rest[i])
            self.stop[i] = force
