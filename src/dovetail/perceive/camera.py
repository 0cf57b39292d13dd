"""A camera: its lens, where it sits, how late and how noisy it is; one file for all.

Camera frames are OpenCV's: x to the right of the picture, y down, z ahead. A pixel's
middle has whole coordinates. ``T_mount_camera`` maps camera coordinates into those of
what it is mounted on, the world or the arm's flange.
"""

from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import tomlkit
from pydantic import model_validator

from dovetail.errors import ConfigError
from dovetail.perceive.board import Board
from dovetail.perceive.camera_parts import CameraOrigin, CameraPictures, CameraPlace
from dovetail.poses import Pose
from dovetail.reading import read_toml
from dovetail.settings import Range, defaults_of, names_in, settings, values_of
from dovetail.types import Array, Mat33

PIXELS = Range(16, 20_000, "pixels")
DISTORTION = Range(-5.0, 5.0, "1", ("k1", "k2", "p1", "p2", "k3"))
"""Note on what is given as a whole: its numbers have no flat names."""
_TWIN = "?twin="
_AXES = tuple("xy")


@settings(owner="lens")
class Lens:
    """A pinhole with the distortion k1 k2 p1 p2 k3 of Brown's model, as OpenCV has."""

    width: Annotated[int, PIXELS]
    """Width of a picture [pixels]."""
    height: Annotated[int, PIXELS]
    """Height of a picture [pixels]."""
    focal: Annotated[tuple[float, float], Range(1.0, 1e5, "pixels", ("x", "y"))]
    """Focal lengths [pixels]."""
    centre: Annotated[tuple[float, float], Range(-1e4, 3e4, "pixels", ("x", "y"))]
    """Point where the optical axis meets the picture [pixels]."""
    distortion: Annotated[tuple[float, ...], DISTORTION] = (0.0,) * 5
    """Radial and tangential distortion [1]."""
    deviation: Annotated[
        tuple[float, ...], Range(0.0, 1e4, "pixels", ("fx", "fy", "cx", "cy"))
    ] = (0.0,) * 4
    """Standard deviations of focal lengths and centre [pixels]; 0 is unknown."""

    @model_validator(mode="after")
    def _check_lens(self) -> Self:
        """Refuse a lens that there is not."""
        for middle, size, name in zip(
            self.centre, (self.width, self.height), _AXES, strict=True
        ):
            if not 0.0 < middle < size:
                raise ConfigError(
                    f"lens centre[{name}] is {middle:g} pixels, outside of a picture "
                    f"of {size} pixels; give both for the same resolution"
                )
        return self

    def matrix(self) -> Mat33:
        """Return the matrix K of the pinhole."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def coefficients(self) -> Array:
        """Return the distortion as OpenCV takes it, shape (5,)."""
        return np.array(self.distortion)

    @classmethod
    def ideal(cls, width: int, height: int, focal: float) -> Self:
        """Return a pinhole whose axis meets the middle of the picture."""
        middle = ((width - 1) / 2.0, (height - 1) / 2.0)
        return cls(width=width, height=height, focal=(focal, focal), centre=middle)


@settings()
class Camera(CameraPlace, CameraPictures, CameraOrigin):
    """Everything that is known of a camera, and how well.

    Lens and board are tables of a camera's file.
    """

    lens: Lens
    """Its lens."""
    board: Board = field(default_factory=Board)
    """Board that it looks for."""

    @property
    def pose(self) -> Pose:
        """The camera in its mount's frame."""
        return Pose(np.array(self.position), np.array(self.rotation))

    @property
    def is_simulated(self) -> bool:
        """True if its pictures are rendered."""
        return self.source.partition(":")[0] == "simulated"

    @property
    def twin(self) -> str:
        """The twin with which a simulated camera was calibrated; empty is none."""
        return self.source.partition(_TWIN)[2] if self.is_simulated else ""

    @property
    def is_calibrated(self) -> bool:
        """True if its place was measured: no calibration has deviations of 0."""
        return any(self.deviation)

    def calibrated_from(self, path: Path, twin: str | None) -> "Camera":
        """Return the camera with the source from which it can be drawn again.

        Args:
            path: The file of what was believed of a simulated camera.
            twin: Twin of the calibration, a name or the path of a file.
        """
        if not self.is_simulated:
            return self
        first = self.source.partition(_TWIN)[0].partition(":")[2]
        source = f"simulated:{first or path.expanduser().absolute()}"
        if twin is not None:
            is_file = Path(twin).suffix == ".toml"
            name = Path(twin).expanduser().absolute() if is_file else twin
            source += f"{_TWIN}{name}"
        return replace(self, source=source)

    def as_it_is(self) -> "Camera":
        """Return the simulated camera that this file is a calibration of, or itself.

        Raises:
            ConfigError: Its file is not there, or is of no simulated camera.
        """
        path = self.source.partition(_TWIN)[0].partition(":")[2]
        if not path:
            return self
        camera = load_camera(path)
        if camera.source != "simulated":
            raise ConfigError(
                f"camera file {path} is to be of a simulated camera and has the source "
                f"{camera.source!r}"
            )
        return replace(camera, mount=self.mount)

    def covariance(self) -> Array:
        """Return that of position [m] and rotation vector [rad], shape (6, 6)."""
        scale, rows = np.array(self.deviation), self.correlation
        R = np.array(rows) if rows else np.eye(6)
        return R * np.outer(scale, scale)

    def require_calibrated(self, *, is_exact: bool = False) -> None:
        """Refuse a camera whose place was not measured.

        Args:
            is_exact: Whether it is simulated, and just where its file says.

        Raises:
            ConfigError: The deviations are all 0, which no calibration gives.
        """
        if self.is_calibrated or (is_exact and self.source == "simulated"):
            return
        raise ConfigError(
            "this camera is not calibrated: its deviations are 0; run `dovetail camera "
            "hand-eye`, of a simulated camera with the same --twin, and use the file "
            "that it writes"
        )

    def to_toml(self) -> str:
        """Write the camera as the text of a file that `load_camera` reads."""
        table = values_of(self) | {
            "lens": values_of(self.lens),
            "board": values_of(self.board),
        }
        return tomlkit.dumps({n: v for n, v in table.items() if v not in ("", ())})


