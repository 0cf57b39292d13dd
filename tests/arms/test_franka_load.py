"""A load that is not the cell's is refused before a Franka is moved."""

import numpy as np
import pytest

from dovetail.arms.address import parse_address
from dovetail.arms.franka.at_rest import Rest
from dovetail.arms.franka.load import LoadError, load_beyond, require_true_load
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.robots.fr3 import fr3
from dovetail.robots.inertia import merge_bodies, require_inertia
from dovetail.robots.missed_load import load_torques
from dovetail.robots.robot import Payload
from dovetail.workcell.cell_config import CellConfig

from .stand_in import use_stand_in


def connect(host, config=None):
    """Connect the stand-in's arm with a cell's tool, and leave it."""
    cell = find_cell(robot="fr3", cell=config)
    settings = ControllerSettings(
        osc=OscConfig.for_period(1e-3),
        limits=LimitConfig.for_period(cell.loaded_robot(), 1e-3, walls=False),
        task=TaskSpec.parse("XYZ:force A:pose BC:hold"),
        period=1e-3,
    )
    arm = parse_address(f"franka://{host}").build(cell, settings)
    arm.close()
    return cell.payload().mass, arm


@pytest.fixture(autouse=True)
def stand_in(monkeypatch):
    use_stand_in(monkeypatch)


def refused(host, config=None):
    with pytest.raises(LoadError) as error:
        connect(host, config)
    assert error.value.reason == "wrong_load"
    return error.value


def test_the_load_of_the_cell_is_taken():
    mass, arm = connect("127.0.0.1")
    assert arm.rest.mass == pytest.approx(mass)
    assert arm.rest.hand == pytest.approx(0.73)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.7"])
def test_whatever_desk_knows_the_arm_compensates_what_the_cell_has(host):
    mass, arm = connect(host)
    assert arm.rest.hand == pytest.approx(0.0 if host.endswith("7") else 0.73)
    assert arm.rest.mass == pytest.approx(mass)
    np.testing.assert_allclose(arm.rest.com, arm.facts.robot.payload.com, atol=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_load_and_end_effector_are_the_whole(share):
    own = 0.01 * np.diag([1.0, 1.2, 0.9])
    part = 1.5, np.array([0.01, 0.0, 0.15]), own
    hand = 2.0 * share, np.array([0.0, 0.02, 0.04]), share * own
    mass, com, inertia = merge_bodies(part, hand)
    whole = Payload(mass=mass, com=com, inertia=inertia)
    for got, wanted in zip(load_beyond(whole, hand), part, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-12)


def test_an_end_effector_that_is_no_part_of_the_tool_leaves_a_point():
    whole = Payload(mass=2.0, com=np.array([0.0, 0.0, 0.1]), inertia=0.01 * np.eye(3))
    hand = 0.73, np.array([-0.01, 0.0, 0.3]), 0.02 * np.eye(3)
    mass, com, inertia = load_beyond(whole, hand)
    require_inertia(inertia, "the load")
    assert mass == pytest.approx(1.27)
    both = mass * com + hand[0] * hand[1]
    np.testing.assert_allclose(both, 2.0 * whole.com, atol=1e-12)


def test_an_end_effector_of_desk_that_is_heavier_than_the_cells_tool_is_refused():
    bare = CellConfig(tool="none", tool_length=0.10, tool_mass=0.3)
    error = refused("127.0.0.1", bare)
    assert error.hand == pytest.approx(0.73)
    assert 0.3 < error.cell < 0.73


def test_a_hand_of_the_cells_mass_is_the_same_hand():
    hand = 0.731, np.array([0.0, 0.0, 0.03]), 0.001 * np.eye(3)
    whole = Payload(mass=0.735, com=np.zeros(3), inertia=hand[2])
    assert load_beyond(whole, hand)[0] == 0.0


def test_2_kg_more_than_the_cell_says_are_seen_by_the_sensors():
    error = refused("127.0.0.4")
    assert error.found - error.cell == pytest.approx(2.0, abs=0.3)
    assert error.arm == pytest.approx(error.cell)


@pytest.mark.parametrize("mass", [0.0, 0.5, 2.0, 4.5])
def test_what_hangs_there_is_found_from_the_external_torque(mass):
    payload = Payload(mass=2.5, com=np.array([0, 0, 0.08]), inertia=0.01 * np.eye(3))
    robot = fr3().with_tool(payload, np.array([0.0, 0.0, 0.2]))
    q = robot.posture("down")
    moments = (mass - payload.mass) * np.array([1.0, *payload.com])
    external = load_torques(robot, q) @ moments
    rest = Rest(q, external, external, True, 0.7, payload.mass, payload.com)
    if abs(mass - payload.mass) < 1.0:
        require_true_load(robot, rest, external, 0.0)
        return
    with pytest.raises(LoadError) as error:
        require_true_load(robot, rest, external, 0.0)
    assert error.value.found == pytest.approx(mass, abs=0.1)
    assert error.value.allowed == 1.0


def test_what_the_arm_compensates_in_vain_is_refused_at_once():
    error = refused("127.0.0.5?load=no")
    assert error.arm - error.cell == pytest.approx(1.83, abs=0.01)
    assert (error.found, error.hand) == (None, None)


def test_without_sensors_the_torque_that_holds_the_arm_tells_the_load():
    error = refused("127.0.0.6")
    assert error.found - error.cell == pytest.approx(2.0, abs=0.5)
