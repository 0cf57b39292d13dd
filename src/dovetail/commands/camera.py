"""`dovetail camera`: print a board, calibrate lens and place, watch what is seen."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track

from dovetail.commands.camera_result import decide, now
from dovetail.commands.hand_eye import CameraHandEye
from dovetail.commands.unproven import note_cell
from dovetail.doctor.camera import standing
from dovetail.envs.pre_grasp_view import LOOKOUT
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, TrackerError
from dovetail.files import require_new, write_atomic
from dovetail.plants.twin import load_twin
from dovetail.poses import TOOL_DOWN, Pose
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.settings import in_count
from dovetail.workcell.cell_config import CellFile

if TYPE_CHECKING:
    from dovetail.perceive.camera import Camera as CameraFile
    from dovetail.perceive.detect import Detection
    from dovetail.plants.twin_camera import TwinCamera
    from dovetail.trackers.tracker import Estimate

_PICTURES_MAX = 1_000_000


@dataclass(frozen=True, kw_only=True)
class CameraBoard:
    """Write a board to print in true size: eight markers round the opening."""

    out: Path = Path("board.pdf")
    """File to write, .pdf (a page of A4) or .svg; not overwritten."""
    first_id: int = 0
    """Number of its first marker; two boards in one cell differ by 8 or more."""
    side: float = 0.100
    """Outer side [m]."""

    def run(self, console: Console) -> int:
        """Write it, and say what to measure on the paper."""
        from dovetail.perceive.board import Board

        board = Board(first_id=self.first_id, side=self.side)
        file = require_new(self.out)
        if file.suffix not in (".pdf", ".svg"):
            raise ConfigError(f"{file} is neither .pdf nor .svg")
        write_atomic(file, board.pdf() if file.suffix == ".pdf" else board.svg())
        console.print(
            f"{file}: {board.title}; cut out the inner square, glue it round the "
            "opening with its x along the fixture's",
            soft_wrap=True,
            highlight=False,
        )
        return 0


@dataclass(frozen=True, kw_only=True)
class CameraIntrinsics:
    """Find a lens from pictures of a board, and say how sure that is."""

    pictures: Annotated[Path, tyro.conf.Positional]
    """Folder with 20 pictures of one board: tilted, and in every corner."""
    out: Path = Path("camera.toml")
    """Camera file to write; not overwritten. Its place is found by hand-eye."""
    first_id: int = 0
    """Number of the board's first marker."""
    side: float = 0.100
    """Outer side of the board, as measured [m]."""

    def run(self, console: Console) -> int:
        """Fit, and write where it is good enough."""
        from dovetail.perceive.board import Board
        from dovetail.perceive.camera import Camera, Lens
        from dovetail.perceive.detect import DetectionFailure, Detector, explain
        from dovetail.perceive.intrinsics import fit_lens
        from dovetail.perceive.picture import read_picture
        from dovetail.perceive.sources import Folder

        file = require_new(self.out)
        board = Board(first_id=self.first_id, side=self.side)
        corners, points, shape = [], [], (0, 0)
        for path in track(Folder(self.pictures).files, "pictures", console=console):
            picture = read_picture(path)
            shape = shape if any(shape) else picture.shape
            if picture.shape != shape:
                raise ConfigError(
                    f"{path} has {picture.shape[1]} x {picture.shape[0]} pixels, the "
                    f"first one {shape[1]} x {shape[0]}; take all at one resolution"
                )
            guess = Lens.ideal(shape[1], shape[0], 1.2 * max(shape))
            detector = Detector(board, guess)
            seen = detector.find_corners(picture)
            if isinstance(seen, DetectionFailure):
                reason = explain(detector, picture, seen)
                console.print(f"{path.name}: {reason}", soft_wrap=True)
                continue
            corners.append(seen.seen)
            points.append(seen.points)
        fit = fit_lens(corners, points, shape[1], shape[0])
        lens = fit.lens
        (fx, fy), (cx, cy), (dx, dy, mx, my) = lens.focal, lens.centre, lens.deviation
        console.print(
            f"focal lengths {fx:.1f} +- {1.96 * dx:.1f}, {fy:.1f} +- {1.96 * dy:.1f}; "
            f"centre {cx:.1f} +- {1.96 * mx:.1f}, {cy:.1f} +- {1.96 * my:.1f} pixels "
            f"(95 %)\n{len(corners)} pictures, corners {fit.error:.3f} pixels off"
            + (f"; {' and '.join(fit.fixed)} not told, 0" if fit.fixed else ""),
            highlight=False,
        )
        camera = Camera(
            lens=lens,
            mount="world",
            position=(0.0, 0.0, 0.0),
            rotation=(1.0, 0.0, 0.0, 0.0),
            edge_noise=fit.edge_noise,
            source="device:0",
            board=board,
            made_by="dovetail camera intrinsics",
            made_on=now(),
        )
        return decide(console, fit.objections(), file, camera)


