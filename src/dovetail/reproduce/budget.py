"""Sizes of the experiments: smoke, quick or full."""

from collections.abc import Mapping
from dataclasses import field
from typing import Any

from dovetail.errors import ConfigError
from dovetail.settings import settings, values_of


@settings()
class IdentificationBudget:
    """Sizes of the logs and the fits."""

    sequences: int = 10
    """Sequences of an identification log."""
    sequence_steps: int = 50
    """Policy steps of each."""
    evaluations: int | None = None
    """Simulations of the log that a fit may use; None is the fit's own default."""


@settings()
class RobustnessBudget:
    """Disturbances, and what is tried under them."""

    shifts: tuple[float, ...] = (0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03)
    """Distances by which the hole is moved while the camera is covered [m]."""
    searches: tuple[float, ...] = (0.01, 0.02, 0.03)
    """The same, with the scripted search in the policy's place [m]."""
    search_tries: int = 10
    """Tries of it at each hole pose."""
    search_steps: int | None = None
    """Policy steps of such a try; None is the default of the search."""
    pushes: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0)
    """Largest random push on the arm [N]."""
    speeds: tuple[float, ...] = (0.0, 0.01, 0.02, 0.04)
    """Speed of the hole during the episode [m/s]."""
    robust: tuple[str, ...] = ("stack-0",)
    """Variants whose robustness is measured."""


@settings()
class Budget(IdentificationBudget, RobustnessBudget):
    """Sizes of the experiments; what is not here is the default of its command."""

    name: str
    """Name of the budget."""
    seeds: int
    """Training seeds per variant."""
    train: Mapping[str, Any] = field(default_factory=dict)
    """Settings of every training that differ from `TrainConfig`."""
    tries: int = 20
    """Tries at each hole pose."""
    other_direction: bool = False
    """Also train in MuJoCo and try on the twin in PyBullet."""

    def to_json(self) -> dict[str, Any]:
        """Return the sizes as JSON knows them."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values_of(self).items()
        }


SMOKE = Budget(
    name="smoke",
    seeds=1,
    train={
        "steps": 400,
        "net": [16, 16],
        "batch_size": 32,
        "learning_starts": 100,
        "updates_per_step": 1,
        "checkpoint_interval": 200,
        "max_steps": 40,
        "eval_episodes": 2,
    },
    sequences=2,
    sequence_steps=10,
    evaluations=60,
    tries=1,
    shifts=(0.0, 0.02),
    searches=(0.02,),
    search_tries=1,
    search_steps=100,
    pushes=(30.0,),
    speeds=(0.02,),
)
"""Every part once, as small as it runs: nothing is learned."""

QUICK = Budget(name="quick", seeds=1)
"""One seed per variant, everything else at full size."""

FULL = Budget(
    name="full",
    seeds=5,
    search_tries=20,
    robust=("stack-0", "stack-4", "randomised"),
    other_direction=True,
)
"""Five seeds per variant, as in the paper; robustness of all of them."""

BUDGETS = {budget.name: budget for budget in (SMOKE, QUICK, FULL)}


def find_budget(name: str) -> Budget:
    """Return a budget by its name.

    Raises:
        ConfigError: Unknown (lists the known ones).
    """
    if name not in BUDGETS:
        raise ConfigError(f"budget {name!r} is unknown; known: {', '.join(BUDGETS)}")
    return BUDGETS[name]