def load_camera(path: str | Path) -> Camera:
    """Read a camera file.

    Raises:
        ConfigError: No such file, no TOML, an unknown or missing key, or a value out of
            range; names the file.
    """
    path = Path(path).expanduser()
    try:
        table = read_toml(path)
    except OSError as error:
        raise ConfigError(
            f"no camera file {str(path)!r} ({error.strerror}); `dovetail camera "
            "hand-eye` writes one"
        ) from error
    except ConfigError as error:
        raise ConfigError(f"camera file {error}") from error
    try:
        lens = Lens(**_known(Lens, table.pop("lens", None), "lens"))
        board = Board(**_known(Board, table.pop("board", {}), "board"))
        known = _known(Camera, table, "camera", given=("lens", "board"))
        return Camera(lens=lens, board=board, **known)
    except ConfigError as error:
        raise ConfigError(f"camera file {path}: {error}") from error
    except TypeError as error:  # a value that is no number, or a row that is none
        raise ConfigError(f"camera file {path}: {error}") from error


def _known(
    kind: type, table: Any, name: str, given: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return the keys of a table, or say which are unknown or missing."""
    if not isinstance(table, dict):
        raise ConfigError(f"the table [{name}] is missing; calibrate the camera first")
    known = set(names_in(kind)) - set(given)
    needed = known - set(defaults_of(kind))
    unknown, missing = sorted(set(table) - known), sorted(needed - set(table))
    if unknown or missing:
        raise ConfigError(
            f"[{name}] has unknown keys: {', '.join(unknown) or 'none'}; missing keys: "
            f"{', '.join(missing) or 'none'}; known: {', '.join(sorted(known))}"
        )
    return table
