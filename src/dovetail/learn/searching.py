"""What a training with doubt has in place of the usual settings."""

from collections.abc import Mapping
from typing import Any

from dovetail.search.corner import SEARCH_AXES

SEARCHING: Mapping[str, Any] = {
    "task": SEARCH_AXES,
    "also": ("tilt",),
    "recall": (4, 8, 12, 16),
    "theta_range": 0.3,
    "near_speed": 0.03,
    "max_steps": 300,
    "teacher": "corner",
    "learning_starts": 24_000,
    "steps": 100_000,
    "updates_per_step": 1.0,
    "gamma": 0.98,
}
"""Settings of `TrainConfig` that `--doubt` begins with; each can be given otherwise.

A search tilts the part and must know where it has been; it takes seconds, which is
farther than the usual discount looks; and random actions never find what is to be
learned, so the first steps are a teacher's.
"""
