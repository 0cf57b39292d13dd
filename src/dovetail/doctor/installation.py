"""Checks of the installation: packages, agreement with the engines, cycle time."""

import importlib.metadata
import importlib.util
import platform
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

from dovetail.doctor.check import Check
from dovetail.errors import DovetailError, install_command
from dovetail.types import Vec7

POSE_TOLERANCE = 1e-6
"""Largest difference of tool positions between model and engine [m]."""
GRAVITY_TOLERANCE = 0.02
"""Largest gravity torque that the model leaves uncompensated [Nm]."""
INERTIA_TOLERANCE = 0.01
"""Largest error of the predicted acceleration over the commanded one [1]."""
_CYCLES = 5000
_DT = 0.001

EXTRAS = {
    "bullet": ("pybullet", "the paper's simulator"),
    "drake": ("pydrake", "an engine that no policy was tuned on"),
    "learn": ("sbx", "training"),
    "log": ("pyarrow", "Episode logs as Parquet"),
    "rpc": ("grpc", "arms in other processes"),
    "identify": ("cmaes", "identification"),
    "reproduce": ("snakemake", "the paper's experiments"),
    "view": ("viser", "the cockpit in the browser"),
    "camera": ("cv2", "cameras"),
    "teach": ("pyspacemouse", "a 3D mouse in the cockpit"),
    "film": ("moviepy", "Gymnasium's RecordVideo, and its window"),
    "cluster": ("ray", "fits on several machines"),
    "franka": ("pylibfranka", "a Franka arm, franka://"),
    "menagerie": ("mujoco_menagerie", "robots by name, menagerie:NAME"),
    "parts": ("shapely", "parts from outlines and meshes"),
}
"""Optional packages by the extra that brings them, and what for."""


def run_checks() -> Iterator[Check]:
    """Yield every check as soon as it is done; none raises."""
    yield _check_python()
    yield _guard("control core (C++)", _check_core)
    yield _guard("mujoco", _check_mujoco)
    for extra in EXTRAS:
        yield _check_extra(extra)
    yield _guard("pictures", _check_pictures)._replace(is_essential=False)
    yield _guard("shipped twins", _check_twins)
    yield _guard("shipped policies", _check_policies)
    yield _guard("model and mujoco agree", lambda: _check_agreement("mujoco"))
    for engine in ("bullet", "drake"):
        if importlib.util.find_spec(EXTRAS[engine][0]):
            name = f"model and {engine} agree"
            check = _guard(name, lambda e=engine: _check_agreement(e))
            yield check._replace(is_essential=False)
    for scheme in ("qp", "paper"):
        yield _guard(f"control cycle, {scheme}", lambda s=scheme: _check_cycle(s))


def _guard(name: str, question: Callable[[], str]) -> Check:
    """Turn an answer into a check, and any failure into a broken one."""
    try:
        return Check(name, "ok", question())
    except DovetailError as error:
        return Check(name, "broken", str(error))
    except Exception as error:  # a doctor reports every error
        return Check(name, "broken", f"{type(error).__name__}: {error}")


def _check_python() -> Check:
    oldest = (3, 11)
    is_new_enough = sys.version_info[:2] >= oldest
    detail = platform.python_version()
    if is_new_enough:
        return Check("python", "ok", detail)
    return Check("python", "broken", f"{detail}; dovetail needs 3.11 or newer")


def _check_core() -> str:
    from dovetail import _core

    return str(_core.__file__)


def _check_mujoco() -> str:
    """Build a plant: it refuses another version than the loop was compiled against."""
    import mujoco

    from dovetail.envs.registered import find_cell
    from dovetail.plants.find import make_plant

    make_plant("mujoco", find_cell()).close()
    return str(mujoco.__version__)


def _check_extra(extra: str) -> Check:
    module, purpose = EXTRAS[extra]
    if importlib.util.find_spec(module):
        return Check(module, "ok", purpose, is_essential=False)
    detail = f"{purpose}; {install_command(extra)}"
    return Check(module, "missing", detail, is_essential=False)


def _check_pictures() -> str:
    """Draw a picture, and name the library that draws."""
    from dovetail.mujoco_gl import LIBRARIES
    from dovetail.view.gl_context import find_backend, open_context

    name = find_backend()
    open_context(8, 8).free()
    return f"{LIBRARIES[name]} draws without a screen"


