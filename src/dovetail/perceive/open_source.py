"""Pictures as a camera's file names them: simulated, of a device or of a folder."""

from pathlib import Path
from typing import TYPE_CHECKING

from dovetail.errors import ConfigError
from dovetail.perceive.camera import Camera
from dovetail.perceive.simulated import Simulated
from dovetail.perceive.sources import Device, Folder, ImageSource
from dovetail.plants.twin import load_twin
from dovetail.plants.twin_camera import TwinCamera

if TYPE_CHECKING:
    from dovetail.workcell.workcell import Workcell


def open_source(
    camera: Camera, cell: "Workcell", twin: "TwinCamera | None" = None
) -> ImageSource:
    """Open the pictures of a camera.

    Args:
        camera: Its `source` is simulated, device:NUMBER or folder:PATH.
        cell: What a simulated one looks at.
        twin: In what a simulated one differs from its file. None is what the file
            names itself, the twin of its calibration.

    Raises:
        ConfigError: No such source, or a calibration with another twin.
    """
    kind, _, rest = camera.source.partition(":")
    if camera.is_simulated:
        return Simulated(camera.as_it_is(), cell, twin_of(camera, twin))
    if kind == "folder" and rest:
        return Folder(Path(rest).expanduser(), camera.delay)
    if kind == "device" and rest.isdecimal():
        lens = camera.lens
        return Device(int(rest), lens.width, lens.height, camera.delay)
    raise ConfigError(
        f"camera source {camera.source!r} is unknown; known: simulated, "
        "device:NUMBER, folder:PATH"
    )


def twin_of(camera: Camera, twin: "TwinCamera | None") -> "TwinCamera | None":
    """Return in what a simulated camera differs from its file.

    Args:
        camera: Its source may name the twin of its calibration.
        twin: What else is known of it; None is nothing.

    Raises:
        ConfigError: The two put the camera in different places.
    """
    own = load_twin(camera.twin).camera if camera.twin else None
    if twin is None or camera.source == "simulated":
        return twin or own
    if twin != (own or TwinCamera()):
        with_what = f"twin {camera.twin}" if camera.twin else "no twin"
        raise ConfigError(
            f"the camera was calibrated with {with_what}, and the twin that is given "
            "has it elsewhere: give the same one or none, or calibrate again with "
            "`dovetail camera hand-eye ... --twin` and that one"
        )
    return twin
