"""Checks of a camera: pictures, board, exposure, sharpness, rate and delay."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState, ToolState
from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.arms.local_address import PlantAddress
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor.check import Check
from dovetail.doctor.picture_delay import LONGEST, fit_delay
from dovetail.envs.arm_setup import build_arm
from dovetail.envs.config import EnvConfig
from dovetail.errors import ConfigError, TrackerError
from dovetail.perceive.camera import Camera
from dovetail.perceive.detect import Detection, DetectionFailure, Detector, explain
from dovetail.perceive.edges import edge_width
from dovetail.perceive.open_source import open_source
from dovetail.perceive.rehearsal import board_of, viewpoint
from dovetail.perceive.sources import Frame, ImageSource
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from dovetail.plants.twin import load_twin
from dovetail.poses import Pose
from dovetail.types import Array, Vec7
from dovetail.workcell.workcell import Workcell

TASK = "XYZABC:pose"
"""Axes of an arm that is moved for a camera."""
RATE_OFF = 0.1
"""Largest deviation of the rate from the file's, as a share [1]."""
WHITE = 60.0
"""Darkest that white paper may be [grey values]."""
SATURATED = 0.2
"""Share of the board that may be cut off at 255 [1]; half of it is paper."""
WIDTH = 1.6
"""Widest edge, standard deviation [pixels]."""
SEEN = 0.9
"""Share of the pictures in which the board must be seen [1]."""
DELAY_OFF = 0.010
"""Largest deviation of the delay from the file's [s]."""
UNSURE = 0.003
"""Largest standard deviation of a delay that is believed [s]."""
MOVED = (0.8, 1.2)
"""Way of what is seen, over the arm's."""
AMPLITUDE = 0.006
"""Of the arm's motion [m]: of two sines, so that it does not repeat itself."""
_FREQUENCIES = (1.1, 1.9)  # [1/s]
_WAY = np.array([0.0, 1.0, 0.0])  # world axes
_PAUSE, _MOTION = 0.5, 1.2  # [s]
_MOVED = (
    "The arm will be held where it stands and its tool moved by up to "
    f"{2e3 * AMPLITUDE:g} mm to and fro, the board in sight"
)
_STILL = 20  # pictures of a camera without an arm
_PATIENCE = 5.0  # [s]


@dataclass
class Watched:
    """Pictures of a camera, and the arm's motion meanwhile."""

    frames: list[Frame] = field(default_factory=list)
    arrival: list[float] = field(default_factory=list)
    """Time at which each picture arrived [s]."""
    time: list[float] = field(default_factory=list)
    """Time of each control cycle of the arm [s], by the same clock."""
    way: list[float] = field(default_factory=list)
    """Distance that the arm had moved along its line in each cycle [m]."""


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
        watched = watch_still(source, cell.place, standing(cell.robot.posture("down")))
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
    margin = 2.0 * (arm.facts.limits.delta_x + AMPLITUDE)
    return viewpoint(camera, cell, margin)


def check_camera(camera: Camera, watched: Watched) -> Iterator[Check]:
    """Yield what pictures say: resolution, rate, board, exposure, sharpness, delay."""
    frames = watched.frames
    if not frames:
        words = "gives no picture: is it plugged in, and free?"
        yield Check("camera", "broken", f"{camera.source} {words}")
        return
    yield Check("camera", "ok", f"{camera.source}, {len(frames)} pictures")
    shape, lens = frames[0].picture.shape, camera.lens
    is_size = shape == (lens.height, lens.width)
    size = f"{shape[1]} x {shape[0]} pixels, calibrated at {lens.width} x {lens.height}"
    advice = "" if is_size else ": set the camera to that, or calibrate it again"
    yield _check("resolution", is_size, size + advice)
    if not is_size:
        return
    yield check_rate(camera, watched.arrival)
    detector = Detector(camera.board, lens, camera.edge_noise)
    sights = [detector.find(frame.picture) for frame in frames]
    seen = [i for i, sight in enumerate(sights) if isinstance(sight, Detection)]
    looks = zip(frames, sights, strict=True)
    blind = ((f.picture, s) for f, s in looks if isinstance(s, DetectionFailure))
    reason = next((explain(detector, *look) for look in blind), "")
    share = len(seen) / len(frames)
    words = f"seen in {len(seen)} of {len(frames)} pictures, at least {SEEN:.0%}"
    is_seen = share >= SEEN
    yield _check("board", is_seen, words if is_seen else f"{words}: {reason}")
    if not seen:
        return
    last = seen[-1]
    corners = sights[last]
    assert isinstance(corners, Detection)
    yield check_exposure(frames[last].picture, corners.corners)
    yield check_sharpness(
        [edge_width(frames[i].picture, _corners(sights[i])) for i in seen]
    )
    if watched.way:
        places = np.array([_place(sights[i]) for i in seen])
        arrival = np.array(watched.arrival)[seen]
        yield check_delay(camera, watched, arrival, places)


def _corners(sight: Detection | DetectionFailure) -> Array:
    assert isinstance(sight, Detection)
    return sight.corners


def _place(sight: Detection | DetectionFailure) -> Array:
    assert isinstance(sight, Detection)
    return sight.pose.position


def _check(name: str, is_ok: bool, detail: str) -> Check:
    return Check(name, "ok" if is_ok else "broken", detail)


