"""How well does a camera see the fixture, and how well is its place found?

    python benchmarks/camera.py                 all four
    python benchmarks/camera.py pose --width 640

* pose: pictures of the simulated camera from all sides, 0.5 m away, blur and noise as
  usual: error in the plane of the board, of the turn in it, of the depth; how many lie
  in the 95 % region that is told with them.
* axes: the camera of examples/beside.toml, 0.54 m away, where it is exactly, and as
  hand-eye on twin medium finds it, ten times: how many errors lie in the 95 % interval
  that is told for x, y, z and the turns about them, world axes.
* hand-eye: 20 poses, corners with normal noise of 0.3 pixels, camera on the flange and
  beside the robot in turn: error of the place, and how many lie in the interval.
* speed: from picture to pose, on one core.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail.envs.registered import find_cell
from dovetail.perceive.board import Board
from dovetail.perceive.camera import Camera, Lens, load_camera
from dovetail.perceive.detect import Detection, DetectionFailure, Detector
from dovetail.perceive.hand_eye import HandEyeSample, calibrate
from dovetail.perceive.opencv import opencv
from dovetail.perceive.projection import Projection
from dovetail.perceive.rehearsal import shoot
from dovetail.perceive.simulated import Simulated
from dovetail.plants.twin import load_twin
from dovetail.plants.twin_camera import TwinCamera
from dovetail.poses import (
    Pose,
    compose,
    inverse,
    matrix_from_quat,
    quat_about_z,
    quat_from_matrix,
    quat_from_vector,
    rotation_error,
)
from dovetail.trackers.marker import locate
from dovetail.types import Array, Vec3
from dovetail.workcell.workcell import Workcell

DISTANCE = 0.5
"""From camera to board [m]."""
REGION = 12.592
"""95 % of chi squared with 6 degrees of freedom."""
EXAMPLE = Path(__file__).parents[1] / "examples" / "beside.toml"
NOISE = 0.3
"""Of a corner in the hand-eye calibrations [pixels]."""


def looking(position: Vec3, target: Vec3) -> Pose:
    """Return an upright camera at a position that looks at a target."""
    ahead = (target - position) / np.linalg.norm(target - position)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    return Pose(position, quat_from_matrix(R))


def around(rng: np.random.Generator, fixture: Pose, distance: float) -> Pose:
    """Draw a camera 35 to 75 degrees above the board."""
    azimuth, height = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(35.0, 75.0))
    flat = np.cos(height)
    out = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(height)])
    aside = np.array([*rng.uniform(-0.05, 0.05, 2), 0.0])
    return looking(fixture.position + distance * out, fixture.position + aside)


def scene(
    lens: Lens, camera: Pose, fixture: Pose, number: int, source: Simulated
) -> NDArray[np.uint8]:
    """Return a picture with the arm out of the way."""
    source.camera = Camera(
        lens=lens,
        mount="world",
        position=tuple(camera.position.tolist()),
        rotation=tuple(camera.quat_wxyz.tolist()),
    )
    q = np.array([-1.2, 0.0, 0.0, -1.0, 0.0, 0.5, 0.0])
    return source.still(q, fixture, fixture, number)


def pictures(lens: Lens, count: int) -> list[tuple[NDArray[np.uint8], Pose]]:
    """Return pictures, and the fixture in the camera for each."""
    rng = np.random.default_rng(0)
    first = Camera(
        lens=lens, mount="world", position=(1.0, 0, 0), rotation=(1.0, 0, 0, 0)
    )
    source, made = Simulated(first, find_cell(), TwinCamera()), []
    for number in range(count):
        yaw = quat_about_z(rng.uniform(-0.5, 0.5))
        fixture = Pose(np.array([0.6, 0.0, 0.1]), yaw)
        camera = around(rng, fixture, DISTANCE)
        picture = scene(lens, camera, fixture, number, source)
        made.append((picture, compose(inverse(camera), fixture)))
    source.close()
    return made


def measure_pose(width: int, count: int) -> None:
    """Print the errors of single pictures."""
    height = 3 * width // 4
    lens = Lens.ideal(width, height, 0.9375 * width)
    detector, errors, inside, blind = Detector(Board(), lens), [], [], 0
    for picture, true in pictures(lens, count):
        seen = detector.find(picture)
        if isinstance(seen, DetectionFailure):
            blind += 1
            continue
        gap = seen.pose.position - true.position
        turn = rotation_error(seen.pose.quat_wxyz, true.quat_wxyz)
        R, ray = matrix_from_quat(true.quat_wxyz), true.position
        depth = float(gap @ ray / np.linalg.norm(ray))
        # Where the line of sight meets the board's plane: what is off within the plane.
        normal = R[:, 2]
        across = R.T @ (gap - ray * (gap @ normal) / (ray @ normal))
        whole = R.T @ gap
        errors.append([
            np.linalg.norm(across[:2]), np.linalg.norm(whole[:2]), abs(depth),
            abs(float(turn @ normal)),
        ])  # fmt: skip
        e = np.concatenate([gap, turn])
        inside.append(float(e @ np.linalg.solve(seen.covariance, e)) < REGION)
    ray, plane, depth, yaw = np.percentile(errors, 95, axis=0)
    print(
        f"{width} x {height}, {count} pictures, {blind} without a pose: p95 in the "
        f"board's plane {1e3 * plane:.3f} mm (along the ray {1e3 * ray:.3f}), depth "
        f"{1e3 * depth:.3f} mm, yaw {1e3 * yaw:.2f} mrad; in the 95 % region "
        f"{100 * np.mean(inside):.1f} %"
    )


def found_by_hand_eye(camera: Camera, cell: Workcell, seed: int) -> Camera:
    """Return a camera with the place that a calibration on twin medium gives it."""
    twin, detector = load_twin("medium").camera, Detector(camera.board, camera.lens)
    views = []
    for shot in shoot(camera, cell, twin, 20, seed):
        sight = detector.find(shot.picture)
        if isinstance(sight, Detection):
            flange = cell.robot.tool_pose(shot.q)
            views.append(HandEyeSample(flange, sight.pose, sight.corners, sight.points))
    found = calibrate(views, camera.lens, camera.mount)
    deviation = np.sqrt(np.diag(found.covariance))
    correlation = found.covariance / np.outer(deviation, deviation)
    return replace(
        camera,
        position=tuple(found.camera.position.tolist()),
        rotation=tuple(found.camera.quat_wxyz.tolist()),
        deviation=tuple(deviation.tolist()),
        correlation=tuple(tuple(row) for row in correlation.tolist()),
    )


def measure_axes(width: int, count: int, calibrations: int) -> None:
    """Print how many errors lie inside what is told, by axis.

    Args:
        width: Of a picture [pixels].
        count: Number of pictures.
        calibrations: Number of calibrations that they are shared by; 0 is a camera that
            is where its file says.
    """
    example, cell = load_camera(EXAMPLE), find_cell()
    lens = Lens.ideal(width, 3 * width // 4, 0.9375 * width)
    believed = replace(example, lens=lens)
    rng, q = np.random.default_rng(0), cell.robot.posture("down")
    twin = load_twin("medium").camera if calibrations else TwinCamera()
    source, detector = Simulated(believed, cell, twin), Detector(Board(), lens)
    errors, told = [], []
    for part in range(max(calibrations, 1)):
        camera = believed
        if calibrations:
            camera = found_by_hand_eye(believed, cell, 1000 * part)
        for number in range(max(count // max(calibrations, 1), 1)):
            at = np.array([0.6, 0.0, 0.1])
            at[:2] += rng.uniform(-0.05, 0.05, 2)
            fixture = Pose(at, quat_about_z(rng.uniform(-0.5, 0.5)))
            picture = source.still(q, fixture, fixture, 1000 * part + number)
            sight = detector.find(picture)
            if isinstance(sight, DetectionFailure):
                continue
            pose, _, covariance = locate(camera, sight, cell.robot)
            assert covariance is not None
            turn = rotation_error(pose.quat_wxyz, fixture.quat_wxyz)
            errors.append(np.concatenate([pose.position - at, turn]))
            told.append(np.sqrt(np.diag(covariance)))
    source.close()
    e, sure = np.array(errors), np.array(told)
    share = 100 * (np.abs(e) < 1.96 * sure).mean(axis=0)
    kind = f"{calibrations} calibrations" if calibrations else "exact"
    print(
        f"{width} x {lens.height}, {kind}, {len(e)} pictures where the example is: "
        f"in the 95 % interval of x y z {_row(share[:3], 1)} %, of the turns "
        f"{_row(share[3:], 1)} %; mean error {_row(1e3 * e.mean(axis=0)[:3], 3)} mm, "
        f"its deviation {_row(1e3 * e.std(axis=0)[:3], 3)} mm"
    )


def _row(values: Array, digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)


def plant(
    rng: np.random.Generator, mount: str, poses: int
) -> tuple[Pose, Lens, list[HandEyeSample]]:
    """Return a camera's true place, its lens and what it sees."""
    board, lens = Board(), Lens.ideal(1280, 960, 1200.0)
    projection = Projection(lens)
    camera = Pose(
        np.array([0.0, 0.09, 0.03]) + rng.normal(0.0, 0.01, 3),
        quat_from_vector(np.array([0.25, 0.0, 0.0]) + rng.normal(0.0, 0.1, 3)),
    )
    fixture, views = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.2)), []
    for _ in range(poses):
        rolled = Pose(np.zeros(3), quat_about_z(rng.uniform(-0.7, 0.7)))
        look = compose(around(rng, fixture, rng.uniform(0.3, 0.5)), rolled)
        seen, moving = compose(inverse(look), fixture), compose(look, inverse(camera))
        noise = rng.normal(0.0, NOISE, (len(board.corners), 4, 2))
        corners = projection.place(seen, board.corners) + noise
        guess, _ = projection.flat_poses(board.corners, corners, board.thickness)
        flange = moving if mount == "flange" else inverse(moving)
        views.append(HandEyeSample(flange, guess, corners, board.corners))
    return camera, lens, views


