"""What is said of a spring that was felt, and how surely."""

import numpy as np
import pytest

from dovetail.feel.feeling import Feeling
from dovetail.feel.loop_delay import LoopDelay
from dovetail.feel.torque_balance import JointFit
from dovetail.feel_checks import check_spring

INERTIA = np.diag([3.0, 3.0, 2.0, 2.0, 0.3, 0.2, 0.1])
SPRING = list(JointFit._fields).index("sent_spring")


def fits(stiffness, spread, damping=1.0):
    spreads = np.zeros(6)
    spreads[SPRING] = spread
    return tuple(
        JointFit(1.0, damping, 0.1, 0.0, stiffness, 0.0, spreads, 0.1)
        for _ in "1234567"
    )


def said(stiffness, spread, damping=1.0):
    feeling = Feeling(LoopDelay(0.005, 1e-4, True), fits(0.0, 0.0, damping), 0.01)
    return check_spring(fits(stiffness, spread), feeling, INERTIA, 0.005)


@pytest.mark.parametrize(("stiffness", "spread"), [(0.0, 1.0), (8.0, 0.1), (40.0, 9.0)])
def test_what_is_small_or_uncertain_is_no_spring(stiffness, spread):
    assert said(stiffness, spread).status == "ok"


def test_a_spring_that_is_known_well_is_named():
    assert "about 100 Nm/rad" in said(100.0, 5.0).detail


def test_of_one_that_is_known_badly_it_is_said_what_it_is_at_least():
    """100 Nm/rad, 18 Nm/rad of doubt at each of seven joints."""
    assert "at least 80 Nm/rad" in said(100.0, 18.0).detail


def test_friction_is_not_taken_for_the_cabinets_damping():
    assert "no damping" in said(200.0, 1.0, damping=4.0).detail
    assert "a ratio of about 0." in said(200.0, 1.0, damping=30.0).detail
