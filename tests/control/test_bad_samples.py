"""Wrong positions behind FRI, where velocities are made of them."""

import numpy as np
import pytest
from bad_samples import Case

MOST = 20.0  # Nm, of one cycle


@pytest.mark.parametrize(
    ("scene", "seed"),
    [
        ("rest", 0),  # 32 Nm: the torque that answered one wrong sample was held
        ("motion", 0),  # 65 Nm after two, and 4 cycles outside a wall
        ("motion", 2),  # 5 cycles outside a wall, after five in turns of sign
        ("motion", 5),  # 38 cycles: a surprise came back that was refuted
    ],
)
def test_a_spike_on_a_late_arm_is_worth_a_bounded_torque(scene, seed):
    case = Case("hard", scene, "observed", 0.005)
    rng = np.random.default_rng([seed, *map(ord, case.name)])
    case.episode(rng, is_clean=True)
    while case.tally.spikes < 420:
        case.episode(rng, is_clean=False)
    case.arm.close()
    assert case.tally.broken == 0
    assert 1.0 < case.tally.step < MOST, case.tally.worst
