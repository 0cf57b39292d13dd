"""Joints of parts, which every engine must step alike."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.plants.find import make_plant
from dovetail.poses import rotation_error
from dovetail.workcell.joints import Detent, Joint
from dovetail.workcell.parts import Moving, Part, Primitive, require_steppable
from plants.conftest import HOLE, Q_BENT, TOOL_DOWN, start_above

G = 9.81
DT = 0.005
UP, ACROSS = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
BASE = Primitive("base", "box", (0.05, 0.05, 0.01), np.array([0.0, 0.0, -0.06]))


def slide(mass=0.1, **facts):
    """Return a knob that slides upright, 10 mm below the fixture's frame and up."""
    facts = {"name": "slide", "kind": "slide", "axis": UP, "range": (-0.02, 0.02)} | (
        facts
    )
    size = (0.01, 0.01, 0.005)
    shape = Primitive("knob", "box", size, np.array([0.0, 0.0, -0.005]), mass=mass)
    return Moving(Joint(**facts), (shape,))


def flap(mass=0.1, **facts):
    """Return a flap that lies along x, 40 mm from its hinge to its middle."""
    facts = {"name": "hinge", "kind": "hinge", "axis": ACROSS, "range": (-1.0, 1.0)} | (
        facts
    )
    size = (0.03, 0.01, 0.002)
    shape = Primitive("flap", "box", size, np.array([0.04, 0.0, 0.0]), mass=mass)
    return Moving(Joint(**facts), (shape,))


def nut(pitch=0.02, mass=0.1, **facts):
    """Return a nut 20 mm wide on an upright screw, 10 mm below the fixture's frame."""
    facts = {"name": "nut", "kind": "screw", "axis": UP, "range": (-4.0, 4.0)} | facts
    size = (0.01, 0.01, 0.005)
    shape = Primitive("nut", "box", size, np.array([0.0, 0.0, -0.005]), mass=mass)
    return Moving(Joint(pitch=pitch, **facts), (shape,))


def on_fixture(*pieces):
    part = Part("moving fixture", (BASE,), pieces)
    return replace(find_cell(), make_fixture=lambda _: part)


def on_held(*pieces):
    cell = find_cell()
    return replace(cell, held=Part("moving peg", cell.held.primitives, pieces))


def rested(make, piece, seconds=1.0, period=DT, q=Q_BENT, **dynamics):
    """Return where a piece of the fixture is after so long, the arm standing aside."""
    plant = make(on_fixture(piece), **dynamics)
    plant.reset(q, HOLE)
    for _ in range(round(seconds / period)):
        plant.apply(np.zeros(7), period)
    return float(plant.part_positions()[0])


@pytest.mark.parametrize("period", [0.001, 0.005])
def test_a_spring_holds_a_weight_at_its_length(make, period):
    piece = slide(stiffness=200.0, damping=5.0)
    assert rested(make, piece, period=period) == pytest.approx(-0.1 * G / 200, rel=0.01)


def test_a_hinge_spring_holds_a_weight_at_its_angle(make):
    found = rested(make, flap(stiffness=0.5, damping=0.02))
    # about +y the flap's far end goes down: weight x arm = stiffness x angle
    assert 0.5 * found == pytest.approx(0.1 * G * 0.04 * np.cos(found), rel=0.01)


def test_a_stop_holds_a_weight_and_a_preload(make):
    assert rested(make, slide()) == pytest.approx(-0.02, abs=2e-5)
    preloaded = slide(stiffness=200.0, rest=0.05, range=(-0.02, 0.0))
    assert rested(make, preloaded) == pytest.approx(0.0, abs=2e-5)
    assert rested(make, flap(range=(-1.0, 0.3))) == pytest.approx(0.3, abs=1e-3)


