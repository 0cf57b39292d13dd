"""Twins: strict files, and every field changes the motion it names."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from dovetail.control.period import PERIODS
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.identify.parameters import nominal_model
from dovetail.plants.twin import Twin, list_twins, load_twin, make_twin
from dovetail.plants.twin_camera import TwinCamera
from dovetail.settings import names_in
from extras import need
from facts import about
from plants.conftest import HOLE, Q_BENT, start_above

IDEAL = nominal_model()
DT = 0.005


def play(config, steps=80):
    """Wave the arm in free air, then drag the peg inside the hole; measured states."""
    twin = make_twin(config, find_cell())
    chain = twin.robot.chain()
    rng = np.random.default_rng(11)
    twin.reset(Q_BENT, HOLE)
    free, touching = [], []
    for _ in range(steps):
        twin.apply(rng.uniform(-3.0, 3.0, 7), DT)
        free.append(np.concatenate(twin.read()))
    twin.reset(start_above(twin.robot, z=0.09), HOLE)
    for i in range(steps):
        angle = 0.1 * i
        force = 20.0 * np.array([np.cos(angle), np.sin(angle), -0.3])
        q, _ = twin.read()
        twin.apply(chain.jacobian(q)[:3].T @ force, DT)
        touching.append(np.concatenate(twin.read()))
    twin.close()
    return np.array(free), np.array(touching)


CHANGES = {
    "engine": ("bullet", False, True),
    "seed": (9, False, False),
    "description": ("another", False, False),
    "inertia": ("lbr", True, True),
    "mass_scale": ((1.1,) * 7, True, True),
    "gravity_residual": ((0.0, 0.0, 0.3), True, True),
    "damping": ((0.8,) * 7, True, True),
    "coulomb": ((0.2,) * 7, True, True),
    "armature": ((0.15,) * 7, True, True),
    "command_delay": (0.005, True, True),
    "torque_noise": (0.1, True, True),
    "position_noise": (1e-5, True, True),
    "velocity_noise": (2e-3, True, True),
    "contact_friction": (0.1, False, True),
    "contact_time": (0.02, False, True),
    "clearance_offset": (0.0002, False, True),
    "camera": (TwinCamera(bias=0.002, focal_error=0.01), False, False),
}
"""Field: another value, and whether it shows in free air and in the hole."""


def test_every_field_of_a_twin_is_in_this_test():
    assert set(CHANGES) == set(names_in(Twin))


@pytest.mark.parametrize("field", CHANGES)
def test_field_changes_the_motion_it_names_and_no_other(field):
    value, in_air, in_hole = CHANGES[field]
    if value == "bullet":
        need("pybullet")
    free, touching = play(IDEAL)
    other_free, other_touching = play(replace(IDEAL, **{field: value}))
    if field == "engine":  # free motion is the same equation in both engines
        np.testing.assert_allclose(other_free, free, atol=1e-5)
    else:
        assert np.array_equal(free, other_free) != in_air
    assert np.array_equal(touching, other_touching) != in_hole


def test_noise_follows_the_seed_and_can_start_again():
    noisy = replace(IDEAL, torque_noise=0.1, velocity_noise=1e-3)
    np.testing.assert_array_equal(play(noisy)[0], play(noisy)[0])
    assert not np.array_equal(play(noisy)[0], play(replace(noisy, seed=1))[0])
    twin = make_twin(noisy, find_cell())
    readings = []
    for _ in range(2):
        twin.seed(5)
        twin.reset(Q_BENT, HOLE)
        readings.append(np.concatenate(twin.read()))
    np.testing.assert_array_equal(*readings)


@pytest.mark.parametrize("engine", ["mujoco", "bullet"])
def test_delay_holds_the_command_back_by_its_time(engine):
    if engine == "bullet":
        need("pybullet")
    twin = make_twin(replace(IDEAL, command_delay=0.0075), find_cell(), engine=engine)
    twin.reset(Q_BENT, HOLE)
    tau = 5.0 * np.eye(7)[1]
    speeds = []
    for _ in range(3):
        twin.apply(tau, 0.0025)
        speeds.append(abs(twin.read()[1][1]))
    assert max(speeds) < 1e-9
    twin.apply(tau, 0.0025)
    assert abs(twin.read()[1][1]) > 1e-3
    twin.close()


def test_noise_has_the_deviation_it_names():
    twin = make_twin(
        replace(IDEAL, position_noise=1e-4, velocity_noise=2e-3), find_cell()
    )
    readings = []
    for _ in range(400):
        twin.reset(Q_BENT, HOLE)
        readings.append(np.concatenate(twin.read()))
    deviation = np.std(np.array(readings), axis=0)
    np.testing.assert_allclose(deviation[:7], 1e-4, rtol=0.2)
    np.testing.assert_allclose(deviation[7:], 2e-3, rtol=0.2)


def test_shipped_twins_load_and_come_back_from_their_own_text():
    assert {"easy", "medium", "hard"} <= set(list_twins())
    for name in list_twins():
        twin = load_twin(name)
        assert Twin(**tomllib.loads(twin.to_toml())) == twin


def written(tmp_path, change):
    """Write the easy twin with its text changed; return the path."""
    path = tmp_path / "twin.toml"
    path.write_text(change(load_twin("easy").to_toml()))
    return path


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "torque_noise",
            "torqe_noise",
            r"unknown keys: torqe_noise \(did you mean torque_noise\?\); missing keys",
        ),
        ("seed = 1\n", "", "missing keys: seed; known keys: description, engine"),
        ("command_delay = 0.0", "command_delay = 3.0", "allowed: 0 to 0.1 s"),
        ('inertia = "drake"', 'inertia = "kuka"', "drake, pybullet, lbr"),
        ('engine = "mujoco"', 'engine = "ode"', "known: mujoco, bullet"),
        (
            "mass_scale = [1.02",
            "mass_scale = [-1.0",
            r"mass_scale\[A1\] is -1; allowed",
        ),
        (
            "coulomb = [0.1, ",
            "coulomb = [",
            r"coulomb has shape \(6,\); give 7 values \(A1",
        ),
        (
            "mass_scale = [1.02",
            "mass_scale = ['x'",
            r"mass_scale\[A1\] is 'x', .* 0.1 to",
        ),
        (
            "mass_scale = [1.02",
            "mass_scale = [nan",
            r"mass_scale\[A1\] is nan; allowed",
        ),
        (
            "torque_noise = 0.02",
            "torque_noise = inf",
            "is inf Nm; allowed: 0 to 20 Nm",
        ),
        ("torque_noise = 0.02", 'torque_noise = "big"', "which is no number"),
        ("seed = 1", "seed = = 1", "is not TOML"),
    ],
)
def test_damaged_file_is_refused_with_what_is_known(tmp_path, old, new, words):
    path = written(tmp_path, lambda text: text.replace(old, new))
    with pytest.raises(ConfigError, match=words):
        load_twin(path)


def test_a_description_is_text():
    with pytest.raises(ConfigError, check=about("description")):
        replace(IDEAL, description=3)


@pytest.mark.parametrize("name", list_twins())
@pytest.mark.parametrize("period", PERIODS)
def test_a_twins_delay_is_the_same_at_every_period(name, period):
    """A torque that rises is late by the delay: so is the speed it gives."""
    silent = {"torque_noise": 0.0, "velocity_noise": 0.0, "position_noise": 0.0}
    free = {"coulomb": (0.0,) * 7, "gravity_residual": (0.0,) * 3}
    twin = replace(load_twin(name), **silent, **free)

    def gained(delay, slope):
        """Return the speed of A7 after 50 ms of a torque that rises [rad/s]."""
        moved = replace(twin, command_delay=delay, damping=(0.0,) * 7)
        plant = make_twin(moved, find_cell())
        plant.reset(Q_BENT, HOLE)
        for k in range(round(0.05 / period)):
            plant.apply(slope * period * (k + 0.5) * np.eye(7)[6], period)
        return plant.read()[1][6]

    def impulse(delay):
        return gained(delay, 10.0) - gained(delay, 0.0)  # without the weight's part

    late, delay = impulse(twin.command_delay), twin.command_delay
    expected = (0.05 - delay) ** 2 / 0.05**2  # the integral of a ramp
    assert late / impulse(0.0) == pytest.approx(expected, abs=2e-3)


def test_unknown_twin_lists_the_shipped_ones():
    with pytest.raises(ConfigError, match="easy, hard, medium"):
        load_twin("impossible")


def test_negative_true_clearance_is_refused():
    with pytest.raises(ConfigError, match=r"clearance of 0\.5 mm negative"):
        make_twin(replace(IDEAL, clearance_offset=-0.001), find_cell())
