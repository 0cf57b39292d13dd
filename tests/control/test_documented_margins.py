"""The margins that the documents name are those of the code."""

from pathlib import Path

import pytest

from dovetail.control.config import LimitConfig
from dovetail.envs.registered import find_cell
from dovetail.settings import values_of

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize(
    ("page", "margin", "words"),
    [
        ("real-robot.md", "delta_x", "At 5 ms the wall margin is {:g} mm"),
        ("control.md", "delta_q", "at 5 ms, of the {:g} of `delta_q`"),
    ],
)
def test_a_margin_at_5_ms_is_as_documented(page, margin, words):
    """They said 30 mm and 45 mrad, which had been changed to 20 and 50."""
    limits = LimitConfig.for_period(find_cell().loaded_robot(), 0.005)
    text = " ".join((DOCS / page).read_text().split())
    assert words.format(1e3 * values_of(limits)[margin]) in text
