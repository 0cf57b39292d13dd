"""The plan: every experiment as a stage, from a few settings; nothing runs here.

record, held out -> fit -> report of the identification
fit -> train (stack 0, stack 4; per twin: stack 0) -> evaluate
train (without identification; randomised; on the twin itself)   -> evaluate
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from dovetail.identify.fit_folder import MODEL
from dovetail.learn.config import NOT_COMPARED, TrainConfig
from dovetail.learn.policy import RUN_POLICY
from dovetail.options import option_words
from dovetail.reproduce.budget import Budget
from dovetail.reproduce.folder import FIT, RECORDING, RUN, TRAIN, stage_path, twin_path
from dovetail.tasks.options import gather_options
from dovetail.tasks.peg_in_hole.task import PegInHole

_STEP = 1.0 / 75.0
"""About how long a training step takes on a core [s], and its share of an episode."""
_START = 8.0
"""About how long a process takes to start to train [s]."""
_TRY = 0.3
"""About how long a try takes [s]."""
_SEARCH = 1.0
"""The same with a search [s]."""
_REPLAY = 0.06
"""About how long the simulation of a log takes [s]."""
HELD_OUT_SEED = 1000
"""Added to the seed of a log that no fit sees."""
SLOWER_ON_TWIN = 1.5
"""Factor by which a training over the network takes longer, roughly [1]."""

VARIANTS: dict[str, str] = {
    "stack-0": "stack 0",
    "stack-4": "stack 4",
    "randomised": "dynamics randomisation",
}
"""The paper's three trained variants, as the table calls them."""
UNIDENTIFIED = "unidentified"
UNTARED = "untared"
"""The unidentified policy, tried without a tare: as the paper's would be."""
GROUNDS = ("neither tared nor identified", "tared", "tared and identified")
"""Preparations of stack 0 for the twin it is tried on, as named in the tables."""
ON_TWIN = "on-twin"
OTHER = "other-direction"
PEGS = ("square", "triangle")
ONE_HOLE = (0.60, 0.0, 0.10, 0.0)
"""Place of the hole in the training on the twin itself: x y z [m], yaw [rad]."""


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One experiment: a command of dovetail, run by a rule of the Snakefile."""

    name: str
    """Name of the stage and of its folder."""
    rule: str
    """record, fit, report, train, train_on_twin or evaluate."""
    needs: tuple[str, ...] = ()
    """Stages whose results it reads."""
    words: tuple[str, ...] = ()
    """Words of its command that come before the options; paths are seen from the
    results folder."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options of its command; None is left out."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """All settings of a training, in a file that its options name."""
    twin: str = ""
    """File of the twin behind the cabinet that it is trained on."""
    expected: float = 1.0
    """Estimated time on one core [s]: for the time left only."""

    def to_json(self) -> dict[str, Any]:
        """Return what decides the result, for the Snakefile."""
        words = list(self.words)
        for name, value in self.options.items():
            words += [] if value is None else option_words(name, value)
        facts: dict[str, Any] = {
            "rule": self.rule,
            "needs": list(self.needs),
            "options": words,
        }
        if self.settings:
            facts["settings"] = dict(self.settings)
        if self.twin:
            facts["twin"] = self.twin
        return facts


@dataclass(frozen=True, kw_only=True)
class PlanConfig:
    """Everything that decides the plan."""

    budget: Budget
    """Sizes."""
    twins: tuple[str, ...]
    """Names of the twins, files in the results folder; the first has the table."""
    plant: str
    """Engine to train in: mujoco or bullet."""
    identify_plant: str = "mujoco"
    """Engine of the identification."""
    parameters: str = "extended"
    """Parameters whose model the trainings use."""
    seed: int = 0
    """First training seed; the other seeds follow from it."""


def plan(config: PlanConfig) -> tuple[Stage, ...]:
    """Return every stage of the experiments, each after those that it needs."""
    others = config.twins[1:]
    stages: list[Stage] = []
    for twin in config.twins:
        stages += _identification(config, twin)
    for seed in _seeds(config):
        for variant in VARIANTS:
            stages.append(_training(config, variant, seed))
        stages.append(_training(config, UNIDENTIFIED, seed))
        stages += [_training(config, f"identified-{twin}", seed) for twin in others]
    stages.append(_training_on_twin(config))
    stages += _transfer(config)
    stages += _identified_or_not(config)
    stages += _robustness(config)
    if config.budget.other_direction and config.plant == "bullet":
        stages += _other_direction(config)
    return tuple(stages)


