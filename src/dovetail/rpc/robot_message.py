"""The controller's model in a message, so that both ends compute with the same."""

from typing import Any

import numpy as np

from dovetail.robots.robot import Payload, Robot, array_shapes
from dovetail.rpc import dovetail_pb2 as pb


def write_robot(robot: Robot, message: pb.RobotModel) -> None:
    """Put a robot into an empty message."""
    message.name = robot.name
    arrays = {name: vars(robot)[name].ravel().tolist() for name in array_shapes()}
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
    arrays: dict[str, Any] = {
        name: _shaped(sent.get(name, ()), shape)
        for name, shape in array_shapes().items()
    }
    payload = None
    if message.HasField("payload"):
        payload = Payload(
            mass=message.payload.mass,
            com=np.array(message.payload.com),
            inertia=_shaped(message.payload.inertia, (3, 3)),
        )
    return Robot(name=message.name, payload=payload, **arrays)


def differences(one: Robot, other: Robot) -> list[str]:
    """Return the names of the fields in which two robots differ."""
    return [
        name
        for name in array_shapes()
        if not np.array_equal(vars(one)[name], vars(other)[name])
    ]


def _shaped(values: Any, shape: tuple[int, ...]) -> Any:
    array = np.array(values, dtype=float)
    if array.size == np.prod(shape):
        return array.reshape(shape)
    return array  # Robot says what is wrong with its shape
