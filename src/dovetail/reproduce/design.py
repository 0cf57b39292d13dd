"""The design: which policies are trained, and on which twins each is tried.

A cell is a law, a model that its policies were trained in, and engines. Nominal and
randomised policies know no twin, and each is tried on all of them. The others belong
to one twin, and are tried on that one alone.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from dovetail.plants.plant import Engine
from dovetail.reproduce.budget import Budget


@dataclass(frozen=True, kw_only=True)
class Law:
    """A controller, and whether the missed weight is measured before each try."""

    label: str
    settings: Mapping[str, Any]
    """Settings of the trainings with it."""


LAWS: dict[str, Law] = {
    "paper": Law(
        label="the paper's law",
        settings={
            "tare": False,
            "force_damping": 0.0,
            "near_speed": 0.25,
            "near_press": 4.0,
            "scheme": "paper",
        },
    ),
    "ours": Law(label="our law", settings={"tare": False}),
    "tared": Law(label="our law with a tare", settings={"tare": True}),
}
"""The paper's law has no damping that could hold the arm while it is tared, so that
there is no fourth."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """A simulation that policies are trained in."""

    label: str
    source: str = ""
    """The twin's model: truth, or the parameters that are fitted; empty for the
    nominal one."""
    is_randomised: bool = False
    """Its dynamics are drawn anew in every episode."""

    @property
    def is_of_twin(self) -> bool:
        """True if each twin has its own."""
        return bool(self.source)


MODELS: dict[str, Model] = {
    "nominal": Model(label="nominal"),
    "randomised": Model(label="randomised about nominal", is_randomised=True),
    "identified-paper": Model(label="identified, the paper's five", source="paper"),
    "identified": Model(label="identified, extended", source="extended"),
    "identified-randomised": Model(
        label="randomised about identified", source="extended", is_randomised=True
    ),
    "truth": Model(label="the twin's own", source="truth"),
}
DECISIVE = ("nominal", "randomised", "identified")
"""Models that the paper's claim is about: these in every engine."""
STACK = 4
"""Past observations and actions that the paper's other policies see."""
ENGINES: dict[Engine, str] = {
    "mujoco": "MuJoCo",
    "bullet": "PyBullet",
    "drake": "Drake",
}


@dataclass(frozen=True, kw_only=True)
class Training:
    """A policy to train."""

    law: str
    model: str
    seed: int
    twin: str = ""
    """Twin that its model is of; empty where it knows none."""
    engine: Engine = "mujoco"
    stack: int = 0

    @property
    def name(self) -> str:
        """Its stage."""
        parts = ["train", self.law, self.model]
        parts += [self.engine] * (self.engine != "mujoco")
        parts += [f"stack-{self.stack}"] * bool(self.stack)
        return "-".join([*parts, self.twin or f"seed-{self.seed}"])


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Tries of one policy on one twin."""

    training: Training
    twin: str
    engine: Engine = "mujoco"
    """Engine that the twin is simulated by."""
    peg: str = "square"

    @property
    def name(self) -> str:
        """Its stage."""
        parts = [self.training.name.replace("train", "try", 1), "on", self.twin]
        parts += [self.engine] * (self.engine != "mujoco")
        parts += [self.peg] * (self.peg != "square")
        return "-".join(parts)


@dataclass(frozen=True, kw_only=True)
class Design:
    """Everything that decides what is trained and tried."""

    budget: Budget
    twins: tuple[str, ...]
    """Names of the twins, files in the results folder."""
    engines: tuple[Engine, ...] = ("mujoco",)
    """Engines that are installed."""
    seed: int = 0
    """First training seed; the others follow from it."""

    def trainings(
        self, law: str, model: str, engine: Engine = "mujoco"
    ) -> list[Training]:
        """Return the policies of a cell, in order of seeds or of twins."""
        if MODELS[model].is_of_twin:
            count = len(self.twins)
            if engine == "bullet":
                count = 2 * self.budget.bullet_seeds
            return [
                Training(
                    law=law, model=model, seed=self.seed + i, twin=twin, engine=engine
                )
                for i, twin in enumerate(self.twins[:count])
            ]
        count = self.budget.bullet_seeds if engine == "bullet" else self.budget.seeds
        return [
            Training(law=law, model=model, seed=self.seed + i, engine=engine)
            for i in range(count)
        ]

    def cells(self) -> Iterator[tuple[str, str, Engine, Engine]]:
        """Yield law, model, engine of the training and engine of the twins."""
        for model in MODELS:
            for law in LAWS:
                yield law, model, "mujoco", "mujoco"
        for model in DECISIVE:
            if "bullet" in self.engines:
                yield "paper", model, "bullet", "mujoco"
            if "drake" in self.engines:
                for law in LAWS:
                    yield law, model, "mujoco", "drake"

    def trials(
        self, law: str, model: str, trained_in: Engine, tried_in: Engine
    ) -> list[list[Trial]]:
        """Return the tries of a cell: a list for each policy, by twins.

        A policy of a twin has one entry.
        """
        twins, policies = self.twins, self.trainings(law, model, trained_in)
        if trained_in == "bullet":
            twins = twins[: 2 * self.budget.bullet_seeds]
        if tried_in == "drake":
            twins = twins[: self.budget.drake_twins]
            of_twin = MODELS[model].is_of_twin
            count = len(twins) if of_twin else self.budget.drake_seeds
            policies = policies[:count]
        return [
            [
                Trial(training=training, twin=twin, engine=tried_in)
                for twin in ((training.twin,) if training.twin else twins)
            ]
            for training in policies
        ]

    def stacked(self) -> list[Training]:
        """Return the policies of the paper's table that see the past, too."""
        return [
            Training(
                law="paper",
                model="identified",
                seed=self.seed + i,
                twin=twin,
                stack=STACK,
            )
            for i, twin in enumerate(self.twins[: self.budget.paper_twins])
        ]

    def paper_trials(self, stack: int | None, peg: str) -> list[Trial]:
        """Return the tries of a row of the paper's table.

        Args:
            stack: That of identified policies; None for the randomised ones.
            peg: Shape of peg and hole.
        """
        twins = self.twins[: self.budget.paper_twins]
        if stack:
            policies = self.stacked()
        else:
            model = "randomised" if stack is None else "identified"
            known = self.trainings("paper", model)
            policies = [known[i % len(known)] for i in range(len(twins))]
        return [
            Trial(training=training, twin=twin, peg=peg)
            for training, twin in zip(policies, twins, strict=True)
        ]