def train_name(variant: str, seed: int) -> str:
    """Return the name of a training."""
    return f"train-{variant}-seed-{seed}"


def fit_name(twin: str, parameters: str) -> str:
    """Return the name of an identification."""
    return f"fit-{twin}-{parameters}"


def transfer_name(variant: str, peg: str, seed: int) -> str:
    """Return the name of an evaluation for the transfer table."""
    return f"transfer-{variant}-{peg}-seed-{seed}"


def ground_name(twin: str, variant: str, seed: int) -> str:
    """Return the name of an evaluation with or without identification."""
    return f"identified-or-not-{twin}-{variant}-seed-{seed}"


def robustness_name(variant: str, what: str, level: float, seed: int) -> str:
    """Return the name of an evaluation of robustness; lengths and speeds in mm."""
    factor = 1.0 if what in ("push", "below") else 1e3
    return f"robustness-{variant}-{what}-{factor * level:g}-seed-{seed}"


def _seeds(config: PlanConfig) -> range:
    return range(config.seed, config.seed + config.budget.seeds)


def _identification(config: PlanConfig, twin: str) -> Iterator[Stage]:
    budget = config.budget
    logs = {"fitted": config.seed, "held-out": config.seed + HELD_OUT_SEED}
    for log, seed in logs.items():
        yield Stage(
            name=f"record-{twin}-{log}",
            rule="record",
            options={
                "arm": f"twin:{twin_path(twin)}",
                "seed": seed,
                "sequences": budget.sequences,
                "steps": budget.sequence_steps,
            },
            expected=10.0,
        )
    sets = [config.parameters]
    if twin == config.twins[0] and "paper" not in sets:
        sets.append("paper")  # to compare
    for parameters in sets:
        yield Stage(
            name=fit_name(twin, parameters),
            rule="fit",
            words=(str(stage_path(f"record-{twin}-fitted") / RECORDING),),
            options={
                "plant": config.identify_plant,
                "parameters": parameters,
                "evaluations": budget.evaluations,
                "seed": config.seed,
            },
            needs=(f"record-{twin}-fitted",),
            expected=_fit_time(budget.evaluations, parameters),
        )
        needs = (fit_name(twin, parameters), f"record-{twin}-held-out")
        yield Stage(
            name=f"report-{needs[0]}",
            rule="report",
            words=(str(stage_path(needs[0]) / FIT),),
            options={"held_out": stage_path(needs[1]) / RECORDING},
            needs=needs,
            expected=20.0,
        )


def _fit_time(evaluations: int | None, parameters: str) -> float:
    """Return about how long a fit takes [s]."""
    if evaluations is None:
        evaluations = 1000 if parameters == "paper" else 5000
    return 2.0 + _REPLAY * evaluations


RECIPE = {
    "until": 1.0,
    "num_envs": 4,
    "updates_per_step": 2.0,
    "learning_rate": 1e-3,
    "policy_delay": 1,
    "tau": 0.005,
}
"""Training settings of docs/experiments.md: all steps, at one rate of learning from
simulations and from the served arm."""


def _train_settings(config: PlanConfig, **changes: Any) -> dict[str, Any]:
    """Return all settings of a training, defaults included, as its file has them."""
    chosen = {"plant": config.plant, **RECIPE, **config.budget.train, **changes}
    given = {k: tuple(v) if isinstance(v, list) else v for k, v in chosen.items()}
    settings = TrainConfig(**gather_options(given, PegInHole)).to_json()
    return {
        name: value
        for name, value in settings.items()
        if value is not None and name not in NOT_COMPARED
    }


def _simulated(
    name: str, settings: Mapping[str, Any], model_of: str | None = None
) -> Stage:
    """Return a training in a simulation: the nominal one, or an identified model."""
    model = None if model_of is None else stage_path(model_of) / FIT / MODEL
    return Stage(
        name=name,
        rule="train",
        needs=() if model_of is None else (model_of,),
        options={"config": stage_path(name) / TRAIN, "model": model},
        settings=settings,
        expected=_START + _STEP * settings["steps"],
    )


