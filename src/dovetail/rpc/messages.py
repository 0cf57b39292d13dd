"""Poses, Targets and states in messages: doubles go through unchanged."""

import math
from typing import TYPE_CHECKING

import numpy as np

from dovetail import _core
from dovetail.arms.arm import ArmState, ToolState
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.poses import Pose
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.fields import LENGTH_TOLERANCE, PLANE, TASK_AXES, XYZ, FieldReader
from dovetail.types import JOINTS, Array, Vec7

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot

DURATION_MAX = 10.0
"""Longest step [s]: a learner that asks for more has mistaken the unit."""

AGE_MAX = 1e9
"""Oldest Target that a controller takes [s]."""
STAY_MAX = 7
"""Mask of X, Y and Z."""

_ROW = np.dtype("<f8")
_COLUMNS = len(CYCLE_COLUMNS)


def write_target(target: _core.Target, message: pb.Target) -> None:
    """Put a Target into an empty message."""
    message.f_star.extend(target.f_star.tolist())
    message.position_d.extend(target.position_d.tolist())
    message.quat_wxyz_d.extend(target.quat_wxyz_d.tolist())
    message.near_plane.extend(target.near_plane.tolist())
    velocity, acceleration = target.velocity_d.tolist(), target.acceleration_d.tolist()
    if any(velocity) or any(acceleration):
        message.velocity_d.extend(velocity)
        message.acceleration_d.extend(acceleration)
    if any(tare := target.f_tare.tolist()):
        message.f_tare.extend(tare)
    message.age, message.stay = target.age, target.stay
    if target.joint_mode:
        message.q_d.extend(target.q_d.tolist())


def read_target(message: pb.Target, fields: FieldReader) -> _core.Target:
    """Return a message's Target; wrong fields go to the reader."""
    target = _core.Target(
        f_star=fields.vector(
            "target.f_star", message.f_star, TASK_AXES, "m/s2 or rad/s2"
        ),
        position_d=fields.vector("target.position_d", message.position_d, XYZ, "m"),
        quat_wxyz_d=fields.rotation("target.quat_wxyz_d", message.quat_wxyz_d),
    )
    if message.near_plane:
        target.near_plane = _read_plane(message.near_plane[:], fields)
    for name, values, unit in (
        ("velocity_d", message.velocity_d, "m/s or rad/s"),
        ("acceleration_d", message.acceleration_d, "m/s2 or rad/s2"),
        ("f_tare", message.f_tare, "m/s2 or rad/s2"),
    ):
        if values:
            path = f"target.{name}"
            setattr(target, name, fields.vector(path, values, TASK_AXES, unit))
    target.age = fields.scalar("target.age", message.age, "s", (0.0, AGE_MAX))
    stay = fields.scalar("target.stay", message.stay, "1", (0, STAY_MAX))
    target.stay = min(int(stay), STAY_MAX)
    if message.q_d:
        target.q_d = fields.vector("target.q_d", message.q_d, JOINTS, "rad")
        target.joint_mode = True
    return target


def _read_plane(values: list[float], fields: FieldReader) -> Array:
    """Return unit normal and offset; only the offset may be infinite, and only below.

    A plane that is nowhere may have any normal.
    """
    is_nowhere = len(values) == 4 and values[3] == -math.inf
    finite = [*values[:3], 0.0] if is_nowhere else values
    plane = fields.vector("target.near_plane", finite, PLANE, "1 or m")
    length = sum([x * x for x in values[:3]])
    if is_nowhere:
        plane[3] = -math.inf
    elif np.isfinite(plane).all() and abs(length - 1.0) > LENGTH_TOLERANCE:
        said = f"with a normal of length {math.sqrt(length):.6g}"
        fields.refuse("target.near_plane", said, "length 1")
    return plane


def read_duration(message: pb.StepRequest, period: float, fields: FieldReader) -> float:
    """Return a step's duration [s], a whole number of control periods."""
    duration = fields.number("duration", message, "duration", "s")
    cycles = round(duration / period) if abs(duration) <= DURATION_MAX else 0
    if math.isfinite(duration) and (
        cycles < 1 or abs(cycles * period - duration) > 1e-9  # as arms have it
    ):
        fields.refuse(
            "duration",
            f"{duration} s, which is not a whole number of control periods of "
            f"{period} s",
            f"{period:g} to {DURATION_MAX:g} s",
        )
    return duration


def write_pose(pose: Pose, message: pb.Pose) -> None:
    """Put a pose into an empty message."""
    message.position.extend(np.asarray(pose.position, dtype=float).tolist())
    message.quat_wxyz.extend(np.asarray(pose.quat_wxyz, dtype=float).tolist())


def read_pose(path: str, message: pb.Pose, fields: FieldReader) -> Pose:
    """Return a message's pose; wrong fields go to the reader."""
    return Pose(
        fields.vector(f"{path}.position", message.position, XYZ, "m"),
        fields.rotation(f"{path}.quat_wxyz", message.quat_wxyz),
    )


def read_configuration(message: pb.ResetRequest, robot: "Robot") -> tuple[Vec7, Pose]:
    """Return where a reset goes: q [rad], inside the robot's limits, and the fixture.

    Raises:
        FieldError: Names every wrong field.
    """
    fields = FieldReader()
    q = fields.vector(
        "q", message.q, JOINTS, "rad", (robot.limits.q_min, robot.limits.q_max)
    )
    fixture = read_pose("fixture", message.fixture, fields)
    fields.finish()
    return q, fixture


def write_state(state: ArmState, message: pb.ArmState) -> None:
    """Put a state into an empty message."""
    message.stamp = state.stamp
    message.q.extend(state.q.tolist())
    message.dq.extend(state.dq.tolist())
    message.position.extend(state.tool.position.tolist())
    message.quat_wxyz.extend(state.tool.quat_wxyz.tolist())
    message.velocity.extend(state.tool.velocity.tolist())
    message.contact_force.extend(state.contact_force.tolist())
    message.wrench.extend(state.wrench.tolist())
    message.parts.extend(state.parts.tolist())
    message.flags = state.flags
    message.log = rows_to_bytes(state.log)


def read_state(message: pb.ArmState) -> ArmState:
    """Return a message's state."""
    # A slice is a list; NumPy reads that four times faster than the field itself.
    return ArmState(
        message.stamp,
        np.array(message.q[:]),
        np.array(message.dq[:]),
        ToolState(
            np.array(message.position[:]),
            np.array(message.quat_wxyz[:]),
            np.array(message.velocity[:]),
        ),
        np.array(message.contact_force[:]),
        np.array(message.wrench[:]),
        message.flags,
        rows_from_bytes(message.log),
        np.array(message.parts[:], dtype=float),
    )


def rows_to_bytes(rows: Array) -> bytes:
    """Return the bytes of a cycle log."""
    return np.ascontiguousarray(rows, dtype=_ROW).tobytes()


def rows_from_bytes(data: bytes) -> Array:
    """Return a cycle log from its bytes, shape (cycles, columns)."""
    return np.frombuffer(bytearray(data), dtype=_ROW).reshape(-1, _COLUMNS)
