"""What the adversary in contact takes for an oscillation that grows."""

import numpy as np
import pytest
from attacks.contact_growth import GROWN, lasts, oscillation

RISING = np.repeat([0.02, 0.05, 0.08, 0.11, 0.16], 5)  # rad/s per action
QUIET_SECOND = np.full(20, 0.01)


def test_what_rises_in_every_window_grows():
    grown, sustained = oscillation(RISING)
    assert grown == pytest.approx(0.16)
    assert sustained == pytest.approx(0.05)


@pytest.mark.parametrize(
    "windows",
    [
        (0.02, 0.05, 0.08, 0.09, 0.16),  # by less than a fifth, once
        (0.01, 0.02, 0.04, 0.06, 0.09),  # not above what may vibrate
    ],
)
def test_what_does_not_is_no_growth(windows):
    grown, _ = oscillation(np.repeat(windows, 5))
    assert grown == 0.0


def test_what_is_as_strong_later_lasts():
    assert lasts(0.16, np.full(20, 0.17), None, "none")
    assert not lasts(0.16, QUIET_SECOND, None, "none")


@pytest.mark.parametrize("cause", ["speed", "energy"])
def test_what_a_stop_shakes_is_no_oscillation(cause):
    quiet_before, loud_before = (
        np.full(5, 0.07),
        np.array([0.07, 0.09, GROWN + 0.01]),
    )
    assert not lasts(0.16, QUIET_SECOND, quiet_before, cause)
    assert lasts(0.16, QUIET_SECOND, loud_before, cause)
    assert lasts(0.16, np.full(20, 0.17), quiet_before, cause)  # the stop goes on


def test_what_the_last_line_ended_as_an_oscillation_is_one():
    assert lasts(0.16, QUIET_SECOND, np.full(5, 0.01), "oscillation")
