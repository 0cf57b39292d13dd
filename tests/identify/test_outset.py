"""Where a search begins: least-squares steps on motions whose answer is known."""

import numpy as np
import pytest

from dovetail.identify.parameters import ParameterSet
from dovetail.identify.prior import Prior
from dovetail.identify.search import EXACT, space_of
from dovetail.identify.warm_start import measure_warm_start

PARAMETERS = ParameterSet.parse("gravity_x,gravity_z,mass_scale")
PLANTED = np.array([0.3, -0.4, 1.07])
SEQUENCES, CYCLES = 10, 100
JUMP = 3e-4
"""What a limit that acts a cycle earlier moves the rest of a sequence by [m]."""


class Motion:
    """A population whose TCP is linear in the parameters, with or without jumps.

    gravity_z and mass_scale trade places along a valley whose floor falls by less
    than a tenth of a jump in the distance between two of them.
    """

    deaths = 0

    def __init__(self, rng, jump, spacing=0.01):
        times = np.linspace(0.0, 1.0, CYCLES)
        size = (SEQUENCES, CYCLES, 3)
        weight = rng.normal(size=(SEQUENCES, 1, 3)) * times[:, None]
        inertia = rng.normal(size=(SEQUENCES, 1, 3)) * np.sin(9.0 * times)[:, None]
        side = rng.normal(size=(SEQUENCES, 1, 3)) * times[:, None] ** 2
        assert weight.shape == size
        self.slopes = (0.1 * side, 0.03 * weight, 0.3 * weight + 0.01 * inertia)
        self.jump, self.spacing = jump, spacing
        self.begins = rng.uniform(0.2, 0.9, SEQUENCES)
        self.places = rng.uniform(0.0, 1.0, SEQUENCES)
        self.times = times

    def positions(self, values):
        moved = sum(v * s for v, s in zip(values, self.slopes, strict=True))
        # Each sequence has limits of its own, that act for some of the values.
        state = np.sum(values * [1.3, 0.7, 2.9]) / self.spacing / SEQUENCES
        acts = np.floor(state + self.places) % 2.0
        late = self.times > self.begins[:, None]
        return moved + self.jump * (acts[:, None] * late)[..., None]

    def errors(self, models):
        found = []
        for model in models:
            x, _, z = model.gravity_residual
            values = np.array([x, z, model.mass_scale[-1]])
            error = self.positions(values) - self.positions(PLANTED)
            found.append(error.reshape(-1, 3))
        return found

    def close(self):
        pass


def begin(motion):
    warm_start = measure_warm_start(
        Prior(PARAMETERS, SEQUENCES), motion, "mujoco", warm=True
    )
    return warm_start, space_of(PARAMETERS).to_values(warm_start.mean)


def test_a_linear_motion_is_solved_before_the_search(rng):
    warm_start, values = begin(Motion(rng, jump=0.0))
    np.testing.assert_allclose(values, PLANTED, atol=1e-4)
    assert warm_start.start < EXACT


@pytest.mark.parametrize("seed", range(5))
def test_limits_that_come_and_go_do_not_hold_it_up(seed):
    """The RMS has a minimum between any two jumps; the planted values are one."""
    motion = Motion(np.random.default_rng(seed), jump=JUMP)
    _, values = begin(motion)
    np.testing.assert_allclose(values, PLANTED, atol=2e-3)


def test_a_sequence_that_another_cause_moved_counts_little(rng):
    """A push on the arm in one sequence of ten."""
    motion = Motion(rng, jump=0.0)
    errors = motion.errors

    def pushed(models):
        found = errors(models)
        for error in found:
            error[:CYCLES] += 5e-3
        return found

    motion.errors = pushed
    _, values = begin(motion)
    np.testing.assert_allclose(values, PLANTED, atol=2e-3)


def test_it_counts_every_simulated_log(rng):
    motion, told = Motion(rng, jump=JUMP), []
    errors = motion.errors
    motion.errors = lambda models: told.append(len(models)) or errors(models)
    warm_start, _ = begin(motion)
    assert warm_start.evaluations == sum(told)
