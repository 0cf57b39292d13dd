"""Ranges of disturbance for which the shipped policies were measured."""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from dovetail.evaluation.config import EvaluationConfig
from dovetail.learn.policy import POLICY_FOLDER
from dovetail.plants.twin import load_twin
from dovetail.settings import values_of
from dovetail.trackers.find import TWIN, find_tracker
from dovetail.trackers.late import Late

RANGES = POLICY_FOLDER / "ranges.toml"
"""Written by benchmarks/policy_range.py: a table for each policy, a limit for each of
`DISTURBANCES` [SI]."""


class Disturbance(NamedTuple):
    """One thing that can be made harder."""

    words: str
    """In a sentence, with the value and unit behind it."""
    unit: str
    """Of tables and messages."""
    scale: float
    """From SI to that unit."""
    falls: bool = False
    """True where smaller values are the harder ones."""


DISTURBANCES = {
    "push": Disturbance("pushes of up to", "N", 1.0),
    "fixture_speed": Disturbance("a fixture that moves at", "mm/s", 1e3),
    "bias": Disturbance("the fixture's place given wrong by", "mm", 1e3),
    "turn": Disturbance("the fixture's yaw given wrong by", "mrad", 1e3),
    "contact_friction": Disturbance("a friction coefficient of", "1", 1.0),
    "command_delay": Disturbance("a delay of", "ms", 1e3),
    "clearance": Disturbance("a clearance per side of", "mm", 1e3, falls=True),
}


@cache
def measured_ranges() -> dict[str, dict[str, float]]:
    """Return the limit of each disturbance [SI] for each shipped policy."""
    return tomllib.loads(RANGES.read_text(encoding="utf-8"))


def outside_measured(
    policy: Path, config: EvaluationConfig, options: Mapping[str, Any]
) -> str:
    """Name the disturbances that are harder than a shipped policy was measured for.

    Args:
        policy: The policy's file.
        config: The evaluation.
        options: Keyword arguments of its environment.

    Returns:
        A note with value, unit and measured limit; empty where every disturbance is
        within its range, or the policy is not a shipped one.
    """
    if policy.parent != POLICY_FOLDER:
        return ""
    known = measured_ranges().get(policy.stem, {})
    beyond = []
    for name, value in _disturbed(config, options).items():
        kind, limit = DISTURBANCES[name], known.get(name)
        if limit is None or (value >= limit if kind.falls else value <= limit):
            continue
        unit = "" if kind.unit == "1" else f" {kind.unit}"
        beyond.append(
            f"{kind.words} {kind.scale * value:g}{unit} (measured "
            f"{'down' if kind.falls else 'up'} to {kind.scale * limit:g}{unit})"
        )
    if not beyond:
        return ""
    return (
        f"harder than {policy.stem} was measured for: {', '.join(beyond)}; it may fail "
        "(docs/robustness.md)"
    )


def _disturbed(
    config: EvaluationConfig, options: Mapping[str, Any]
) -> dict[str, float]:
    """Return how hard each disturbance of an evaluation is [SI]."""
    harder = config.perturbation
    found = {"push": harder.push, "fixture_speed": harder.fixture_speed}
    if "clearance" in options:
        found["clearance"] = float(options["clearance"])
    twin = None if options.get("twin") is None else load_twin(options["twin"])
    camera = {} if twin is None or twin.camera is None else values_of(twin.camera)
    if twin is not None:
        found["contact_friction"] = twin.contact_friction
        found["command_delay"] = twin.command_delay
    tracker = str(options.get("tracker") or "")
    if tracker == TWIN:
        found |= {name: camera[name] for name in ("bias", "turn") if name in camera}
    if tracker.partition("?")[0] == "late":
        late = find_tracker(tracker)
        assert isinstance(late, Late)
        found |= {"bias": late.bias, "turn": late.turn}
    return found
