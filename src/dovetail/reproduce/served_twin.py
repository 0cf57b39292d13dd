"""A twin behind a simulated cabinet in lockstep: the stand-in for the robot.

The cabinet has a process of its own, which ends with the one that opened it.
"""

import json
import multiprocessing
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dovetail.errors import ConfigError, DovetailError, PlantError
from dovetail.files import write_atomic
from dovetail.reading import read_json

if TYPE_CHECKING:
    pass

PORTS = "cabinet.json"
_HOST = "127.0.0.1"
_ABOVE = 0.06
"""Height of the start over the hole [m]."""
_PATIENCE = 120.0
"""Longest wait of cabinet and learner for each other [s]: a learner compiles first."""
_STARTS = 60.0
"""Longest wait for the cabinet to start [s]."""


@contextmanager
def serve_twin(
    file: Path,
    folder: Path,
    *,
    hole: Sequence[float],
    period: float,
    **scene: Any,
) -> Iterator[str]:
    """Yield the address of an arm, the twin behind FRI.

    The ports are chosen once and kept in `folder`: a training that is resumed finds the
    arm at the address at which it was started.

    Args:
        file: The twin's file.
        folder: Where the ports are noted.
        hole: x y z [m] of the hole's mouth and yaw [rad], world axes.
        period: Control period [s].
        scene: Peg and clearance, see `PegInHole`.

    Raises:
        ConfigError: A port has been taken meanwhile.
        PlantError: The cabinet does not start.
    """
    client, control = _ports(folder / PORTS)
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    settings = {"hole": tuple(hole), "period": period, "scene": scene}
    process = context.Process(
        target=_serve, args=(str(file), client, control, settings, theirs), daemon=True
    )
    process.start()
    theirs.close()
    try:
        _await_start(ours, (client, control), folder / PORTS)
        yield (
            f"fri://{_HOST}:{client}?period={1e3 * period:g}ms&clock=lockstep"
            f"&control={_HOST}:{control}&timeout={_PATIENCE:g}s"
        )
    finally:
        ours.close()
        process.join(10.0)
        if process.is_alive():
            process.kill()


def _ports(path: Path) -> tuple[int, int]:
    """Return the client's UDP port and the cabinet's control port."""
    if not path.exists():
        free = {
            "client": _free(socket.SOCK_DGRAM),
            "control": _free(socket.SOCK_STREAM),
        }
        write_atomic(path, json.dumps(free) + "\n")
    kept = read_json(path)
    try:
        return int(kept["client"]), int(kept["control"])
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path} is damaged: remove it") from error


def _free(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind((_HOST, 0))
        return probe.getsockname()[1]


def _await_start(channel: Connection, ports: tuple[int, int], kept: Path) -> None:
    if not channel.poll(_STARTS):
        raise PlantError(f"the cabinet says nothing for {_STARTS:g} s")
    try:
        problem = channel.recv()
    except EOFError as error:
        raise PlantError("the cabinet ended while it started") from error
    if problem:
        raise ConfigError(
            f"the cabinet cannot start at the ports {ports[0]} and {ports[1]} that "
            f"{kept} names ({problem}): end the program that has them, and resume"
        )


def _serve(
    file: str, client: int, control: int, settings: dict[str, Any], channel: Connection
) -> None:
    """Run the cabinet until the other end of the channel is closed."""
    import numpy as np

    from dovetail.cabinet.cabinet import Cabinet
    from dovetail.cabinet.config import CabinetConfig, Endpoint
    from dovetail.envs.registered import find_cell
    from dovetail.plants.twin import load_twin, make_twin
    from dovetail.poses import Pose, quat_about_z, tool_down

    x, y, z, yaw = settings["hole"]
    cell = find_cell(**settings["scene"])
    plant = make_twin(load_twin(file), cell)
    above = Pose(np.array([x, y, z + _ABOVE]), tool_down(yaw))
    start = plant.robot.inverse_kinematics(above, plant.robot.posture("down"))
    plant.reset(start, Pose(np.array([x, y, z]), quat_about_z(yaw)))
    config = CabinetConfig(
        period=settings["period"],
        clock="lockstep",
        patience=_PATIENCE,
        client=Endpoint(_HOST, client),
        bind=Endpoint(_HOST, 0),
        control=Endpoint(_HOST, control),
    )
    try:
        cabinet = Cabinet(plant, config)
    except DovetailError as error:
        channel.send(str(error))
        return
    with cabinet, suppress(EOFError):
        channel.send("")
        channel.recv()  # until the other end is closed
    plant.close()