def test_dry_friction_holds_a_weight_below_it_and_brakes_one_above(make):
    assert rested(make, slide(friction=1.05 * 0.1 * G)) == pytest.approx(0, abs=5e-5)
    falling = slide(friction=0.5 * 0.1 * G)
    fallen = -0.5 * 0.5 * G * 0.05**2
    found = rested(make, falling, 0.05, physics_dt=5e-4, period=0.001)
    assert found == pytest.approx(fallen, rel=0.03)


@pytest.mark.parametrize(("share", "holds"), [(0.97, True), (1.03, False)])
def test_a_detent_lets_go_at_its_force(make, share, holds):
    detent = Detent(0.0, 0.1 * G / share, 0.004)
    piece = slide(detents=(detent,), damping=2.0, start=-0.002)  # where it is largest
    found = rested(make, piece, 2.0)
    assert (abs(found) < 0.0021) == holds
    assert (found < -0.015) != holds


def test_a_spring_swings_with_its_period(make):
    piece = slide(stiffness=100.0, start=0.01, rest=0.1 * G / 100)
    plant = make(on_fixture(piece), physics_dt=2.5e-4)
    plant.reset(Q_BENT, HOLE)
    crossings, last = [], 0.01
    for i in range(500):
        plant.apply(np.zeros(7), 0.001)
        now = float(plant.part_positions()[0])
        if last < 0.0 <= now:
            crossings.append((i + last / (last - now)) * 0.001)
        last = now
    expected = 2.0 * np.pi * np.sqrt(0.1 / 100.0)
    assert crossings[1] - crossings[0] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("x", [0.2, 0.99])
def test_a_spring_swings_as_implicit_euler_steps_it(make, x):
    """With x = omega h: q_n = q_0 (1 + x^2)^(-n/2) cos(n atan x)."""
    h, n, start = 0.001, 12, 0.01
    stiffness = 0.1 * (x / h) ** 2
    piece = slide(stiffness=stiffness, start=start, rest=0.1 * G / stiffness)
    plant = make(on_fixture(piece))
    plant.reset(Q_BENT, HOLE)
    found = []
    for _ in range(n):
        plant.apply(np.zeros(7), h)
        found.append(float(plant.part_positions()[0]))
    steps = np.arange(1, n + 1)
    expected = start * (1.0 + x * x) ** (-steps / 2.0) * np.cos(steps * np.arctan(x))
    np.testing.assert_allclose(found, expected, atol=0.01 * start)


def test_a_nut_falls_by_its_lead_against_both_inertias(make):
    pitch, t = 0.1, 0.1
    lead, inertia = pitch / (2.0 * np.pi), 0.1 * (0.02**2 + 0.02**2) / 12.0
    fallen = -0.5 * 0.1 * G * lead / (inertia + 0.1 * lead**2) * t**2
    piece = nut(pitch, range=(-4.0, 4.0))
    assert piece.inertia() == pytest.approx(inertia + 0.1 * lead**2)
    found = rested(make, piece, t, physics_dt=2.5e-4, period=0.001)
    assert -4.0 < fallen < -2.0
    assert found == pytest.approx(fallen, rel=0.01)


@pytest.mark.parametrize("pitch", [0.02, -0.02, 0.002])
def test_a_nuts_spring_holds_its_weight_by_its_lead(make, pitch):
    torque = 0.1 * G * pitch / (2.0 * np.pi)
    stiffness = abs(torque)  # an angle of 1 rad
    found = rested(make, nut(pitch, stiffness=stiffness, damping=0.2 * stiffness), 3.0)
    assert found == pytest.approx(-np.sign(pitch), rel=0.01)


@pytest.mark.parametrize("share", [0.97, 1.05])
def test_a_nut_locks_itself_by_friction_above_its_weights_torque(make, share):
    torque = 0.1 * G * 0.02 / (2.0 * np.pi)
    found = rested(make, nut(friction=share * torque), 1.0)
    assert (abs(found) < 0.01) == (share > 1.0)


def test_a_nuts_stop_holds_its_weight(make):
    assert rested(make, nut(range=(-1.0, 1.0))) == pytest.approx(-1.0, abs=2e-3)