def _check_twins() -> str:
    from dovetail.plants.twin import list_twins, load_twin

    names = list_twins()
    for name in names:
        load_twin(name)
    if not names:
        raise DovetailError("none found; install dovetail again")
    return ", ".join(names)


def _check_policies() -> str:
    from dovetail.learn.policy import Policy, find_policy, list_policies

    names = list_policies()
    for name in names:
        Policy.load(find_policy(name))
    if not names:
        raise DovetailError("none found; install dovetail again")
    return ", ".join(names)


def _check_agreement(engine: str) -> str:
    """Compare tool position, gravity torque and inertia with an engine's motion."""
    from dovetail.envs.registered import find_cell
    from dovetail.plants.find import make_plant
    from dovetail.plants.plant import DynamicsConfig
    from dovetail.poses import Pose

    cell = find_cell()
    zeros = (0.0,) * 7
    free = DynamicsConfig(
        damping=zeros, armature=zeros, gravity_compensation=False, physics_dt=_DT
    )
    plant = make_plant(engine, cell, free)
    fixture = Pose(np.array([0.6, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))
    chain = cell.loaded_robot().chain()

    def accelerate(q: Vec7, tau: Vec7) -> Vec7:
        plant.reset(q, fixture)
        plant.apply(tau, _DT)
        return plant.read()[1] / _DT

    pose, gravity, inertia = 0.0, 0.0, 0.0
    for q in _configurations(5):
        plant.reset(q, fixture)
        error = plant.tool_pose().position - chain.pose(q)[0]
        pose = max(pose, float(np.abs(error).max()))
        M, g = chain.inertia_matrix(q), chain.gravity(q)
        fall = accelerate(q, g)
        gravity = max(gravity, float(np.abs(M @ fall).max()))
        for joint in range(7):
            ddq = np.eye(7)[joint]
            error = accelerate(q, g + M @ ddq) - fall - ddq
            inertia = max(inertia, float(np.abs(error).max()))
    plant.close()
    text = (
        f"tool {1e6 * pose:.2g} um, gravity {gravity:.2g} Nm, "
        f"inertia {100 * inertia:.2g} %"
    )
    limits = (POSE_TOLERANCE, GRAVITY_TOLERANCE, INERTIA_TOLERANCE)
    if any(e > t for e, t in zip((pose, gravity, inertia), limits, strict=True)):
        raise DovetailError(
            f"{text}; allowed: {1e6 * POSE_TOLERANCE:g} um, {GRAVITY_TOLERANCE:g} Nm, "
            f"{100 * INERTIA_TOLERANCE:g} %"
        )
    return f"largest difference: {text}"


def _configurations(count: int) -> Iterator[Vec7]:
    """Yield configurations [rad] around the working pose, free of contact."""
    rng = np.random.default_rng(0)
    home = np.array([0.0, 0.4, 0.0, -1.4, 0.0, 1.0, 0.0])
    for _ in range(count):
        yield home + rng.uniform(-0.3, 0.3, 7)


def _check_cycle(scheme: str) -> str:
    """Time the controller's step, model terms and the call from Python included."""
    from dovetail import _core
    from dovetail.control.build import make_controller
    from dovetail.control.config import LimitConfig, OscConfig
    from dovetail.envs.registered import find_cell

    period = 0.001
    robot = find_cell().loaded_robot()
    limits = LimitConfig.for_period(robot, period, scheme=scheme)
    task = "XYZ:force A:pose BC:hold"
    osc = OscConfig.for_period(period)
    controller = make_controller(robot, osc, limits, task, period)
    rng = np.random.default_rng(0)
    target = _core.Target()
    target.quat_wxyz_d = np.array([0.0, 1.0, 0.0, 0.0])
    states = list(_configurations(100))
    speeds = rng.uniform(-0.3, 0.3, (100, 7))
    hold = robot.tool_pose(states[0])
    controller.reset(states[0], hold.position, hold.quat_wxyz)
    spent = np.empty(_CYCLES)
    for cycle in range(_CYCLES):
        if cycle % 50 == 0:
            target.f_star = np.append(rng.uniform(-10.0, 10.0, 3), np.zeros(3))
        q, dq = states[cycle % 100], speeds[cycle % 100]
        start = time.perf_counter_ns()
        controller.step(q, dq, target)
        spent[cycle] = time.perf_counter_ns() - start
    p50, p99 = np.percentile(spent, [50, 99]) / 1e3
    return f"p50 {p50:.1f} us, p99 {p99:.1f} us with the call from Python"
