"""Default settings of a training with doubt."""

from collections.abc import Mapping
from typing import Any

from dovetail.search.script import SCRIPT_SETTINGS

SEARCHING: Mapping[str, Any] = {
    **{name: SCRIPT_SETTINGS[name] for name in ("task", "theta_range")},
    "near_speed": 0.03,
    "also": ("tilt",),
    "recall": (4, 8, 12, 16),
    "max_steps": 300,
    "teacher": "corner",
    "learning_starts": 24_000,
    "steps": 100_000,
    "num_envs": 4,
    "updates_per_step": 1.0,
    "learning_rate": 1e-3,
    "policy_delay": 1,
    "tau": 0.005,
    "gamma": 0.98,
}
"""Settings of `TrainConfig` that `--doubt` begins with; each can be given otherwise.

A search tilts the part and must know where it has been; it takes seconds, which is
farther than the usual discount looks; and random actions never find what is to be
learned, so the first steps are a teacher's.
"""
