"""`dovetail camera hand-eye`: find where a camera sits, by the poses of an arm."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track

from dovetail.arms.address import parse_address
from dovetail.arms.arm_address import ArmAddress
from dovetail.commands.asking import ask
from dovetail.commands.camera_result import decide, now
from dovetail.commands.unproven import note_cell
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import build_arm
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.files import claim_output_folder, require_new
from dovetail.plants.twin import load_twin
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.settings import in_count, settings
from dovetail.workcell.cell_config import CellFile
from dovetail.workcell.workcell import Workcell

if TYPE_CHECKING:
    from dovetail.perceive.camera import Camera
    from dovetail.perceive.detect import Detector
    from dovetail.perceive.hand_eye import HandEye, HandEyeSample
    from dovetail.perceive.rehearsal import Shot

_PICTURES_MAX = 1000
_ROUNDING = 3e-3
"""Error of a simulated camera's place that is allowed beyond twice its interval [m]: a
wrong lens shifts it."""
_MOVED = (
    "The arm will go through {count} poses, slowly and inside its walls, and stand in "
    "each for a picture; {held}, and nothing else is to be in its way"
)


@settings()
class PictureOptions:
    """The pictures, taken or read."""

    folder: Path | None = None
    """Pictures with poses.csv: the picture's file, then q1 to q7 [rad]. Default an arm
    goes through poses inside its limits."""
    count: int = 20
    """Pictures that are taken."""
    seed: int = 0
    """Of the poses."""
    keep: Path | None = None
    """Folder, new or empty, for the pictures and poses.csv: --folder takes it."""


@settings()
class MovedArmOptions:
    """The arm that goes through the poses."""

    arm: str | None = None
    """Arm that goes there: twin:NAME, fri://HOST:PORT, grpc://HOST:PORT. Default a
    simulated one that stands in each pose at once, of a simulated camera."""
    approach: bool = False
    """Let an arm behind fri:// go to the first pose from afar, slowly."""
    yes: bool = False
    """Ask nothing before a real arm is moved."""
    robot: str = DEFAULT_ROBOT
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION."""
    cell: CellFile = None
    """Cell file: table, tool, walls, and where the fixture stands."""


@settings()
class KnownCameraOptions:
    """Mount and twin of the camera."""

    mount: str | None = None
    """Mount of the camera: world (the board is on the flange) or flange. Default as in
    its file."""
    twin: str | None = None
    """Twin whose file says what the simulated camera has wrong. It is written into the
    calibrated file. With --folder: that with which the pictures were taken."""


@settings()
class CameraHandEye(PictureOptions, MovedArmOptions, KnownCameraOptions):
    """Find where a camera sits, and say how sure that is: go or no-go."""

    camera: Annotated[Path, tyro.conf.Positional]
    """Camera file with the lens, and its place, roughly: from there the poses are
    drawn, but with --folder."""
    out: Path = Path("calibrated.toml")
    """Camera file to write; not overwritten."""

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
        if self.twin is not None and not camera.is_simulated:
            raise ConfigError(
                f"twin is given, and the pictures are of {camera.source}; leave it out"
            )
        address = None if self.arm is None else parse_address(self.arm)
        twin = self.twin or (address and address.twin) or camera.twin or None
        note_cell(console, self._cell(), None)
        detector = Detector(camera.board, camera.lens, camera.edge_noise)
        views = self._views(
            detector, self._shots(camera, address, twin, console), console
        )
        found = calibrate(views, camera.lens, camera.mount)
        print_hand_eye(console, found, len(views))
        objections = found.objections()
        camera = camera.calibrated_from(self.camera, twin)
        if camera.is_simulated:
            objections += self._elsewhere(camera, found)
        # What is no-go may be no camera at all: its doubts are out of any range.
        placed = camera if objections else _placed(camera, found)
        return decide(console, objections, file, placed)

    def _cell(self) -> Workcell:
        """Return the robot in its cell: its flange may be turned there."""
        return find_cell(robot=self.robot, cell=self.cell)

    def _shots(
        self,
        camera: "Camera",
        address: ArmAddress | None,
        twin: str | None,
        console: Console,
    ) -> "Iterable[Shot]":
        from dovetail.perceive.hand_eye import VIEWS_MIN
        from dovetail.perceive.recorded import keep_shots, read_shots

        if self.folder is not None:
            if self.keep is not None or address is not None:
                raise ConfigError(
                    "folder has pictures that were taken: --keep and --arm are for "
                    "taking them; leave them out"
                )
            robot = self._cell().robot
            return read_shots(
                self.folder,
                robot,
                lambda text: console.print(text, highlight=False, soft_wrap=True),
            )
        if address is None and not camera.is_simulated:
            raise ConfigError(
                f"the camera's source is {camera.source}: give the --arm that "
                "is to go through poses, or take pictures in 20 poses and give their "
                "--folder"
            )
        in_count("count", self.count, VIEWS_MIN, _PICTURES_MAX, "pictures")
        if address is None:
            shots = self._rehearsed(camera, twin)
        else:
            shots = self._taken(camera, address, twin)
        if self.keep is not None:
            shots = keep_shots(shots, claim_output_folder(self.keep))
        return track(shots, "poses", total=self.count, console=console)

    def _rehearsed(self, camera: "Camera", twin: str | None) -> "Iterator[Shot]":
        from dovetail.perceive.rehearsal import shoot

        errors = None if twin is None else load_twin(twin).camera
        cell = find_cell(robot=self.robot, cell=self.cell)
        return shoot(camera.as_it_is(), cell, errors, self.count, self.seed)

    def _taken(
        self, camera: "Camera", address: ArmAddress, twin: str | None
    ) -> "Iterator[Shot]":
        from dovetail.perceive.arm_shots import TASK, take_shots

        if self.approach:
            address = parse_address(address.with_approach())
        if not (address.is_here or self.yes):
            holds = "holds the board" if camera.mount == "world" else "is empty"
            question = _MOVED.format(count=self.count, held=f"the tool {holds}")
            if not ask(question):
                raise ConfigError("the arm was not moved; nothing is written")
        errors = None if twin is None else load_twin(twin).camera
        cell = find_cell(robot=self.robot, cell=self.cell)
        arm = build_arm(address, cell, TaskSpec.parse(TASK))
        try:
            taken = camera.as_it_is() if camera.is_simulated else camera
            yield from take_shots(taken, arm, cell, errors, self.count, self.seed)
        finally:
            arm.close()

    def _views(
        self, detector: "Detector", shots: "Iterable[Shot]", console: Console
    ) -> "list[HandEyeSample]":
        from dovetail.perceive.detect import DetectionFailure, explain
        from dovetail.perceive.hand_eye import HandEyeSample

        robot, views = self._cell().robot, []
        for number, shot in enumerate(shots, 1):
            seen = detector.find(shot.picture)
            if isinstance(seen, DetectionFailure):
                reason = explain(detector, shot.picture, seen)
                console.print(f"picture {number}: {reason}", soft_wrap=True)
                continue
            flange = robot.tool_pose(shot.q)
            views.append(HandEyeSample(flange, seen.pose, seen.corners, seen.points))
        return views

    def _elsewhere(self, camera: "Camera", found: "HandEye") -> list[str]:
        """Object to a simulated camera that is not where its twin has it."""
        from dovetail.perceive.open_source import twin_of
        from dovetail.perceive.simulated import true_camera
        from dovetail.plants.twin_camera import TwinCamera

        true = true_camera(camera.as_it_is(), twin_of(camera, None) or TwinCamera())
        gap = np.abs(found.camera.position - true.pose.position)
        if (gap <= 2.0 * found.interval + _ROUNDING).all():
            return []
        whose = f"with twin {camera.twin}" if camera.twin else "without a twin"
        return [
            f"the pictures say that the camera is {1e3 * np.linalg.norm(gap):.1f} mm "
            f"from where it is {whose}: give the --twin with which they were taken"
        ]


def print_hand_eye(console: Console, found: "HandEye", count: int) -> None:
    """Say what was found, and how sure.

    Args:
        console: Where to.
        found: The calibration.
        count: Of how many pictures.
    """
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


def _placed(camera: "Camera", found: "HandEye") -> "Camera":
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
        made_on=now(),
    )
