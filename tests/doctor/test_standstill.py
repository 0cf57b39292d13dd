"""What is said of an arm's torque while it is held."""

import numpy as np
import pytest

from dovetail.doctor.standstill import measure_standstill
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS

PERIOD = 0.001


def log_of(tau, period=PERIOD):
    log = np.zeros((len(tau), len(CYCLE_COLUMNS)))
    log[:, 0] = np.arange(len(tau)) * period
    log[:, COLUMN["tau2"]] = tau
    return log


def test_noise_is_measured_and_is_no_oscillation():
    noise = 3.0 * np.random.default_rng(0).normal(size=2000)
    drift = np.linspace(0.0, 50.0, 2000)
    resting = measure_standstill(log_of(noise + drift), PERIOD)
    assert resting.torque[1] == pytest.approx(3.0, rel=0.1)
    assert resting.joint == 1
    assert not resting.is_oscillating


def test_an_oscillation_is_told_with_its_frequency():
    t = np.arange(2000) * PERIOD
    noise = 0.5 * np.random.default_rng(0).normal(size=2000)
    resting = measure_standstill(
        log_of(4.0 * np.sin(2 * np.pi * 27.0 * t) + noise), PERIOD
    )
    assert resting.is_oscillating
    assert resting.frequency == pytest.approx(27.0, abs=0.6)
    assert resting.growth == pytest.approx(1.0, abs=0.2)


def test_an_oscillation_that_grows_is_one_from_its_begin_on():
    t = np.arange(1000) * PERIOD
    wave = 0.1 * np.exp(6.0 * t) * np.sin(2 * np.pi * 40.0 * t)
    resting = measure_standstill(log_of(wave), PERIOD)
    assert resting.is_oscillating
    assert resting.growth > 10.0


def test_a_quiet_arm_does_not_oscillate_whatever_its_spectrum():
    t = np.arange(1000) * PERIOD
    assert not measure_standstill(
        log_of(0.5 * np.sin(100.0 * t)), PERIOD
    ).is_oscillating
    assert not measure_standstill(log_of(np.zeros(1000)), PERIOD).is_oscillating
