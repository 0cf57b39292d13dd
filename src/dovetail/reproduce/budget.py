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
    """Disturbances of one policy on the first twin."""

    shifts: tuple[float, ...] = (0.005, 0.01, 0.015, 0.02, 0.025, 0.03)
    """Distances by which the hole is moved while the camera is covered [m]."""
    searches: tuple[float, ...] = (0.01, 0.02, 0.03)
    """The same, with the scripted search in the policy's place [m]."""
    search_steps: int | None = None
    """Policy steps of such a try; None is the default of the search."""
    pushes: tuple[float, ...] = (10.0, 20.0, 30.0)
    """Largest random push on the arm [N]."""
    speeds: tuple[float, ...] = (0.01, 0.02, 0.04)
    """Speed of the hole during the episode [m/s]."""


@settings()
class ArmBudget:
    """Trainings on the arm, over FRI."""

    failing: int
    """Policies that are fine-tuned there: nominal ones, seed by seed."""
    fine_tune_steps: int = 6000
    """Steps of each fine-tuning."""
    scratch_steps: int = 12_000
    """Steps of the training from nothing at one hole pose."""
    arm_tries: int = 20
    """Tries at that pose, before and after."""


@settings()
class Budget(IdentificationBudget, RobustnessBudget, ArmBudget):
    """Sizes of the experiments; what is not here is the default of its command."""

    name: str
    """Name of the budget."""
    seeds: int
    """Training seeds of the policies that no twin is known to."""
    twins: int
    """Twins that are drawn; each has one policy of every model that is its own."""
    bullet_seeds: int
    """Seeds of the decisive cells trained in PyBullet, for twice as many twins."""
    drake_twins: int
    """Twins that are also simulated by Drake."""
    drake_seeds: int
    """Seeds of the policies that are tried there."""
    paper_twins: int
    """Twins of the rows of the paper's table with another peg or a stack."""
    learner_seeds: int
    """Seeds of each learning algorithm."""
    train: Mapping[str, Any] = field(default_factory=dict)
    """Settings of every training that differ from `TrainConfig`."""
    tries: int = 4
    """Tries at each of three hole poses, on each twin."""

    def to_json(self) -> dict[str, Any]:
        """Return the sizes as JSON knows them."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values_of(self).items()
        }


SMOKE = Budget(
    name="smoke",
    seeds=1,
    twins=1,
    bullet_seeds=1,
    drake_twins=1,
    drake_seeds=1,
    paper_twins=1,
    learner_seeds=1,
    failing=1,
    fine_tune_steps=100,
    scratch_steps=100,
    arm_tries=1,
    train={
        "steps": 200,
        "net": [16, 16],
        "batch_size": 32,
        "learning_starts": 100,
        "checkpoint_interval": 200,
        "max_steps": 40,
        "eval_episodes": 2,
    },
    sequences=2,
    sequence_steps=10,
    evaluations=60,
    tries=1,
    shifts=(0.02,),
    searches=(0.02,),
    search_steps=100,
    pushes=(30.0,),
    speeds=(0.02,),
)
"""Every part once, as small as it runs: nothing is learned."""

QUICK = Budget(
    name="quick",
    seeds=3,
    twins=6,
    bullet_seeds=1,
    drake_twins=2,
    drake_seeds=1,
    paper_twins=2,
    learner_seeds=3,
    failing=3,
    train={"steps": 25_000, "eval_episodes": 100},
    tries=4,
    shifts=(0.01, 0.02, 0.03),
    searches=(0.03,),
    pushes=(30.0,),
    speeds=(0.04,),
)
"""Every cell with few seeds and twins, and trainings that end early."""

FULL = Budget(
    name="full",
    seeds=10,
    twins=20,
    bullet_seeds=5,
    drake_twins=6,
    drake_seeds=3,
    paper_twins=6,
    learner_seeds=5,
    failing=6,
    train={"steps": 50_000},
)
"""A fraction of the design for two cores and eight hours."""

BUDGETS = {budget.name: budget for budget in (SMOKE, QUICK, FULL)}


def find_budget(name: str) -> Budget:
    """Return a budget by its name.

    Raises:
        ConfigError: Unknown (lists the known ones).
    """
    if name not in BUDGETS:
        raise ConfigError(f"budget {name!r} is unknown; known: {', '.join(BUDGETS)}")
    return BUDGETS[name]
