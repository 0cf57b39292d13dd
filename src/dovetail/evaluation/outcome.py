"""Outcome of one try: numbers for the table, and the tool's path."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from dovetail.evaluation.job import TrialJob
from dovetail.types import Array


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Conditions of a try, fixed before its first step."""

    tare: tuple[float, ...] = (0.0,) * 6
    """f* that held the weight before the try [m/s2, rad/s2]; 0 without a tare."""
    perturbation: Mapping[str, Any] = field(default_factory=dict)
    """Disturbances drawn for this try, by name and unit; empty where none were."""


@dataclass(frozen=True, kw_only=True)
class Course:
    """Steps, limit violations and path of a try."""

    steps: int
    """Policy steps taken (50 ms each)."""
    violations: int
    """Control cycles in which a measured value lay outside its limit."""
    path: Array
    """Tool position in the fixture's frame [m], shape (cycles, 3), z out of it."""


@dataclass(frozen=True, kw_only=True)
class ContactForce:
    """Contact force of a try; nan where the arm does not measure it."""

    mean: float
    """Mean over the cycles in contact [N]; 0 without contact."""
    peak: float
    """Largest in any control cycle [N]."""
    step: float
    """Largest over the policy steps (50 ms) of the mean of the cycles' peaks [N]. It is
    one of vectors: what shakes to and fro cancels."""
    cycles: int
    """Control cycles in contact; 0 where the arm does not measure it."""


@dataclass(frozen=True, kw_only=True)
class ArmStop:
    """The arm's end of a try before its time."""

    reason: str = ""
    """Reason, in a word; empty when the arm did not end the try."""
    text: str = ""
    """Message of the arm: what it saw, and what to look at."""


@dataclass(frozen=True, kw_only=True)
class TryFiles:
    """Files of a try."""

    log: str = ""
    """File name of the Episode log, or empty when none was kept."""
    film_error: str = ""
    """Reason why the film is missing; empty when it is there or was not wanted."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of one try of a policy."""

    job: TrialJob
    """Pose, number and seed of the try."""
    conditions: Conditions = field(default_factory=Conditions)
    """Conditions fixed before its first step."""
    success: bool
    """The task was done: the part, say, ended deep enough inside the fixture."""
    depth: float
    """Insertion depth at the end [m]."""
    course: Course
    """Steps, limit violations and path."""
    force: ContactForce
    """Contact force in it."""
    stop: ArmStop = field(default_factory=ArmStop)
    """Stop by the arm; its reason is empty when there was none."""
    files: TryFiles = field(default_factory=TryFiles)
    """Its files."""

    def numbers(self) -> dict[str, Any]:
        """Return everything but the path, for JSON."""
        return {
            **self.job._asdict(),
            "success": self.success,
            "steps": self.course.steps,
            "depth": self.depth,
            "force_mean": self.force.mean,
            "force_peak": self.force.peak,
            "force_step": self.force.step,
            "contact_cycles": self.force.cycles,
            "violations": self.course.violations,
            "stopped": self.stop.reason,
            "log": self.files.log,
            "tare": self.conditions.tare,
            "perturbation": self.conditions.perturbation,
            "stopped_text": self.stop.text,
            "film_error": self.files.film_error,
        }

    @classmethod
    def from_numbers(cls, numbers: Mapping[str, Any]) -> Self:
        """Return a try from its line in report.json, where null stands for nan.

        Its path is empty. What older files lack is as usual.
        """
        told: dict[str, Any] = {
            k: math.nan if v is None else v for k, v in numbers.items()
        }
        usual = Conditions()
        return cls(
            job=TrialJob(told["pose"], told["attempt"], told["seed"]),
            conditions=Conditions(
                tare=tuple(told.get("tare", usual.tare)),
                perturbation=told.get("perturbation", usual.perturbation),
            ),
            success=told["success"],
            depth=told["depth"],
            course=Course(
                steps=told["steps"],
                violations=told["violations"],
                path=np.empty((0, 3)),
            ),
            force=ContactForce(
                mean=told["force_mean"],
                peak=told["force_peak"],
                step=told["force_step"],
                cycles=told["contact_cycles"],
            ),
            stop=ArmStop(reason=told["stopped"], text=told.get("stopped_text", "")),
            files=TryFiles(log=told["log"], film_error=told.get("film_error", "")),
        )
