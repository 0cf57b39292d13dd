"""Cycles that are missing in a log are filled where they are few."""

import numpy as np

from dovetail.doctor.log_gaps import longest_filled
from dovetail.doctor.torque_balance import WINDOW
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS

PERIOD = 0.002


def log_of(count):
    """A log whose position and torque are ramps."""
    log = np.zeros((count, len(CYCLE_COLUMNS)))
    log[:, COLUMN["time"]] = 7.0 + PERIOD * np.arange(count)
    log[:, COLUMN["q3"]] = np.arange(count)
    log[:, COLUMN["tau2"]] = np.arange(count)
    return log


def test_a_whole_log_stays_as_it_is():
    np.testing.assert_array_equal(longest_filled(log_of(50), PERIOD), log_of(50))


def test_missing_cycles_hold_the_torque_and_lie_on_the_way_of_the_position():
    whole = log_of(50)
    filled = longest_filled(np.delete(whole, [20, 21, 40], axis=0), PERIOD)
    np.testing.assert_allclose(filled[:, COLUMN["q3"]], np.arange(50.0))
    np.testing.assert_allclose(filled[:, 0], whole[:, 0])
    assert filled[19:23, COLUMN["tau2"]].tolist() == [19.0, 19.0, 19.0, 22.0]
    assert filled[40, COLUMN["tau2"]] == 39.0


def test_of_a_log_with_a_long_gap_the_longest_part_is_taken():
    missing = round(WINDOW / PERIOD) + 1
    log = np.delete(log_of(100), range(30, 30 + missing), axis=0)
    part = longest_filled(log, PERIOD)
    np.testing.assert_array_equal(part[:, COLUMN["q3"]], np.arange(30 + missing, 100.0))


def test_an_empty_log_has_no_part():
    assert len(longest_filled(log_of(0), PERIOD)) == 0
