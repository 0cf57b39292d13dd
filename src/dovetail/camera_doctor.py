"""Open a camera, move the arm that it is used with, and check what it shows."""

from collections.abc import Callable, Iterator

import numpy as np

from dovetail.arms.arm import Arm
from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.arms.local_address import PlantAddress
from dovetail.camera_checks import (
    AMPLITUDE,
    TASK,
    Watched,
    check_camera,
    standing,
    watch_moving,
    watch_still,
)
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor import Check
from dovetail.envs.arm_setup import build_arm
from dovetail.envs.config import EnvConfig
from dovetail.errors import ConfigError
from dovetail.perceive.camera import Camera
from dovetail.perceive.open_source import open_source
from dovetail.perceive.rehearsal import FIXTURE, board_of, viewpoint
from dovetail.perceive.sources import ImageSource
from dovetail.plants.twin import load_twin
from dovetail.workcell.workcell import Workcell

_MOVED = (
    "The arm will be held where it stands and its tool moved by up to "
    f"{2e3 * AMPLITUDE:g} mm to and fro, the board in sight"
)


def run_camera_checks(
    camera: Camera,
    address: ArmAddress | None,
    cell: Workcell,
    ask: Callable[[str], bool] | None,
    period: float,
) -> Iterator[Check]:
    """Yield every check of a camera.

    Args:
        camera: What its file says.
        address: The arm that is moved for its delay; None is a simulated one for a
            simulated camera, and none for any other.
        cell: What stands there.
        ask: Asks before a real arm is moved; after a no the delay is not measured. With
            None the arm is moved without asking.
        period: Control period of a simulated arm [s].

    Raises:
        ConfigError: A recording, which has no time; or an arm that cannot be moved.
        DovetailError: Camera or arm cannot be had.
    """
    if camera.source.startswith("folder:"):
        raise ConfigError(
            f"{camera.source} is a recording: it has no rate and no delay; "
            "give the file the source device:NUMBER"
        )
    if address is None and camera.is_simulated:
        address = PlantAddress(engine="mujoco")
    if address is not None:
        _require_movable(camera, address)
    twin = load_twin(address.twin).camera if address and address.twin else None
    source = open_source(camera, cell, twin)
    try:
        if address is not None and (address.is_here or ask is None or ask(_MOVED)):
            yield from check_camera(
                camera, _watch_with_arm(camera, address, cell, period, source)
            )
            return
        watched = watch_still(source, FIXTURE, standing(cell.robot.posture("down")))
        yield from check_camera(camera, watched)
        lacks = "give --arm ADDRESS: " if address is None else "the arm was not moved: "
        words = f"{lacks}it is measured by moving the arm"
        yield Check("delay", "missing", words, is_essential=False)
    finally:
        source.close()


def _require_movable(camera: Camera, address: ArmAddress) -> None:
    if not (address.is_here or isinstance(address, FriAddress)):
        raise ConfigError(
            "the doctor moves arms behind FRI and simulated ones; run it where the arm "
            "is served, with --arm fri://HOST:PORT?KEY=VALUE&..."
        )
    if camera.is_simulated and not address.is_here:
        raise ConfigError(
            "the pictures of this camera are simulated, and the arm is elsewhere: give "
            "--arm twin:NAME, or a camera file with the source device:NUMBER"
        )


def _watch_with_arm(
    camera: Camera,
    address: ArmAddress,
    cell: Workcell,
    period: float,
    source: ImageSource,
) -> Watched:
    arm = build_arm(address, cell, TaskSpec.parse(TASK), EnvConfig(period=period))
    try:
        q = _begin(arm, camera, cell)
        return watch_moving(arm, source, q, lambda q: board_of(camera, cell, q))
    finally:
        arm.close()


def _begin(arm: Arm, camera: Camera, cell: Workcell) -> np.ndarray:
    """Return where the motion begins [rad]: a real arm stays where it stands."""
    if isinstance(arm, FriArm):
        arm.connect()
        return arm.monitoring().q
    return viewpoint(camera, cell)
