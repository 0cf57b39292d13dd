"""Pictures as a camera's file names them: simulated, of a device or of a folder."""

from pathlib import Path
from typing import TYPE_CHECKING

from dovetail.errors import ConfigError
from dovetail.perceive.camera import Camera
from dovetail.perceive.simulated import Simulated
from dovetail.perceive.sources import Device, Folder, ImageSource

if TYPE_CHECKING:
    from dovetail.plants.twin_camera import TwinCamera
    from dovetail.workcell.workcell import Workcell


def open_source(
    camera: Camera, cell: "Workcell", twin: "TwinCamera | None" = None
) -> ImageSource:
    """Open the pictures of a camera.

    Args:
        camera: Its `source` is simulated, device:NUMBER or folder:PATH.
        cell: What a simulated one looks at.
        twin: In what a simulated one differs from its file.

    Raises:
        ConfigError: No such source.
    """
    kind, _, rest = camera.source.partition(":")
    if camera.is_simulated:
        return Simulated(camera.as_it_is(), cell, twin)
    if kind == "folder" and rest:
        return Folder(Path(rest).expanduser(), camera.delay)
    if kind == "device" and rest.isdecimal():
        lens = camera.lens
        return Device(int(rest), lens.width, lens.height, camera.delay)
    raise ConfigError(
        f"camera source {camera.source!r} is unknown; known: simulated, device:NUMBER, "
        "folder:PATH"
    )
