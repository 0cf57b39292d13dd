"""Pictures for a calibration, taken while any arm stands in one pose after another."""

from collections.abc import Iterator

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState
from dovetail.control.period import POLICY_PERIOD
from dovetail.errors import ConfigError, TrackerError
from dovetail.perceive.camera import Camera
from dovetail.perceive.open_source import open_source
from dovetail.perceive.rehearsal import Shot, board_of, reachable
from dovetail.perceive.sources import ImageSource
from dovetail.plants.twin_camera import TwinCamera
from dovetail.workcell.workcell import Workcell

TASK = "XYZABC:pose"
"""Axes of the arm."""
_SETTLE = 0.5
"""Time for which the arm stands before a picture is exposed [s]."""
_PATIENCE = 5.0
"""Longest wait for a picture, beyond its delay [s]."""


def take_shots(
    camera: Camera,
    arm: Arm,
    cell: Workcell,
    twin: TwinCamera | None,
    count: int,
    seed: int,
) -> Iterator[Shot]:
    """Move an arm from pose to pose, slowly, and take a picture in each.

    Args:
        camera: What is believed of it; a first guess of its place is enough.
        arm: It goes to each pose as to the start of an episode; axes `TASK`.
        cell: What stands there.
        twin: In what a simulated camera differs from its file.
        count: Number of pictures.
        seed: Of the poses and of a simulated camera's noise.

    Raises:
        ConfigError: The arm reaches too few poses in which the camera sees the board,
            or the pictures are simulated and the arm is not.
        TrackerError: No picture comes.
        ArmError: The arm does not arrive.
    """
    if camera.is_simulated and not arm.facts.traits.is_simulated:
        raise ConfigError(
            "the pictures of this camera are simulated, and this arm is not: give the "
            "file another source, device:NUMBER"
        )
    source = open_source(camera, cell, twin)
    try:
        yield from _go_through(arm, source, camera, cell, count, seed)
    finally:
        source.close()


def _go_through(
    arm: Arm,
    source: ImageSource,
    camera: Camera,
    cell: Workcell,
    count: int,
    seed: int,
) -> Iterator[Shot]:
    rng, margin = np.random.default_rng(seed), 2.0 * arm.facts.limits.delta_x
    for number in range(count):
        q = reachable(camera, cell, rng, margin=margin)
        state = arm.reset(q, cell.place)
        try:
            source.reset(board_of(camera, cell, state.q), seed + number)
            shot = _stand(arm, source, camera, cell, state)
        except Exception:
            arm.stop()
            raise
        yield shot


def _stand(
    arm: Arm, source: ImageSource, camera: Camera, cell: Workcell, state: ArmState
) -> Shot:
    """Hold the arm where it is until a picture of that comes."""
    target = _core.Target(
        position_d=state.tool.position.copy(), quat_wxyz_d=state.tool.quat_wxyz.copy()
    )
    wait = _SETTLE + camera.delay + _PATIENCE
    for _ in range(round(wait / POLICY_PERIOD)):
        state = arm.step(target, POLICY_PERIOD)
        frame = source.look(board_of(camera, cell, state.q), state)
        if frame is not None and state.stamp - frame.age >= _SETTLE:
            return Shot(frame.picture, state.q)
    raise TrackerError(
        f"no picture came in {wait:.1f} s: is the camera plugged in, and free?"
    )
