"""`dovetail camera`: print a board, calibrate lens and place, watch what is seen."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track

from dovetail.camera_checks import standing
from dovetail.control.ranges import in_count
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, TrackerError
from dovetail.files import claim_output_folder, require_new, write_atomic
from dovetail.plants.twin import load_twin
from dovetail.robots.find import DEFAULT_ROBOT, find_robot

if TYPE_CHECKING:
    from dovetail.perceive.camera import Camera as CameraFile
    from dovetail.perceive.detect import Detector
    from dovetail.perceive.hand_eye import HandEye, View
    from dovetail.perceive.rehearsal import Shot

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
        from dovetail.perceive.detect import Blind, Detector, explain
        from dovetail.perceive.intrinsics import fit_lens
        from dovetail.perceive.sources import Folder, read_picture

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
            if isinstance(seen, Blind):
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
            f"(95 %)\n{len(corners)} pictures, corners {fit.error:.3f} pixels off",
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
            made_on=_now(),
        )
        return _decide(console, fit.objections(), file, camera)


@dataclass(frozen=True, kw_only=True)
class CameraHandEye:
    """Find where a camera sits, and say how sure that is: go or no-go."""

    camera: Annotated[Path, tyro.conf.Positional]
    """Camera file with the lens; of a simulated camera its place, too, roughly."""
    out: Path = Path("calibrated.toml")
    """Camera file to write; not overwritten."""
    folder: Path | None = None
    """Pictures with poses.csv: the picture's file, then q1 to q7 [rad]. Default the
    simulated arm goes through poses inside its limits."""
    mount: str | None = None
    """What the camera is fixed to: world (the board is on the flange) or flange.
    Default what its file says."""
    twin: str | None = None
    """Twin whose file says what the simulated camera has wrong."""
    robot: str = DEFAULT_ROBOT
    """Which robot the arm is: one of dovetail's, or MODULE:FUNCTION of your own."""
    count: int = 20
    """Pictures that the simulated arm takes."""
    seed: int = 0
    """Of its poses."""
    keep: Path | None = None
    """Folder, new or empty, for the simulated arm's pictures and poses.csv."""

    def run(self, console: Console) -> int:
        """Calibrate, and write where it is good enough."""
        from dovetail.perceive.camera import load_camera
        from dovetail.perceive.detect import Detector
        from dovetail.perceive.hand_eye import calibrate

        file, camera = require_new(self.out), load_camera(self.camera)
        if self.mount is not None:
            if self.mount not in ("world", "flange"):
                raise ConfigError(f"mount is {self.mount!r}; known: world, flange")
            camera = replace(camera, mount=self.mount)
        detector = Detector(camera.board, camera.lens, camera.edge_noise)
        views = self._views(detector, self._shots(camera, console), console)
        found = calibrate(views, camera.lens, camera.mount)
        _print_hand_eye(console, found, len(views))
        if camera.source == "simulated":
            origin = f"simulated:{self.camera.expanduser().absolute()}"
            camera = replace(camera, source=origin)
        return _decide(console, found.objections(), file, _placed(camera, found))

    def _shots(self, camera: "CameraFile", console: Console) -> "Iterable[Shot]":
        from dovetail.perceive.hand_eye import VIEWS_MIN
        from dovetail.perceive.recorded import keep_shots, read_shots
        from dovetail.perceive.rehearsal import shoot

        if self.folder is not None:
            if self.twin is not None or self.keep is not None:
                raise ConfigError(
                    "folder has pictures that were taken: --twin and --keep are of a "
                    "simulated arm's; leave them out"
                )
            return read_shots(self.folder)
        if not camera.is_simulated:
            raise ConfigError(
                f"the camera's source is {camera.source}: take pictures in 20 poses of "
                "the arm and give their --folder; only a simulated arm moves by itself"
            )
        in_count("count", self.count, VIEWS_MIN, _PICTURES_MAX, "pictures")
        twin = None if self.twin is None else load_twin(self.twin).camera
        cell = find_cell(robot=self.robot)
        shots = shoot(
            replace(camera.as_it_is(), mount=camera.mount),
            cell,
            twin,
            self.count,
            self.seed,
        )
        if self.keep is not None:
            shots = keep_shots(shots, claim_output_folder(self.keep))
        return track(shots, "poses", total=self.count, console=console)

    def _views(
        self, detector: "Detector", shots: "Iterable[Shot]", console: Console
    ) -> "list[View]":
        from dovetail.perceive.detect import Blind, explain
        from dovetail.perceive.hand_eye import View

        robot, views = find_robot(self.robot), []
        for number, shot in enumerate(shots, 1):
            seen = detector.find(shot.picture)
            if isinstance(seen, Blind):
                reason = explain(detector, shot.picture, seen)
                console.print(f"picture {number}: {reason}", soft_wrap=True)
                continue
            flange = robot.tool_pose(shot.q)
            views.append(View(flange, seen.pose, seen.corners, seen.points))
        return views


