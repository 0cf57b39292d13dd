"""The C++ loop over MuJoCo: equal to the Python one, and only for its own version."""

import shutil
import subprocess

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.cycle_loop import run_cycles
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from dovetail.plants.twin import load_twin, make_twin
from plants.conftest import HOLE, start_above


def play(plant, run, period, steps=25):
    """Drive the peg down onto the block and about; return the whole log."""
    robot = plant.robot
    limits = LimitConfig.for_period(robot, period)
    osc = OscConfig(force_damping=[16.0, 16.0, 16.0, 0.0, 0.0, 0.0])
    task = "XYZ:force A:pose BC:hold"
    controller = make_controller(robot, osc, limits, task, period)
    q = start_above(robot, z=0.11)
    pose = robot.tool_pose(q)
    plant.seed(4)
    plant.reset(q, HOLE)
    controller.reset(plant.read()[0], pose.position, pose.quat_wxyz)
    rng = np.random.default_rng(1)
    logs, cycles = [], round(0.05 / period)
    for i in range(steps):
        f_star = np.array([*rng.uniform(-3.0, 3.0, 2), -3.0, 0.0, 0.0, 0.0])
        target = _core.Target(f_star=f_star, quat_wxyz_d=pose.quat_wxyz)
        log, q, dq = run(plant, controller, target, cycles, period, i * 0.05)
        np.testing.assert_array_equal(
            np.concatenate([q, dq]), [*np.ravel(plant.read())]
        )
        logs.append(log)
    return np.concatenate(logs)


def fast(plant, controller, target, cycles, period, start):
    return plant.run_cycles(controller, target, cycles, period)


@pytest.mark.parametrize("period", [0.005, 0.001])
@pytest.mark.parametrize("twin", [None, "medium"])
def test_loop_writes_what_the_python_loop_writes(twin, period):
    cell = find_cell()
    plant = make_twin(load_twin(twin), cell) if twin else MujocoPlant(cell)
    expected = play(plant, run_cycles, period)
    log = play(plant, fast, period)
    assert np.abs(log[:, COLUMN["fz"]]).max() > 1.0  # the peg did touch
    # Contacts amplify the last digit of FK by another instruction order.
    np.testing.assert_allclose(log, expected, atol=1e-6, rtol=1e-6)


def test_log_describes_each_cycle():
    plant = MujocoPlant(find_cell())
    log = play(plant, fast, 0.005)
    columns = dict(zip(CYCLE_COLUMNS, log.T, strict=True))
    np.testing.assert_allclose(np.diff(columns["time"]), 0.005, atol=1e-12)
    for row in log[::20]:
        pose = plant.robot.tool_pose(row[COLUMN["q1"] : COLUMN["q7"] + 1])
        np.testing.assert_allclose(row[COLUMN["x"] : COLUMN["z"] + 1], pose.position)
    speed = np.diff(columns["z"]) / 0.005
    moving = columns["fz"][1:] == 0.0
    np.testing.assert_allclose(speed[moving], columns["vz"][1:][moving], atol=0.02)
    assert (columns["fsz"] == -3.0).all()


def test_log_of_another_width_is_refused():
    plant = MujocoPlant(find_cell())
    with pytest.raises(TypeError):
        plant._loop.run(None, _core.Target(), 1, np.empty((3, 41)))


def loop_over(plant, library):
    return _core.MujocoLoop(
        str(library),
        plant.model._address,
        plant.data._address,
        plant.robot.chain(),
        _core.Channel(),
        True,
    )


def test_another_mujoco_version_is_an_error_not_a_crash(tmp_path):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip(
            "needs a C compiler named cc for a library of another version: install gcc"
        )
    source = tmp_path / "other.c"
    source.write_text("int mj_version(void) { return 4000001; }\n")
    library = tmp_path / "libmujoco.so.4.0.1"
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-o", str(library), str(source)], check=True
    )
    plant = MujocoPlant(find_cell())
    with pytest.raises(RuntimeError, match="version 4000001, the control loop was"):
        loop_over(plant, library)


def test_missing_library_is_named(tmp_path):
    plant = MujocoPlant(find_cell())
    with pytest.raises(RuntimeError, match=r"libmujoco\.so\.9 cannot be opened"):
        loop_over(plant, tmp_path / "libmujoco.so.9")


def test_channel_refuses_numbers_out_of_range():
    with pytest.raises(ValueError, match="channel delay is 3"):
        _core.Channel(delay=3.0)
