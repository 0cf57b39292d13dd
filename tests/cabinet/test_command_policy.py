"""What commands, and missing ones, do to a motion."""

import math
from types import SimpleNamespace

import pytest

from dovetail.cabinet.command_policy import CommandPolicy
from dovetail.cabinet.config import CabinetConfig
from dovetail.robots.iiwa14 import iiwa14

ZERO = [0.0] * 7
IPO = [0.1 * i for i in range(7)]


def command(q=None, tau=None):
    return SimpleNamespace(q=q, tau=tau, wrench=None)


def make(**changes):
    policy = CommandPolicy(CabinetConfig(**changes), iiwa14())
    policy.begin(list(IPO))
    return policy


def moved(q, joint, by):
    return [v + by if i == joint else v for i, v in enumerate(q)]


def test_a_client_that_mirrors_long_enough_is_synchronised():
    policy = make(sync_slots=5)
    for _ in range(5):
        assert not policy.is_synchronised
        policy.mirror(command(IPO, ZERO))
    assert policy.is_synchronised
    assert policy.waits_for == ""


@pytest.mark.parametrize("distance", [0.1, 0.149, -0.149])
def test_what_real_cabinets_accept_mirrors(distance):
    policy = make(sync_slots=1)
    policy.mirror(command(moved(IPO, 3, distance), [5.0] * 7))
    assert policy.is_synchronised


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (None, "no command in time"),
        (command(None, ZERO), "without joint position"),
        (command(IPO, None), "without joint torque"),
        (command(moved(IPO, 2, 0.2), ZERO), "A3 commanded +0.2000 rad from"),
        (command(moved(IPO, 6, math.nan), ZERO), "A7 commanded"),
    ],
)
def test_what_does_not_mirror_starts_the_count_again(given, reason):
    policy = make(sync_slots=2)
    policy.mirror(command(IPO, ZERO))
    policy.mirror(given)
    assert not policy.is_synchronised
    policy.mirror(command(IPO, ZERO))
    assert not policy.is_synchronised
    policy.mirror(given)
    assert reason in policy.waits_for


def test_a_strict_tolerance_wants_the_interpolator_itself():
    policy = make(mirror_tolerance=0.0, sync_slots=1)
    policy.mirror(command(moved(IPO, 0, 1e-9), ZERO))
    assert not policy.is_synchronised
    policy.mirror(command(list(IPO), ZERO))
    assert policy.is_synchronised


def act(policy, given, q=IPO, gravity=ZERO):
    return policy.act(given, list(q), list(gravity))


def test_a_command_acts():
    policy = make()
    assert act(policy, command(IPO, [1.0] * 7)) == ""
    assert policy.tau == [1.0] * 7
    assert policy.q == IPO


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (command(None, ZERO), "without joint position"),
        (command(IPO, None), "without joint torque"),
        (command(moved(IPO, 1, math.nan), ZERO), "illegal axis delta: A2"),
        (command(IPO, [math.inf] + [0.0] * 6), "torque limit: A1"),
        (command(IPO, [0.0, 321.0, 0.0, 0.0, 0.0, 0.0, 0.0]), "torque limit: A2"),
        (command(moved(IPO, 0, 0.1), ZERO), "commanded speed: A1"),
    ],
)
def test_an_illegal_command_stops_and_does_not_act(given, reason):
    policy = make()
    act(policy, command(IPO, [1.0] * 7))
    assert reason in act(policy, given)
    assert policy.tau == [1.0] * 7


def test_torque_limits_count_gravity():
    policy = make()
    tau = [0.0, 300.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert act(policy, command(IPO, tau)) == ""
    heavy = [0.0, 30.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert "torque limit: A2" in act(policy, command(IPO, tau), gravity=heavy)


def test_a_position_far_from_the_measured_one_is_an_illegal_axis_delta():
    policy = make()
    limit = math.radians(10.0)
    near = moved(IPO, 4, limit - 1e-3)
    far = moved(IPO, 4, -limit - 1e-3)
    assert act(policy, command(IPO, ZERO), q=near) == ""
    assert "illegal axis delta: A5" in act(policy, command(IPO, ZERO), q=far)


def test_missed_commands_are_held_then_dropped_then_stop():
    policy = make(hold_slots=3, stop_slots=6)
    act(policy, command(IPO, [2.0] * 7))
    for _ in range(3):
        assert act(policy, None) == ""
        assert policy.tau == [2.0] * 7
    for _ in range(2):
        assert act(policy, None) == ""
        assert policy.tau == ZERO
    assert act(policy, None) == "6 commands missed in a row"


def test_a_command_after_missed_ones_may_have_moved_on():
    policy = make(command_speed_factor=1.0, hold_slots=3, stop_slots=6)
    step = 1.2 * float(iiwa14().limits.dq_max[0]) * 0.005
    assert "commanded speed" in act(policy, command(moved(IPO, 0, step), ZERO))
    act(policy, command(IPO, ZERO))
    act(policy, None)
    assert act(policy, command(moved(IPO, 0, step), ZERO)) == ""
    assert policy.missed == 0


@pytest.mark.parametrize(
    ("q", "dq", "reason"),
    [
        (moved(ZERO, 5, 2.2), ZERO, "joint limit: A6"),
        (ZERO, moved(ZERO, 3, 1.6), "joint speed: A4"),
        (ZERO, moved(ZERO, 3, 1.5), ""),
        (moved(ZERO, 0, math.nan), ZERO, "joint limit: A1"),
    ],
)
def test_joints_outside_their_limits_stop(q, dq, reason):
    found = make().check_joints(q, dq)
    assert reason in found
    assert bool(found) == bool(reason)
