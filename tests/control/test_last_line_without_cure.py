"""What the last line ends where nothing else helps: the cure off, on twins, in contact.

`passive=0, estimate_rate=300, posture_stiffness=0` bring back the loop that once went
wild with a robot's delay. Without the last line an arm leaves its limits then.
"""

import period_table
import pytest

from dovetail.evaluation.trials import plan_trials

NO_CURE = (("passive", 0.0), ("estimate_rate", 300.0), ("posture_stiffness", 0.0))
WILD = [("hard", period, 30.0) for period in (1.0, 2.0, 2.5)]
"""Twin, period [ms] and push [N] at which one of three tries leaves a limit."""
CALM = [("hard", 1.0, 0.0), ("hard", 2.0, 0.0), ("medium", 1.0, 0.0)]


def tries(row, **others):
    cell = period_table.Cell(
        *row, "hardware", False, "peg_square", (*NO_CURE, *others.items())
    )
    return [period_table.attempt(cell, job) for job in plan_trials(3, 1, 0)]


@pytest.mark.parametrize("row", WILD)
def test_without_it_the_arm_leaves_its_limits(row):
    """Else the test below could not fail."""
    assert any(t.outside for t in tries(row, last_line=0.0))


@pytest.mark.parametrize("row", [*WILD, *CALM])
def test_it_ends_the_motion_inside_the_limits(row):
    results = tries(row)
    assert any(t.flags["ended"] for t in results)
    assert all(t.flags["ended"] or t.success for t in results)
    for t in results:
        assert t.outside == 0
        assert t.speed <= 1.0
