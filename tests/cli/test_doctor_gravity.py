"""What the doctor says of gravity that is missed is true, and fails outside alone."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arms.loopback import lockstep_address
from dovetail.arms.address import parse_address
from dovetail.cli import run
from dovetail.control.proven import DECLARED
from dovetail.doctor.fri_arm import run_fri_checks
from dovetail.doctor.gravity_error import check_gravity_error
from dovetail.doctor.simulated_arm import run_simulated_checks
from dovetail.envs.registered import find_cell
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.robots.missed_load import load_torques

HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
START = Pose(np.array([0.60, 0.0, 0.20]), tool_down(0.0))
MASS_7 = 2.5701  # of link 7 with gripper and peg [kg]


@pytest.fixture
def loaded():
    return find_cell().loaded_robot()


def at_start(robot):
    return robot.inverse_kinematics(START, robot.posture("rest"))


def gravity_check(twin):
    plant = make_twin(twin, find_cell())
    found = run_simulated_checks(plant, 0.005, DECLARED)
    return next(check for check in found if check.name == "gravity error")


def judge(robot, error):
    """The doctor's word on errors [Nm] that were measured to 0.05 Nm."""
    fits = [SimpleNamespace(offset=e, spread_of=lambda name: 0.05) for e in error]
    return check_gravity_error(robot, at_start(robot), fits, DECLARED)


def heavier(name, kilograms):
    twin = load_twin(name)
    *others, last = twin.mass_scale
    return replace(twin, mass_scale=(*others, last + kilograms / MASS_7))


@pytest.mark.parametrize("twin", ["easy", "medium", "hard"])
@pytest.mark.parametrize("period", ["1ms", "5ms"])
def test_every_shipped_twin_passes(twin, period, capsys):
    """6 % at A2 of `hard` failed: "allowed are 5 %: correct the load data"."""
    assert run(["doctor", "--arm", f"twin:{twin}", "--period", period]) == 0
    text = capsys.readouterr().out
    assert "broken" not in text
    assert "correct the load data" not in text
    if twin != "easy":
        assert "masses of the arm's own links" in text
        assert "A tare takes it off before each try" in text


def test_a_shipped_twin_behind_a_cabinet_is_held_for_good():
    """The external torque is the same gravity error, and was allowed 5 % as well."""
    plant = make_twin(load_twin("hard"), find_cell())
    plant.reset(at_start(plant.robot), HOLE)
    with lockstep_address(plant) as address:
        found = run_fri_checks(parse_address(f"{address}&reset=move"), None)
        check = next(check for check in found if check.name == "hold")
    assert check.status == "ok"
    assert "at A2" in check.detail


@pytest.mark.parametrize(
    "changes",
    [
        {"mass_scale": (1.2,) * 7},
        {"mass_scale": (0.8,) * 7},
        {"gravity_residual": (0.0, 0.0, -1.0)},
        {
            "mass_scale": (1.2,) * 6 + (1.2 + 1.0 / MASS_7,),
            "gravity_residual": (1.0, -1.0, -1.0),
        },
    ],
)
def test_a_twin_inside_the_declared_range_passes(changes):
    assert gravity_check(replace(load_twin("easy"), **changes)).status == "ok"


@pytest.mark.parametrize("kilograms", [2.0, 3.0, 5.0])
def test_a_payload_outside_the_range_is_told_however_large_the_torque(kilograms):
    """At 3 kg the sentence on gravity, A4 above 5 %, took its place."""
    check = gravity_check(heavier("easy", kilograms))
    assert check.status == "broken"
    told = re.search(r"the payload's error is (\S+) kg", check.detail)
    assert told is not None
    assert float(told[1]) == pytest.approx(kilograms, abs=0.05)
    assert "shown to hold: 0 to 1 kg; give the tool's true load data" in check.detail


def test_what_no_load_explains_is_told_to_be_identified():
    check = gravity_check(replace(load_twin("easy"), mass_scale=(0.4,) * 7))
    assert check.status == "broken"
    assert "no load at the flange explains it" in check.detail
    assert "at A2 that is 3" in check.detail
    assert "inside the declared range it is 0 to 3" in check.detail
    assert "identify the arm (dovetail identify)" in check.detail
    assert "load data" not in check.detail


def test_a_load_beside_its_place_is_told_to_be_corrected(loaded):
    """Within 1 kg, but its centre of mass is 0.3 m off: 2.6 Nm at A6 and A7."""
    terms = load_torques(loaded, at_start(loaded))
    check = judge(loaded, terms @ [0.9, 0.27, 0.0, 0.0])
    assert check.status == "broken"
    assert "inside the declared range it is 0 to 2.0 Nm" in check.detail
    assert "correct the load data" in check.detail


def test_few_arms_inside_the_range_look_like_a_payload_outside_it(loaded, rng):
    q, broken = at_start(loaded), 0
    for _ in range(500):
        mass = loaded.links.mass * rng.uniform(0.8, 1.2, 7)
        true = replace(loaded, links=replace(loaded.links, mass=mass))
        error = true.chain().gravity(q) - loaded.chain().gravity(q)
        broken += judge(loaded, error + rng.normal(0.0, 0.05, 7)).status != "ok"
    assert broken <= 10
