"""Checks of a cabinet's spring name its stiffness as surely as it is known."""

import numpy as np
import pytest

from dovetail.doctor.cabinet_spring import check_spring
from dovetail.doctor.torque_balance import JointFit

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
    before = fits(0.0, 0.0, damping)
    return check_spring(fits(stiffness, spread), before, 0.005, INERTIA, 0.005)


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