def check_rate(camera: Camera, arrival: list[float]) -> Check:
    """Say how many pictures come in a second."""
    span = arrival[-1] - arrival[0]
    if len(arrival) < 3 or span <= 0.0:
        return Check("rate", "broken", "fewer than 3 pictures came; see its cable")
    rate = (len(arrival) - 1) / span
    is_ok = abs(rate / camera.rate - 1.0) <= RATE_OFF
    words = f"{rate:.1f} 1/s, the file says {camera.rate:g} +- {RATE_OFF:.0%}"
    advice = "" if is_ok else ": more light, a shorter exposure, or correct the file"
    return _check("rate", is_ok, words + advice)


def check_exposure(picture: NDArray[np.uint8], corners: Array) -> Check:
    """Say whether the board is well lit: its paper, and what is cut off at 255."""
    points = corners.reshape(-1, 2)
    x0, y0 = np.maximum(points.min(axis=0).astype(int), 0)
    x1, y1 = points.max(axis=0).astype(int) + 1
    board = picture[y0:y1, x0:x1]
    white = float(np.percentile(board, 90.0))
    cut = float((board >= 255).mean())
    words = (
        f"paper {white:.0f} grey values (at least {WHITE:g}), "
        f"{100 * cut:.0f} % cut off (at most {100 * SATURATED:g} %)"
    )
    if white < WHITE:
        return Check("exposure", "broken", f"{words}: too dark, more light")
    advice = "" if cut <= SATURATED else ": too bright, a shorter exposure"
    return _check("exposure", cut <= SATURATED, words + advice)


def check_sharpness(widths: list[float]) -> Check:
    """Say how wide the markers' edges are [pixels], of each picture."""
    width = float(np.median(widths))
    words = f"edges {width:.2f} pixels wide (at most {WIDTH:g})"
    is_ok = width <= WIDTH
    advice = "" if is_ok else ": focus the lens, or a shorter exposure"
    return _check("sharpness", is_ok, words + advice)


def check_delay(
    camera: Camera, watched: Watched, arrival: Array, places: Array
) -> Check:
    """Say how late pictures are, by the arm's motion."""
    if len(places) < 8:
        return Check("delay", "broken", "the board was seen too seldom to tell")
    found = fit_delay(np.array(watched.time), np.array(watched.way), arrival, places)
    if not MOVED[0] <= found.moved <= MOVED[1]:
        is_beside = camera.mount == "world"
        carries = "the tool is to hold the board" if is_beside else ""
        return Check(
            "delay",
            "broken",
            f"what is seen moved {found.moved:.2f} times as far as the arm "
            f"({MOVED[0]:g} to {MOVED[1]:g}): {carries or 'the board is to lie still'}",
        )
    words = (
        f"{1e3 * found.delay:.1f} +- {1.96e3 * found.deviation:.1f} ms (95 %), "
        f"the file says {1e3 * camera.delay:g} +- {1e3 * DELAY_OFF:g}"
    )
    if found.deviation > UNSURE or found.delay >= LONGEST - 0.002:
        return Check("delay", "broken", f"{words}: not sure; more light, and again")
    is_ok = abs(found.delay - camera.delay) <= DELAY_OFF
    advice = "" if is_ok else f": write delay = {found.delay:.3f} into the file"
    return _check("delay", is_ok, words + advice)


def standing(q: Vec7, stamp: float = 0.0) -> ArmState:
    """Return what an arm measures that stands at q [rad]."""
    still, zero = np.zeros(6), np.zeros(3)
    quat = np.array([1.0, 0.0, 0.0, 0.0])
    log = np.zeros((0, len(CYCLE_COLUMNS)))
    tool = ToolState(zero, quat, still)
    return ArmState(stamp, q, np.zeros(7), tool, zero, still, 0, log)


def watch_still(source: ImageSource, fixture: Pose, state: ArmState) -> Watched:
    """Look without an arm, by the clock of this machine."""
    watched, begin = Watched(), time.monotonic()
    while len(watched.frames) < _STILL and time.monotonic() < begin + _PATIENCE:
        try:
            frame = source.look(fixture, state)
        except TrackerError:
            break
        if frame is not None:
            watched.frames.append(frame)
            watched.arrival.append(time.monotonic())
    return watched


def watch_moving(
    arm: Arm, source: ImageSource, q: Vec7, board: Callable[[Vec7], Pose]
) -> Watched:
    """Move the arm a little and look.

    Args:
        arm: With axes `TASK`.
        source: Of the pictures.
        q: Where it begins [rad]; a real arm is there already.
        board: Where the board is with the arm at q [rad]; only a simulation asks.
    """
    watched, period = Watched(), arm.facts.period
    state = arm.reset(q, board(q))
    source.reset(board(state.q), 0)
    target = _core.Target(
        position_d=state.tool.position.copy(), quat_wxyz_d=state.tool.quat_wxyz.copy()
    )
    start, steps = state.tool.position.copy(), round((_PAUSE + _MOTION) / period)
    is_real_time = arm.facts.traits.is_real_time
    late = 0.0 if is_real_time else 0.5 * period  # it is asked so often
    for step in range(steps):
        since = max(step * period - _PAUSE, 0.0)
        sines = sum(np.sin(2.0 * np.pi * f * since) for f in _FREQUENCIES)
        target.position_d = start + AMPLITUDE * sines * _WAY
        state = arm.step(target, period)
        here = time.monotonic()
        tips = state.log[:, COLUMN["x"] : COLUMN["z"] + 1]
        watched.time += state.log[:, COLUMN["time"]].tolist()
        watched.way += ((tips - start) @ _WAY).tolist()
        frame = source.look(board(state.q), state)
        if frame is not None and since > 0.0:
            waited = time.monotonic() - here if is_real_time else 0.0
            watched.frames.append(frame)
            watched.arrival.append(state.stamp + waited - late)
    return watched
