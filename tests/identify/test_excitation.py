import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.identify.excitation import FREQUENCIES, excitation


def test_actions_fill_their_range_on_every_axis():
    actions = excitation(0)
    assert actions.shape == (10, 50, 4)
    np.testing.assert_allclose(np.abs(actions).max(axis=1), 1.0)


def test_actions_hold_no_other_frequency_than_stated():
    spectrum = np.abs(np.fft.rfft(excitation(3), axis=1))
    frequencies = np.fft.rfftfreq(50, 0.05)
    stated = np.isclose(frequencies[:, None], FREQUENCIES).any(axis=1)
    assert spectrum[:, ~stated].max() < 1e-9 * spectrum.max()


def test_the_tool_ends_where_it_began():
    np.testing.assert_allclose(excitation(1).sum(axis=1), 0.0, atol=1e-9)


def test_another_seed_gives_other_actions_and_the_same_seed_the_same():
    np.testing.assert_array_equal(excitation(5), excitation(5))
    assert np.abs(excitation(5) - excitation(6)).max() > 0.5


def test_more_sequences_leave_the_first_ones_as_they_are():
    np.testing.assert_array_equal(excitation(0, 4)[:2], excitation(0, 2))


@pytest.mark.parametrize(
    ("counts", "message"),
    [
        ((-1,), "excitation seed is -1; allowed: 0 to 9223372036854775807"),
        ((0, 0), "excitation sequences is 0; allowed: 1 to 1000 sequences"),
        ((0, 1, 1), "excitation steps is 1; allowed: 2 to 10000 steps"),
        ((0, 10**9), "excitation sequences is 1000000000; allowed: 1 to 1000"),
    ],
)
def test_a_count_that_is_too_small_is_named(counts, message):
    with pytest.raises(ConfigError, match=message):
        excitation(*counts)
