"""The plan: every experiment as a stage, from a few settings; nothing runs here.

record, held out -> fit -> report of the identification
fit -> train (stack 0, stack 4; per twin: stack 0) -> evaluate
train (without identification; randomised; on the twin itself)   -> evaluate
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from dovetail.learn.config import TrainConfig
from dovetail.reproduce.budget import Budget
from dovetail.reproduce.settings import as_config
from dovetail.reproduce.stage import Stage

_STAGES = "dovetail.reproduce.experiments"
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
    """Return every stage of the experiments."""
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
            run=f"{_STAGES}:record_log",
            settings={
                "twin": twin,
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
            run=f"{_STAGES}:fit_model",
            settings={
                "log_of": f"record-{twin}-fitted",
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
            run=f"{_STAGES}:report_fit",
            settings={"fit_of": needs[0], "held_out_of": needs[1]},
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
    """Return all settings of a training, defaults included, as JSON knows them."""
    chosen = {"plant": config.plant, **RECIPE, **config.budget.train, **changes}
    settings = TrainConfig(**as_config(chosen)).to_json()
    settings["hole"] = settings.pop("fixture")
    return {name: value for name, value in settings.items() if value is not None}


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
    settings = _train_settings(config, **changes)
    return Stage(
        name=train_name(variant, seed),
        run=f"{_STAGES}:train_policy",
        settings=settings | ({} if model is None else {"model_of": model}),
        needs=() if model is None else (model,),
        expected=_START + _STEP * settings["steps"],
    )


def _training_on_twin(config: PlanConfig) -> Stage:
    settings = _train_settings(
        config, seed=config.seed, fixed_goal=True, fixture=ONE_HOLE, num_envs=1
    )
    del settings["plant"]
    return Stage(
        name=train_name(ON_TWIN, config.seed),
        run=f"{_STAGES}:train_on_twin",
        settings=settings | {"twin": config.twins[0]},
        expected=_START + SLOWER_ON_TWIN * _STEP * settings["steps"],
    )


def _evaluation(
    config: PlanConfig, name: str, policy_of: str, twin: str, **settings: Any
) -> Stage:
    tries = settings.get("tries", config.budget.tries)
    tries *= 1 if "hole" in settings else 3
    seconds = _SEARCH if "search" in settings else _TRY
    return Stage(
        name=name,
        run=f"{_STAGES}:evaluate_policy",
        settings={
            "policy_of": policy_of,
            "twin": twin,
            "tries": config.budget.tries,
            **settings,
        },
        needs=(policy_of,),
        expected=3.0 + seconds * tries,
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
    yield _evaluation(config, name, policy, twin, peg="square", hole=list(ONE_HOLE))


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
        yield "shift", shift, {"hole_shift": shift}
    for shift in sizes.searches:
        settings = {"hole_shift": shift, "search": "corner", "keep_logs": False}
        if sizes.search_steps is not None:
            settings["max_steps"] = sizes.search_steps
        yield "search", shift, {**settings, "tries": sizes.search_tries}
    for push in sizes.pushes:
        yield "push", push, {"push": push}
    for speed in sizes.speeds:
        yield "speed", speed, {"hole_speed": speed}
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
        yield Stage(
            name=name,
            run=f"{_STAGES}:train_policy",
            settings=settings | {"model_of": model},
            needs=(model,),
            expected=_START + _STEP * settings["steps"],
        )
        yield _evaluation(
            config, transfer_name(OTHER, "square", seed), name, f"{twin}-in-bullet"
        )
