"""What tries of the adversary in contact have in common, promise and leave behind.

`contact_adversary` draws them at random, `contact_search` searches for the worst.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.robots.find import DEFAULT_ROBOT

from .contact_choices import POLICIES, RANGES, SIZE, TASKS, Array, Choices, choose
from .contact_trial import QUIET, Outcome, Trial

LIMITS = {
    "proven": {"position": 0.0, "speed": 1.0, "grown": 0.0, "contact": 5.0},
    "full": {"position": 0.02, "speed": 1.10, "contact": 5.0},
}
"""What must hold in each range: no try above these, unless a spring is stronger than a
motor."""
OVERPOWERED = {"position": 0.02, "speed": 1.2, "contact": 5.0}
"""What must hold then: such a spring moves a joint, but is no excuse to run away."""


@dataclass(frozen=True)
class Attack:
    """What all tries have in common."""

    period: float
    span: str = "proven"
    seed: int = 0
    is_hardware: bool = True
    task: str | None = None
    policy: str | None = None
    overrides: tuple[tuple[str, Any], ...] = ()
    """Of LimitConfig or OscConfig."""
    hold_on: float = 0.0
    """How long a try goes on with its last Target [s]."""
    robot: str = DEFAULT_ROBOT
    """The arm by name."""

    def vector(self, index: int) -> Array:
        """Return try `index` as numbers in [0, 1]."""
        vector = np.random.default_rng([self.seed, index]).random(SIZE)
        for place, kinds, kind in ((0, TASKS, self.task), (1, POLICIES, self.policy)):
            if kind is not None:
                vector[place] = (kinds.index(kind) + 0.5) / len(kinds)
        return vector

    def choices(self, index: int) -> Choices:
        """Return try `index`."""
        return choose(self.vector(index), RANGES[self.span])

    def run(self, index: int) -> Outcome:
        """Run try `index`."""
        return self.run_vector(self.vector(index), (self.seed, index, 1))

    def run_vector(self, vector: Array, seed: tuple[int, ...]) -> Outcome:
        """Run a try that is not drawn here.

        Args:
            vector: The choices as numbers in [0, 1], shape (SIZE,).
            seed: Of what is drawn at random meanwhile.
        """
        outcome = self._trial(vector, seed).run(self.hold_on)
        if outcome.worst["grown"] > 0.0:
            grown = [self._trial(vector, seed).look_on(quiet) for quiet in QUIET]
            outcome.worst["grown"] = max(grown)
        return outcome

    def _trial(self, vector: Array, seed: tuple[int, ...]) -> Trial:
        return Trial(
            choose(vector, RANGES[self.span]),
            self.period,
            seed,
            robot=self.robot,
            is_hardware=self.is_hardware,
            overrides=self.overrides,
        )


def broken(worst: dict[str, float], span: str) -> dict[str, float]:
    """Return what exceeds the promises of a range, with its value."""
    limits = LIMITS[span].items()
    return {name: worst[name] for name, limit in limits if worst[name] > limit}


def is_excused(worst: dict[str, float]) -> bool:
    """Return whether a spring that is stronger than a motor explains what broke."""
    if worst["load"] <= 1.0:
        return False
    return all(worst[name] <= limit for name, limit in OVERPOWERED.items())


def plain(outcome: Outcome) -> dict[str, Any]:
    """Return an outcome without its trace."""
    return {
        "worst": outcome.worst,
        "when": outcome.when,
        "counts": outcome.counts,
        "cycles": outcome.cycles,
    }


def add_case(path: Path, attack: Attack, case: dict[str, Any]) -> None:
    """Write a try into the file of cases, in place of one of its name.

    Args:
        path: JSON file, made where there is none.
        attack: What the try was part of.
        case: Its "name", "cause", "seed", "worst" and "vector".
    """
    cases = json.loads(path.read_text()) if path.exists() else []
    kept = [c for c in cases if c["name"] != case["name"]]
    entry = case | {
        "robot": attack.robot,
        "period": attack.period,
        "span": attack.span,
        "is_hardware": attack.is_hardware,
        "hold_on": attack.hold_on,
        "worst": {k: float(f"{v:.4g}") for k, v in case["worst"].items()},
        "vector": [round(float(x), 6) for x in case["vector"]],
    }
    # JSON knows no infinity: a try without contact has no worst of it.
    entry["worst"] = {k: v for k, v in entry["worst"].items() if np.isfinite(v)}
    lines = ",\n".join(" " + json.dumps(c) for c in [*kept, entry])
    path.write_text(f"[\n{lines}\n]\n")
