"""The search on functions whose minimum is known."""

import numpy as np
import pytest

from dovetail.identify.search import Search, Space
from extras import need

need("cmaes")

SPACE = Space(np.array([-1.0, 0.0, 0.0]), np.array([1.0, 4.0, 10.0]), np.zeros(3))
OPTIMUM = np.array([0.3, 1.0, 7.0])


def error(vector):
    return float(np.linalg.norm((vector - OPTIMUM) / (SPACE.high - SPACE.low)))


def new_search(seed=0):
    mean = np.full(3, 0.5)
    return Search(SPACE, mean, np.eye(3) * 0.04, error(SPACE.to_values(mean)), seed)


def advance(search, generations):
    told = []
    for _ in range(generations):
        told.append([error(v) for v in search.ask()])
        search.tell(told[-1])
    return told


def test_it_finds_a_minimum_inside_the_bounds():
    search = new_search()
    while not search.has_converged():
        advance(search, 1)
    np.testing.assert_allclose(search.best_vector, OPTIMUM, atol=2e-5)
    assert search.evaluations < 2000


def test_every_vector_is_inside_the_bounds():
    search = new_search()
    for _ in range(20):
        vectors = np.array(search.ask())
        assert (vectors >= SPACE.low).all()
        assert (vectors <= SPACE.high).all()
        search.tell([float(v[0]) for v in vectors])  # pulls to the lower bound


def test_the_best_error_never_rises():
    search = new_search()
    advance(search, 15)
    assert search.history == sorted(search.history, reverse=True)
    assert search.best == pytest.approx(error(search.best_vector))


def test_told_the_same_values_it_asks_the_same():
    """This is what a checkpoint rests on."""
    one, other = new_search(seed=4), new_search(seed=4)
    for values in advance(one, 6):
        other.ask()
        other.tell(values)
    np.testing.assert_array_equal(one.ask(), other.ask())
    np.testing.assert_array_equal(one.best_vector, other.best_vector)


def test_another_seed_asks_otherwise():
    assert np.abs(np.subtract(new_search(1).ask(), new_search(2).ask())).max() > 0.01


def test_it_ends_where_noise_is_all_that_is_left(rng):
    search = new_search()
    while not search.has_converged():
        search.tell([1.0 + 1e-4 * rng.random() for _ in search.ask()])
    assert search.evaluations < 500