@dataclass(frozen=True, kw_only=True)
class CameraWatch:
    """Say for each picture where the fixture is and how sure, or why it is not seen."""

    camera: Annotated[Path, tyro.conf.Positional]
    """Camera file."""
    count: int = 0
    """Pictures to look at; 0 goes on until Ctrl-C, or the end of a folder."""
    twin: str | None = None
    """Twin whose file says what a simulated camera has wrong: that with which it was
    calibrated. Without one it is where its first file says."""
    robot: str = DEFAULT_ROBOT
    """Which robot the arm is; a camera on its flange looks from its usual posture."""

    def run(self, console: Console) -> int:
        """Look, a line for each picture; return 1 where the board was never seen.

        Raises:
            DovetailError: No such camera or twin, or no simulated one for a twin.
        """
        from dovetail.perceive.camera import load_camera
        from dovetail.perceive.detect import Blind, Detector, explain
        from dovetail.perceive.open_source import open_source
        from dovetail.perceive.rehearsal import FIXTURE
        from dovetail.trackers.marker import locate

        in_count("count", self.count, 0, _PICTURES_MAX, "pictures")
        camera, cell = load_camera(self.camera), find_cell(robot=self.robot)
        if self.twin is not None and not camera.is_simulated:
            raise ConfigError(f"twin is given, and the pictures are of {camera.source}")
        twin = None if self.twin is None else load_twin(self.twin).camera
        detector = Detector(camera.board, camera.lens, camera.edge_noise)
        source, seen_once, number = open_source(camera, cell, twin), False, 0
        q = cell.robot.posture("down")
        try:
            while number < self.count or not self.count:
                number += 1
                frame = source.look(FIXTURE, standing(q, number / camera.rate))
                if frame is None:
                    continue
                sight = detector.find(frame.picture)
                if isinstance(sight, Blind):
                    line = explain(detector, frame.picture, sight)
                else:
                    seen_once = True
                    pose, _, covariance = locate(camera, sight, cell.robot, q)
                    x, y, z = 1e3 * pose.position
                    sure = np.zeros(6) if covariance is None else np.diag(covariance)
                    line = (
                        f"x {x:.2f} y {y:.2f} z {z:.2f} mm +- "
                        f"{1.96e3 * np.sqrt(sure[:3].max()):.2f} (95 %), "
                        f"{len(sight.ids)} markers, edges {sight.error:.3f} pixels off"
                    )
                console.print(f"{number}: {line}", highlight=False, soft_wrap=True)
        except TrackerError as error:
            console.print(str(error), soft_wrap=True)
        finally:
            source.close()
        return int(not seen_once)


def _print_hand_eye(console: Console, found: "HandEye", count: int) -> None:
    at = ", ".join(
        f"{1e3 * x:.2f} +- {1e3 * d:.2f}"
        for x, d in zip(found.camera.position, found.interval, strict=True)
    )
    console.print(
        f"camera in the {found.mount}: {at} mm (95 %)\n"
        f"{count} pictures, corners {found.error:.3f} pixels off; a picture left out "
        f"is {1e3 * found.leave_one_out_rms:.3f} mm from where the others say (RMS), "
        f"{1e3 * found.leave_one_out.max():.3f} mm at worst\n"
        f"the print has {100 * found.scale:.2f} +- "
        f"{196 * found.scale_deviation:.2f} % of its size",
        highlight=False,
        soft_wrap=True,
    )


def _placed(camera: "CameraFile", found: "HandEye") -> "CameraFile":
    """Return the camera with the place that was found."""
    deviation = np.sqrt(np.diag(found.covariance))
    correlation = found.covariance / np.outer(deviation, deviation)
    return replace(
        camera,
        mount=found.mount,
        position=tuple(found.camera.position.tolist()),
        rotation=tuple(found.camera.quat_wxyz.tolist()),
        deviation=tuple(deviation.tolist()),
        correlation=tuple(tuple(row) for row in correlation.tolist()),
        made_by="dovetail camera hand-eye",
        made_on=_now(),
    )


def _decide(
    console: Console, objections: list[str], file: Path, camera: "CameraFile"
) -> int:
    """Write the camera file where nothing speaks against it."""
    for objection in objections:
        console.print(f"no-go: {objection}", highlight=False, soft_wrap=True)
    if objections:
        console.print(f"{file} is not written")
        return 1
    write_atomic(file, camera.to_toml())
    console.print(f"go: written to {file}", highlight=False, soft_wrap=True)
    return 0


def _now() -> str:
    return datetime.now().astimezone().isoformat(timespec="seconds")


Camera = (
    Annotated[CameraBoard, tyro.conf.subcommand("board")]
    | Annotated[CameraIntrinsics, tyro.conf.subcommand("intrinsics")]
    | Annotated[CameraHandEye, tyro.conf.subcommand("hand-eye")]
    | Annotated[CameraWatch, tyro.conf.subcommand("watch")]
)