def _training(config: PlanConfig, variant: str, seed: int) -> Stage:
    changes: dict[str, Any] = {"seed": seed}
    model = None
    if variant == "randomised":
        changes["randomise_dynamics"] = True
    elif variant != UNIDENTIFIED:
        twin = variant.removeprefix("identified-")
        twin = config.twins[0] if twin in VARIANTS else twin
        model = fit_name(twin, config.parameters)
        changes["stack"] = 4 if variant == "stack-4" else 0
    return _simulated(
        train_name(variant, seed), _train_settings(config, **changes), model
    )


def _training_on_twin(config: PlanConfig) -> Stage:
    name = train_name(ON_TWIN, config.seed)
    settings = _train_settings(
        config, seed=config.seed, fixed_goal=True, fixture=ONE_HOLE, num_envs=1
    )
    del settings["plant"]
    return Stage(
        name=name,
        rule="train_on_twin",
        options={"config": stage_path(name) / TRAIN},
        settings=settings,
        twin=str(twin_path(config.twins[0])),
        expected=_START + SLOWER_ON_TWIN * _STEP * settings["steps"],
    )


def _evaluation(
    config: PlanConfig, name: str, policy_of: str, twin: str, **options: Any
) -> Stage:
    given = {"twin": twin_path(twin), "tries": config.budget.tries, **options}
    count = given["tries"] * (1 if "fixture" in given else 3)
    seconds = _SEARCH if "search" in given else _TRY
    return Stage(
        name=name,
        rule="evaluate",
        needs=(policy_of,),
        words=(str(stage_path(policy_of) / RUN / RUN_POLICY),),
        options=given,
        expected=3.0 + seconds * count,
    )


def _transfer(config: PlanConfig) -> Iterator[Stage]:
    twin = config.twins[0]
    for seed in _seeds(config):
        for variant in VARIANTS:
            for peg in PEGS:
                name = transfer_name(variant, peg, seed)
                policy = train_name(variant, seed)
                yield _evaluation(config, name, policy, twin, peg=peg)
    name = transfer_name(ON_TWIN, "square", config.seed)
    policy = train_name(ON_TWIN, config.seed)
    yield _evaluation(config, name, policy, twin, peg="square", fixture=ONE_HOLE)


def _identified_or_not(config: PlanConfig) -> Iterator[Stage]:
    """Stack 0 on each twin; with identification on the first is in the table."""
    plain: dict[str, Any] = {UNTARED: {"tare": False}, UNIDENTIFIED: {}}
    for seed in _seeds(config):
        for twin in config.twins:
            for variant, settings in plain.items():
                name = ground_name(twin, variant, seed)
                policy = train_name(UNIDENTIFIED, seed)
                yield _evaluation(config, name, policy, twin, **settings)
            if twin != config.twins[0]:
                variant = f"identified-{twin}"
                name = ground_name(twin, variant, seed)
                yield _evaluation(config, name, train_name(variant, seed), twin)


def robustness_cases(budget: Budget) -> Iterator[tuple[str, float, dict[str, Any]]]:
    """Yield what is done to the arm or the hole, how much, and evaluate's settings.

    Level 0 is nothing: the transfer table has it.
    """
    sizes = budget
    for shift in sizes.shifts:
        yield "shift", shift, {"fixture_shift": shift}
    for shift in sizes.searches:
        settings = {"fixture_shift": shift, "search": "corner", "keep_logs": False}
        if sizes.search_steps is not None:
            settings["max_steps"] = sizes.search_steps
        yield "search", shift, {**settings, "tries": sizes.search_tries}
    for push in sizes.pushes:
        yield "push", push, {"push": push}
    for speed in sizes.speeds:
        yield "speed", speed, {"fixture_speed": speed}
    yield "below", 1.0, {"start": "below"}


def _robustness(config: PlanConfig) -> Iterator[Stage]:
    for seed in _seeds(config):
        for variant in config.budget.robust:
            for what, level, settings in robustness_cases(config.budget):
                if level == 0.0:
                    continue
                name = robustness_name(variant, what, level, seed)
                policy = train_name(variant, seed)
                yield _evaluation(config, name, policy, config.twins[0], **settings)


def _other_direction(config: PlanConfig) -> Iterator[Stage]:
    """Train in MuJoCo, try on the twin in PyBullet; no triangle there."""
    twin = config.twins[0]
    model = fit_name(twin, config.parameters)
    for seed in _seeds(config):
        settings = _train_settings(config, seed=seed, plant="mujoco")
        name = train_name(OTHER, seed)
        yield _simulated(name, settings, model)
        yield _evaluation(
            config, transfer_name(OTHER, "square", seed), name, f"{twin}-in-bullet"
        )