def measure_hand_eye(plantings: int, poses: int) -> None:
    """Print the errors of calibrations."""
    errors, inside, whole = [], [], []
    for seed in range(plantings):
        rng = np.random.default_rng(seed)
        mount: Any = ("flange", "world")[seed % 2]
        true, lens, views = plant(rng, mount, poses)
        found = calibrate(views, lens, mount)
        gap = found.camera.position - true.position
        turn = rotation_error(found.camera.quat_wxyz, true.quat_wxyz)
        e = np.concatenate([gap, turn])
        # What the camera says of the tool's end, 0.2 m ahead of it, is off by as much.
        there = matrix_from_quat(true.quat_wxyz) @ np.array([0.0, 0.0, 0.2])
        at_tool = gap + np.cross(turn, there)
        errors.append([np.linalg.norm(gap), np.linalg.norm(at_tool)])
        inside += (np.abs(gap) <= found.interval).tolist()
        whole.append(float(e @ np.linalg.solve(found.covariance, e)) < REGION)
    place, tool = np.percentile(errors, 95, axis=0)
    print(
        f"hand-eye, {plantings} plantings of {poses} poses, {NOISE} pixels: p95 "
        f"{1e3 * place:.3f} mm at the camera, {1e3 * tool:.3f} mm at the tool; in the "
        f"95 % interval {100 * np.mean(inside):.1f} %, in the region of all six "
        f"{100 * np.mean(whole):.1f} %"
    )