@pytest.mark.parametrize("force", [5.0, 10.0])
def test_a_nut_pressed_by_the_tool_turns_by_force_times_lead(make, force):
    pitch, stiffness = 0.05, 0.1
    lead = pitch / (2.0 * np.pi)
    piece = nut(pitch, stiffness=stiffness, damping=0.01)
    plant = make(on_fixture(piece), contact_friction=1e-3)  # else it is held, too
    plant.reset(start_above(plant.robot, z=0.101), HOLE)
    before = plant.robot.tool_pose(plant.read()[0]).position[2]
    press(plant, force)
    found, felt = float(plant.part_positions()[0]), plant.contact_force()[2]
    assert felt == pytest.approx(force, rel=0.05)
    assert found == pytest.approx(-(felt + 0.1 * G) * lead / stiffness, rel=0.03)
    sunk = plant.robot.tool_pose(plant.read()[0]).position[2] - before
    assert sunk == pytest.approx(lead * found - 0.001, abs=1e-4)  # it goes with it


def press(plant, force, steps=400):
    """Press the tool down where it is, its place held by a soft spring."""
    chain = plant.robot.chain()
    start = plant.robot.tool_pose(plant.read()[0])
    for _ in range(steps):
        q, dq = plant.read()
        pose = plant.robot.tool_pose(q)
        spring = 2000.0 * (start.position - pose.position)
        turn = 30.0 * rotation_error(TOOL_DOWN, pose.quat_wxyz)
        J = chain.jacobian(q)
        wrench = np.array([spring[0], spring[1], -force, *turn])
        wrench -= np.array([80.0, 80.0, 80.0, 2.0, 2.0, 2.0]) * (J @ dq)
        plant.apply(J.T @ wrench - 0.5 * dq, DT)


def test_a_button_pressed_by_the_tool_rests_at_force_over_stiffness(make):
    plant = make(on_fixture(slide(stiffness=1500.0, damping=5.0)))
    plant.reset(start_above(plant.robot, z=0.101), HOLE)
    press(plant, 10.0)
    found, felt = float(plant.part_positions()[0]), plant.contact_force()[2]
    assert felt == pytest.approx(10.0, rel=0.05)
    assert found == pytest.approx(-(felt + 0.1 * G) / 1500.0, rel=0.01)
    press(plant, 60.0)  # against its stop, through which the force goes
    assert plant.part_positions()[0] == pytest.approx(-0.02, abs=1e-4)
    assert plant.contact_force()[2] == pytest.approx(60.0, rel=0.02)
    plant.reset(Q_BENT, HOLE)
    assert plant.part_positions()[0] == 0.0


def test_a_light_nut_that_its_friction_holds_does_not_run_under_the_tool(make):
    plant = make(on_fixture(nut(0.0015, mass=0.012, friction=0.3)))
    plant.reset(start_above(plant.robot, z=0.101), HOLE)
    press(plant, 60.0, 200)
    before = float(plant.part_positions()[0])
    press(plant, 60.0, 200)
    assert plant.contact_force()[2] == pytest.approx(60.0, rel=0.1)
    assert plant.part_positions()[0] == pytest.approx(before, abs=0.05)


def test_a_socket_wrench_turns_a_nut(engine):
    path = Path(__file__).parents[2] / "examples" / "08_parts_that_move.py"
    spec = importlib.util.spec_from_file_location("parts_that_move", path)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    way = example.WAYS[example.nut]
    found, peak = example.push(example.nut(), example.wrench(), way, engine, 1.5)
    assert found == pytest.approx(way[-1][-1] - way[0][-1], abs=0.07)  # less its play
    assert 0.0 < peak < 60.0