@dataclass(frozen=True, kw_only=True)
class CameraWatch:
    """Say for each picture where the fixture is and how sure, or why it is not seen."""

    camera: Annotated[Path, tyro.conf.Positional]
    """Camera file."""
    count: int = 0
    """Pictures to look at; 0 goes on until Ctrl-C, or the end of a folder."""
    twin: str | None = None
    """Twin whose file says what a simulated camera has wrong. Default the one with
    which it was calibrated: another, that has it elsewhere, is refused."""
    robot: str = DEFAULT_ROBOT
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION.
    A camera on its flange looks from above the fixture."""
    cell: CellFile = None
    """Cell file: table, tool, walls, and where a simulated fixture stands."""

    def run(self, console: Console) -> int:
        """Look, a line for each picture; return 1 where the board was never seen.

        Raises:
            DovetailError: No such camera or twin, or no simulated one for a twin.
        """
        from dovetail.perceive.camera import load_camera
        from dovetail.perceive.detect import DetectionFailure, Detector, explain
        from dovetail.perceive.open_source import open_source
        from dovetail.trackers.marker import locate

        in_count("count", self.count, 0, _PICTURES_MAX, "pictures")
        camera = load_camera(self.camera)
        cell = find_cell(robot=self.robot, cell=self.cell)
        note_cell(console, cell, None)
        if self.twin is not None and not camera.is_simulated:
            raise ConfigError(f"twin is given, and the pictures are of {camera.source}")
        twin = None if self.twin is None else load_twin(self.twin).camera
        detector = Detector(camera.board, camera.lens, camera.edge_noise)
        source, seen_once, number = open_source(camera, cell, twin), False, 0
        is_placed = self._is_placed(camera, twin, console)
        above = cell.place.position + np.array([0.0, 0.0, LOOKOUT])
        above[2] = min(above[2], cell.walls[1][2])
        robot, usual = cell.loaded_robot(), cell.robot.posture("down")
        q = robot.inverse_kinematics(Pose(above, TOOL_DOWN), usual)
        try:
            while number < self.count or not self.count:
                number += 1
                frame = source.look(cell.place, standing(q, number / camera.rate))
                if frame is None:
                    continue
                sight = detector.find(frame.picture)
                if isinstance(sight, DetectionFailure):
                    line = explain(detector, frame.picture, sight)
                else:
                    seen_once = True
                    told = locate(camera, sight, cell.robot, q)
                    line = describe_sight(sight, told if is_placed else None)
                console.print(f"{number}: {line}", highlight=False, soft_wrap=True)
        except TrackerError as error:
            console.print(str(error), soft_wrap=True)
        finally:
            source.close()
        return int(not seen_once)

    def _is_placed(
        self, camera: "CameraFile", twin: "TwinCamera | None", console: Console
    ) -> bool:
        """Say whether the camera's place is known, and what follows where it is not."""
        is_exact = twin is None or not any(twin.numbers())
        try:
            camera.require_calibrated(is_exact=is_exact)
        except ConfigError as error:
            console.print(
                f"{error}. Until then places are in the camera's frame: x right, y "
                "down, z ahead",
                soft_wrap=True,
                highlight=False,
            )
            return False
        return True


def describe_sight(sight: "Detection", told: "Estimate | None") -> str:
    """Return where the fixture is, and how sure, for a person.

    Args:
        sight: What one picture says.
        told: Where that is in the world; None is said in the camera's frame.
    """
    pose, covariance = sight.pose, sight.covariance
    if told is not None and told.covariance is not None:
        pose, covariance = told.pose, told.covariance
    x, y, z = 1e3 * pose.position
    sure = 1.96e3 * np.sqrt(np.diag(covariance)[:3].max())
    frame = "" if told is not None else "in the camera "
    return (
        f"{frame}x {x:.2f} y {y:.2f} z {z:.2f} mm +- {sure:.2f} (95 %), "
        f"{len(sight.ids)} markers, edges {sight.error:.3f} pixels off"
    )


Camera = (
    Annotated[CameraBoard, tyro.conf.subcommand("board")]
    | Annotated[CameraIntrinsics, tyro.conf.subcommand("intrinsics")]
    | Annotated[CameraHandEye, tyro.conf.subcommand("hand-eye")]
    | Annotated[CameraWatch, tyro.conf.subcommand("watch")]
)
