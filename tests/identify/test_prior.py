"""The prior: what it weighs, and that it decides only what a log leaves open."""

import numpy as np
import pytest

from dovetail.identify.parameters import ParameterSet
from dovetail.identify.prior import FACTS_PER_SEQUENCE, Prior
from dovetail.identify.search import space_of
from dovetail.identify.warm_start import measure_warm_start

SEQUENCES = 10
PARAMETERS = ParameterSet.parse("gravity_z,mass_scale")


class TradedPlaces:
    """A population in which gravity_z and mass_scale do the same, but for `apart`."""

    deaths = 0

    def __init__(self, rng, planted, apart):
        self.planted = np.array(planted)
        self.sum, self.difference = rng.normal(size=(2, SEQUENCES * 50, 3))
        self.difference *= apart

    def motion(self, values):
        gravity, mass = values
        return (gravity + mass) * self.sum + (gravity - mass) * self.difference

    def errors(self, models):
        values = [(m.gravity_residual[2], m.mass_scale[0]) for m in models]
        return [self.motion(v) - self.motion(self.planted) for v in values]

    def close(self):
        pass


def found(population):
    prior = Prior(PARAMETERS, SEQUENCES)
    warm_start = measure_warm_start(prior, population, "mujoco", warm=True)
    return space_of(PARAMETERS).to_values(warm_start.mean)


def test_one_standard_deviation_weighs_half_a_fact_of_all():
    prior = Prior(PARAMETERS, SEQUENCES)
    assert prior.factor(PARAMETERS.start) == 1.0
    moved = PARAMETERS.start + np.array([0.0, PARAMETERS.spread[1]])
    assert prior.factor(moved) == pytest.approx(
        np.exp(0.5 / (SEQUENCES * FACTS_PER_SEQUENCE))
    )


def test_what_the_log_leaves_open_stays_plausible(rng):
    """Of all pairs with the right sum it is the one nearest to the model."""
    gravity, mass = found(TradedPlaces(rng, [1.3, 0.5], apart=0.0))
    assert gravity + mass == pytest.approx(1.8, abs=1e-3)
    shares = PARAMETERS.spread**2 / (PARAMETERS.spread**2).sum()
    np.testing.assert_allclose([gravity, mass - 1.0], 0.8 * shares, atol=0.02)


def test_what_the_log_tells_is_not_pulled(rng):
    values = found(TradedPlaces(rng, [1.3, 0.5], apart=0.1))
    np.testing.assert_allclose(values, [1.3, 0.5], atol=1e-4)