def foot(**facts):
    """Return a foot below the held part, which slides along the tool."""
    facts = {"name": "foot", "kind": "slide", "axis": UP, "range": (-0.02, 0.0)} | facts
    size = (0.01, 0.01, 0.005)
    shape = Primitive("foot", "box", size, np.array([0.0, 0.0, 0.02]), mass=0.05)
    return Moving(Joint(**facts), (shape,))


def test_a_held_piece_is_in_the_payload_and_is_not_counted_twice(make):
    cell = on_held(foot(stiffness=2000.0, rest=0.001, damping=5.0))
    assert cell.payload().mass == pytest.approx(find_cell().payload().mass + 0.05)
    plant = make(cell)
    plant.reset(start_above(plant.robot), HOLE)
    before = plant.read()[0]
    for _ in range(100):
        plant.apply(np.zeros(7), DT)
    np.testing.assert_allclose(plant.read()[0], before, atol=1e-3)


@pytest.mark.parametrize("force", [5.0, 40.0])
def test_contact_of_a_held_piece_is_felt_through_spring_and_stop(make, force):
    plant = make(on_held(foot(stiffness=1000.0, damping=5.0)))
    plant.reset(start_above(plant.robot, x=0.635, z=0.127), HOLE)
    press(plant, force)
    felt = plant.contact_force()[2]
    assert felt == pytest.approx(force, rel=0.05)
    pushed = min(0.02, (felt - 0.05 * G) / 1000.0)
    assert plant.part_positions()[0] == pytest.approx(-pushed, rel=0.01)


def swung(cell, make):
    """Swing an arm in MuJoCo and in another engine; return where each ends."""
    tau = np.array([8.0, -12.0, 4.0, 6.0, -2.0, 2.0, 1.0])
    ends = []
    for plant in (make_plant("mujoco", cell), make(cell)):
        plant.configure(replace(plant.dynamics, physics_dt=2e-4))
        plant.reset(Q_BENT, HOLE)
        for i in range(150):
            plant.apply(tau if i < 75 else -tau, 0.001)
        ends.append(np.concatenate([plant.read()[0], plant.part_positions()]))
        plant.close()
    return ends


def test_a_held_piece_and_the_arm_move_each_other_as_in_mujoco(make):
    """Both swing freely, and fast; the arm feels what it holds."""
    held = replace(
        flap(mass=0.5, name="swing", damping=0.02, range=(-3.0, 3.0)),
        joint=Joint(
            name="swing",
            kind="hinge",
            axis=np.array([0.3, 1.0, 0.2]),
            origin=np.array([0.0, 0.01, 0.02]),
            range=(-3.0, 3.0),
        ),
    )
    cell = on_held(held, foot(stiffness=100.0, armature=0.02, range=(-0.5, 0.5)))
    ends = swung(cell, make)
    assert np.abs(ends[0][:7] - Q_BENT).max() > 0.05
    assert np.abs(ends[0][7:]).max() > 0.3
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-2)


def test_a_held_nut_and_the_arm_move_each_other_as_in_mujoco(engine, make):
    axis = np.array([0.3, 1.0, 0.2])
    piece = nut(0.05, mass=0.5, axis=axis, stiffness=0.3, start=1.0)
    cell = on_held(piece)
    if engine == "bullet":
        with pytest.raises(ConfigError, match="nut"):
            make(cell)
        return
    ends = swung(cell, make)
    assert abs(ends[0][7] - 1.0) > 0.3
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-2)


def test_a_reset_puts_joints_where_they_start(make):
    plant = make(on_fixture(slide(start=0.01), flap(start=-0.5)))
    for _ in range(2):
        plant.reset(Q_BENT, HOLE)
        np.testing.assert_array_equal(plant.part_positions(), [0.01, -0.5])
        for _ in range(20):
            plant.apply(np.zeros(7), DT)
        assert np.abs(plant.part_positions() - [0.01, -0.5]).min() > 1e-3


