"""The parts of a camera: its place, its pictures and where its file is from."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import model_validator

from dovetail.errors import ConfigError
from dovetail.poses import quat_normalized
from dovetail.settings import Range, fill_in, settings

_AXES = tuple("xyz")
_SIX = tuple(f"{what} {axis}" for what in ("shift", "turn") for axis in _AXES)


@settings(owner="camera")
class CameraPlace:
    """Place of a camera on its mount, and its uncertainty."""

    mount: Literal["world", "flange"]
    """Body that it is fixed to."""
    position: Annotated[tuple[float, float, float], Range(-10.0, 10.0, "m", _AXES)]
    """T_mount_camera: the camera's origin in its mount's frame [m]."""
    rotation: Annotated[
        tuple[float, float, float, float], Range(-1.0, 1.0, "1", tuple("wxyz"))
    ]
    """T_mount_camera: its rotation (wxyz) in its mount's frame."""
    deviation: Annotated[tuple[float, ...], Range(0.0, 1.0, "m, rad", _SIX)] = (
        0.0,
    ) * 6
    """Standard deviations of position [m] and rotation vector [rad], mount's axes."""
    correlation: tuple[tuple[float, ...], ...] = ()
    """Correlation of these six, rows; empty is none."""

    @model_validator(mode="after")
    def _check_camera_place(self) -> Self:
        """Refuse a number out of range, and what is no correlation."""
        quat = quat_normalized(np.array(self.rotation))
        rows = tuple(tuple(map(float, row)) for row in self.correlation)
        fill_in(self, rotation=tuple(quat.tolist()), correlation=rows)
        if rows and not _is_correlation(rows):
            raise ConfigError(
                "camera correlation is not 6 rows of 6 numbers, 1 on the diagonal, "
                "symmetric and positive; leave it out or calibrate again"
            )
        return self


@settings(owner="camera")
class CameraPictures:
    """Source, rate, delay and noise of a camera's pictures."""

    edge_noise: Annotated[float, Range(0.005, 5.0, "pixels")] = 0.05
    """Standard deviation of the place of a marker's edge in a picture [pixels]."""
    rate: Annotated[float, Range(0.1, 1000.0, "1/s")] = 30.0
    """Pictures per second."""
    delay: Annotated[float, Range(0.0, 5.0, "s")] = 0.05
    """Age of a picture when it can be used [s]."""
    source: str = "simulated"
    """Source of the pictures: simulated, device:NUMBER or folder:PATH. For a simulated
    camera that was calibrated, simulated:PATH?twin=NAME: the file that describes it as
    believed, and the twin whose file holds its errors."""


@settings()
class CameraOrigin:
    """Origin of a camera's file."""

    made_by: str = ""
    """Command that made this."""
    made_on: str = ""
    """Time of that."""


def _is_correlation(rows: tuple[tuple[float, ...], ...]) -> bool:
    if [len(row) for row in rows] != [6] * 6:
        return False
    R = np.array(rows)
    is_whole = np.isfinite(R).all() and np.allclose(np.diag(R), 1.0, atol=1e-6)
    return bool(
        is_whole
        and np.allclose(R, R.T, atol=1e-6)
        and np.linalg.eigvalsh(R).min() > -1e-6
    )
