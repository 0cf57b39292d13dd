"""Bodies in PyBullet: the arm as a multi-body, fixture and table as fixed boxes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dovetail.poses import Pose, quat_from_matrix, quat_multiply
from dovetail.robots.robot import Robot
from dovetail.types import Array
from dovetail.workcell.parts import IDENTITY, Moving, Primitive

WORLD = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
"""The world's own frame."""

_JOINTS = list(range(7))


def xyzw(quat_wxyz: Array) -> list[float]:
    """Return a quaternion in Bullet's order."""
    w, x, y, z = (float(v) for v in quat_wxyz)
    return [x, y, z, w]


class BulletWorld:
    """Adds bodies to one connected engine."""

    def __init__(self, bullet: Any, client: int) -> None:
        """Remember the pybullet module and its connection."""
        self._bullet = bullet
        self._client = client

    def add_shapes(self, parts: Sequence[Primitive]) -> int:
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
            collisionFrameOrientations=[xyzw(part.quat_wxyz) for part in parts],
            physicsClientId=self._client,
        )

    def add_fixed(self, parts: Sequence[Primitive], frame: Pose) -> list[int]:
        """Add fixed shapes given in a frame; return their body ids."""
        p, client = self._bullet, self._client
        bodies = []
        # One body per part: Bullet's box-box contacts are best without compounds.
        for part in parts:
            place, turn = self._place(part, frame)
            still = part._replace(
                position=np.zeros(3), quat_wxyz=np.array([1.0, 0.0, 0.0, 0.0])
            )
            body = p.createMultiBody(
                baseMass=0.0,
                baseCollisionShapeIndex=self.add_shapes([still]),
                basePosition=place,
                baseOrientation=turn,
                physicsClientId=client,
            )
            # Bullet multiplies the two coefficients: the tool carries the number.
            p.changeDynamics(body, -1, lateralFriction=1.0, physicsClientId=client)
            bodies.append(body)
        return bodies

    def move_fixed(
        self, bodies: list[int], parts: Sequence[Primitive], frame: Pose
    ) -> None:
        """Put bodies of `add_fixed` where their frame now is."""
        for body, part in zip(bodies, parts, strict=True):
            place, turn = self._place(part, frame)
            self._bullet.resetBasePositionAndOrientation(
                body, place, turn, physicsClientId=self._client
            )

    def _place(self, part: Primitive, frame: Pose) -> tuple[list[float], list[float]]:
        """Return position and rotation (xyzw) in the world of a part in a frame."""
        return self._bullet.multiplyTransforms(
            list(frame.position),
            xyzw(frame.quat_wxyz),
            part.position.tolist(),
            xyzw(part.quat_wxyz),
        )

    def add_arm(
        self,
        robot: Robot,
        tool: list[Primitive],
        links: tuple[Array, Array, Array],
        friction: float,
        moving: Sequence[Moving] = (),
    ) -> int:
        """Build the serial chain, torque-controlled and without any damping.

        Args:
            robot: Geometry.
            tool: Collision shapes on the flange.
            moving: What moves on the held part, each a link after the seven, in the
                frame of the last one.
            links: Masses [kg] (n,), centres [m] (n, 3), inertias [kg m2] (n, 3, 3), of
                the seven links and of what moves, each in its link's frame.
            friction: Sliding friction coefficient of the tool.

        Returns:
            Bullet's body id.
        """
        p, client = self._bullet, self._client
        mass, com, inertia = links
        moments, axes = np.linalg.eigh(inertia)
        axes[np.linalg.det(axes) < 0.0, :, 0] *= -1.0
        shapes = self.add_shapes([_in_link(part, robot) for part in tool])
        at = [piece.joint.origin for piece in moving]
        pieces = [
            self.add_shapes([s.moved(-origin, IDENTITY) for s in piece.primitives])
            for origin, piece in zip(at, moving, strict=True)
        ]
        kinds = {"slide": p.JOINT_PRISMATIC, "hinge": p.JOINT_REVOLUTE}
        count = 7 + len(at)
        body = p.createMultiBody(
            baseMass=0.0,
            linkMasses=mass.tolist(),
            linkCollisionShapeIndices=[-1] * 6 + [shapes, *pieces],
            linkVisualShapeIndices=[-1] * count,
            linkPositions=[
                *robot.geometry.origin_position.tolist(),
                *(origin.tolist() for origin in at),
            ],
            linkOrientations=[
                *(xyzw(quat_from_matrix(R)) for R in robot.geometry.origin_rotation),
                *([0.0, 0.0, 0.0, 1.0] for _ in at),
            ],
            linkInertialFramePositions=com.tolist(),
            linkInertialFrameOrientations=[xyzw(quat_from_matrix(R)) for R in axes],
            linkParentIndices=_JOINTS + [7] * len(at),
            linkJointTypes=[
                *[p.JOINT_REVOLUTE] * 7,
                *(kinds[piece.joint.kind] for piece in moving),
            ],
            linkJointAxis=[
                *[[0.0, 0.0, 1.0]] * 7,
                *(piece.joint.axis.tolist() for piece in moving),
            ],
            physicsClientId=client,
        )
        for link in range(-1, count):
            p.changeDynamics(
                body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
                lateralFriction=friction, physicsClientId=client,
            )  # fmt: skip
        for link in range(count):
            p.changeDynamics(
                body, link, localInertiaDiagonal=moments[link].tolist(),
                physicsClientId=client,
            )  # fmt: skip
            # Bullet gives every joint a velocity motor; without force it is off.
            p.setJointMotorControl2(
                body, link, p.VELOCITY_CONTROL, force=0.0, physicsClientId=client
            )
        return body


def _in_link(part: Primitive, robot: Robot) -> Primitive:
    """Move a part from the flange frame to the link-7 frame."""
    R = robot.geometry.flange_rotation
    position = robot.geometry.flange_position + R @ part.position
    quat = quat_multiply(quat_from_matrix(R), part.quat_wxyz)
    return part._replace(position=position, quat_wxyz=quat)