def test_a_spring_too_stiff_for_the_step_is_refused_with_the_largest(make):
    plant = make(on_fixture(slide(stiffness=1e5)))
    plant.reset(Q_BENT, HOLE)
    with pytest.raises(ConfigError) as caught:
        plant.apply(np.zeros(7), DT)
    assert caught.value.name == "stiffness"
    assert caught.value.value == 1e5
    largest = float(str(caught.value.allowed[1]))
    piece = slide(stiffness=0.999 * largest)
    rested(make, piece, 0.1)


@pytest.mark.parametrize(
    ("facts", "name"),
    [
        ({"range": None}, "range"),
        ({"range": (0.01, -0.01)}, "range"),
        ({"range": (-0.01, np.inf)}, "range"),
        ({"range": (0.01, 0.02)}, "start"),
        ({"axis": (0.0, 0.0, 0.0)}, "axis"),
        ({"axis": (0.0, 1.0)}, "axis"),
        ({"stiffness": -1.0}, "stiffness"),
        ({"damping": np.nan}, "damping"),
        ({"friction": -0.1}, "friction"),
        ({"armature": -0.1}, "armature"),
        ({"rest": np.inf}, "rest"),
        ({"kind": "ball"}, "kind"),
        ({"kind": "screw"}, "pitch"),
        ({"kind": "screw", "pitch": np.nan}, "pitch"),
        ({"kind": "screw", "pitch": 0.2}, "pitch"),
        ({"pitch": 0.001}, "pitch"),
        ({"detents": ((0.03, 1.0, 0.001),)}, "detent"),
        ({"detents": ((0.0, 1.0, 0.0),)}, "detent"),
        ({"detents": ((0.0, -1.0, 0.001),)}, "force of a detent"),
    ],
)
def test_a_joint_that_cannot_be_is_refused_by_name(facts, name):
    with pytest.raises(ConfigError) as caught:
        slide(**facts)
    assert caught.value.name == name


def test_pieces_without_mass_and_names_twice_are_refused():
    with pytest.raises(ConfigError):
        slide(mass=0.0)
    with pytest.raises(ConfigError, match="slide"):
        on_fixture(slide(), slide())
    with pytest.raises(ConfigError, match="knob"):
        on_fixture(slide(), slide(name="other")).fixture  # noqa: B018
    cell = on_fixture(flap(name="foot"))
    with pytest.raises(ConfigError, match="foot"):
        replace(cell, held=on_held(foot()).held).joints  # noqa: B018


def test_a_hinge_turns_its_shapes_about_its_origin():
    piece = flap(origin=(0.01, 0.0, 0.0))
    (shape,) = piece.at(0.5)
    expected = [0.01 + 0.03 * np.cos(0.5), 0.0, -0.03 * np.sin(0.5)]
    np.testing.assert_allclose(shape.position, expected, atol=1e-12)
    assert piece.inertia() == pytest.approx(
        0.1 * (0.03**2 + (0.06**2 + 0.004**2) / 12.0)
    )


def test_a_screw_moves_its_shapes_along_its_axis_as_it_turns():
    (shape,) = nut(0.02).at(np.pi)
    np.testing.assert_allclose(shape.position, [0.0, 0.0, 0.005], atol=1e-12)
    np.testing.assert_allclose(np.abs(shape.quat_wxyz), [0, 0, 0, 1], atol=1e-12)
    (shape,) = nut(-0.02).at(np.pi)
    np.testing.assert_allclose(shape.position, [0.0, 0.0, -0.015], atol=1e-12)


def test_the_largest_stiffness_grows_with_inertia_and_shorter_steps():
    def largest(h, **facts):
        with pytest.raises(ConfigError) as caught:
            require_steppable([slide(stiffness=1e12, **facts)], h)
        return float(str(caught.value.allowed[1]))

    assert largest(0.001) == pytest.approx(0.1 / 0.001**2)
    assert largest(0.002) == pytest.approx(largest(0.001) / 4.0)
    assert largest(0.001, armature=0.1) == pytest.approx(2.0 * largest(0.001))