def measure_speed(count: int) -> None:
    """Print how long a picture takes."""
    opencv().setNumThreads(1)
    lens = Lens.ideal(640, 480, 600.0)
    detector, times, work = Detector(Board(), lens), [], []
    shown: list[tuple[NDArray[np.uint8], Array]] = [
        (picture, true.position) for picture, true in pictures(lens, 10)
    ]
    for i in range(count):
        begin, busy = time.perf_counter(), time.thread_time()
        detector.find(shown[i % len(shown)][0])
        times.append(time.perf_counter() - begin)
        work.append(time.thread_time() - busy)
    low, middle, high = 1e3 * np.percentile(times, [5, 50, 95])
    alone = 1e3 * np.percentile(work, [50, 95])
    print(
        f"image to pose, 640 x 480, one core: p50 {middle:.2f} ms (p5 {low:.2f}, p95 "
        f"{high:.2f}); of it on the core p50 {alone[0]:.2f} ms, p95 {alone[1]:.2f}"
    )


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    kinds = ("all", "pose", "axes", "hand-eye", "speed")
    parser.add_argument("what", nargs="?", default="all", choices=kinds)
    parser.add_argument("--width", type=int, nargs="+", default=[640, 1280])
    parser.add_argument("--pictures", type=int, default=400)
    parser.add_argument("--calibrations", type=int, default=10)
    parser.add_argument("--plantings", type=int, default=100)
    parser.add_argument("--poses", type=int, default=20)
    arguments = parser.parse_args()
    if arguments.what in ("all", "pose"):
        for width in arguments.width:
            measure_pose(width, arguments.pictures)
    if arguments.what in ("all", "axes"):
        for width in arguments.width:
            measure_axes(width, arguments.pictures, 0)
            measure_axes(width, arguments.pictures, arguments.calibrations)
    if arguments.what in ("all", "hand-eye"):
        measure_hand_eye(arguments.plantings, arguments.poses)
    if arguments.what in ("all", "speed"):
        measure_speed(arguments.pictures)


if __name__ == "__main__":
    main()
