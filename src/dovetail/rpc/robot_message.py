"""The controller's model in a message, so that both ends compute with the same."""

from typing import Any, TypeVar

import numpy as np

from dovetail.robots.arrays import ArrayFacts
from dovetail.robots.geometry import Geometry
from dovetail.robots.links import Links
from dovetail.robots.motors import Motors
from dovetail.robots.robot import Payload, Robot
from dovetail.robots.robot_limits import RobotLimits
from dovetail.rpc import dovetail_pb2 as pb

Part = TypeVar("Part", bound=ArrayFacts)


def write_robot(robot: Robot, message: pb.RobotModel) -> None:
    """Put a robot into an empty message."""
    message.name = robot.name
    arrays: dict[str, Any] = {
        name: array.ravel().tolist() for name, array in robot.arrays().items()
    }
    message.MergeFrom(pb.RobotModel(**arrays))
    if robot.payload is not None:
        message.payload.mass = robot.payload.mass
        message.payload.com.extend(robot.payload.com.tolist())
        message.payload.inertia.extend(robot.payload.inertia.ravel().tolist())


def read_robot(message: pb.RobotModel) -> Robot:
    """Return a message's robot.

    Raises:
        ConfigError: It is none, see `Robot`.
    """
    sent = {field.name: value for field, value in message.ListFields()}

    def part(kind: type[Part]) -> Part:
        shapes = kind.shapes.items()
        return kind(**{name: _shaped(sent.get(name, ()), n) for name, n in shapes})

    payload = None
    if message.HasField("payload"):
        payload = Payload(
            mass=message.payload.mass,
            com=np.array(message.payload.com),
            inertia=_shaped(message.payload.inertia, (3, 3)),
        )
    return Robot(
        name=message.name,
        geometry=part(Geometry),
        links=part(Links),
        limits=part(RobotLimits),
        motors=part(Motors),
        payload=payload,
    )


def _shaped(values: Any, shape: tuple[int, ...]) -> Any:
    array = np.array(values, dtype=float)
    if array.size == np.prod(shape):
        return array.reshape(shape)
    return array  # Robot says what is wrong with its shape
