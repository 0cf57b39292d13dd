"""The plan: every experiment as a stage, from a few settings; nothing runs here.

twin -> record -> fit -> train (its own models) -> try on it
train (nominal, randomised)                      -> try on every twin
train -> fine-tune on the arm, over FRI          -> try there
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dovetail.envs.registered import task_class
from dovetail.identify.fit_folder import MODEL
from dovetail.learn.config import NOT_COMPARED, TrainConfig
from dovetail.learn.policy import RUN_POLICY
from dovetail.options import option_words
from dovetail.plants.plant import Engine
from dovetail.reproduce.budget import Budget
from dovetail.reproduce.design import LAWS, MODELS, Design, Training, Trial
from dovetail.reproduce.folder import FIT, RECORDING, RUN, TRAIN, stage_path, twin_path
from dovetail.reproduce.paper import TRANSFER
from dovetail.tasks.options import gather_options
from dovetail.tasks.shipped import DEFAULT_ENV

_STEP = 1.0 / 550.0
"""About how long a training step takes on a core [s], and its share of an episode."""
_START = 10.0
"""About how long a process takes to start to train [s]."""
_TRY: dict[Engine, float] = {"mujoco": 0.1, "bullet": 0.3, "drake": 3.3}
"""About how long a try takes [s]."""
_REPLAY = 0.06
"""About how long the simulation of a log takes [s]."""
_FRI = 5.0
"""Factor by which a training over FRI takes longer, roughly [1]."""
HELD_OUT_SEED = 1000
"""Added to the seed of a log that no fit sees."""
SETS = ("paper", "extended")
"""Sets of parameters that are fitted."""
ARM = "medium"
"""Shipped twin behind the cabinet that policies are trained on over FRI."""
ONE_HOLE = (0.60, 0.0, 0.10, 0.0)
"""Place of the hole in the trainings over FRI: x y z [m], yaw [rad]."""
CLIP_ENV = "dovetail/RailClip-v0"
CLIP = "train-rail-clip"
"""Stage of the training for the paper's second task."""
SCRATCH = "train-on-arm"
"""Stage of the training from nothing on the arm."""
STANDARD: dict[str, Any] = {
    "num_envs": 4,
    "updates_per_step": 1.0,
    "learning_rate": 3e-4,
    "final_rate": 1.0,
    "policy_delay": 1,
    "tau": 0.005,
    "n_steps": 1,
    "gamma": 0.99,
    "reward_scale": 1.0,
    "layer_norm": False,
    "ent_coef": "auto",
    "net": (256, 256),
}
"""SAC's settings in Stable-Baselines3, whose defaults are those of its paper."""
LEARNERS: dict[str, tuple[str, Mapping[str, Any]]] = {
    "sac": ("SAC, our settings", {}),
    "standard": ("SAC, standard settings", STANDARD),
    "ddpg": (
        "DDPG",
        {
            "algorithm": "ddpg",
            **{k: STANDARD[k] for k in ("num_envs", "updates_per_step", "tau")},
            **{k: STANDARD[k] for k in ("n_steps", "gamma", "final_rate")},
        },
    ),
    "ppo": (
        "PPO",
        {
            "algorithm": "ppo",
            "num_envs": 4,
            "learning_rate": 3e-4,
            "batch_size": 64,
            "gamma": 0.99,
            "final_rate": 1.0,
            "reward_scale": 1.0,
        },
    ),
    "gps": ("guided policy search", {"algorithm": "gps", "num_envs": 8}),
}
"""Learning algorithms: label, and settings that differ from the defaults."""


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


def plan(design: Design) -> tuple[Stage, ...]:
    """Return every stage of the experiments, each after those that it needs."""
    stages: dict[str, Stage] = {}

    def add(*made: Stage) -> None:
        stages.update((stage.name, stage) for stage in made if stage.name not in stages)

    for twin in design.twins:
        add(*_identification(design, twin))
    for law, model, trained_in, tried_in in design.cells():
        for trials in design.trials(law, model, trained_in, tried_in):
            add(_training(design, trials[0].training))
            add(*(_trying(design, trial) for trial in trials))
    for row in TRANSFER:
        for trial in () if row.is_on_arm else design.paper_trials(row.stack, row.peg):
            add(_training(design, trial.training), _trying(design, trial))
    add(*_script(design), *_clip(design), *_learners(design))
    add(*_on_arm(design), *_robustness(design))
    return tuple(stages.values())


def fit_name(twin: str, parameters: str) -> str:
    """Return the name of an identification."""
    return f"fit-{twin}-{parameters}"


def script_name(twin: str) -> str:
    """Return the name of the script's tries on a twin."""
    return f"try-script-on-{twin}"


def clip_name(twin: str) -> str:
    """Return the name of the rail clip's tries on a twin."""
    return f"try-rail-clip-on-{twin}"


def learner_name(learner: str, seed: int) -> str:
    """Return the name of a training by one of `LEARNERS`."""
    return f"learn-{learner}-seed-{seed}"


def arm_name(what: str, seed: int) -> str:
    """Return the name of a stage of a policy on the arm: before, tune or after."""
    return f"arm-{what}-seed-{seed}"


def robustness_name(what: str, level: float) -> str:
    """Return the name of an evaluation of robustness; lengths and speeds in mm."""
    factor = 1.0 if what in ("push", "below") else 1e3
    return f"robustness-{what}-{factor * level:g}"


def _identification(design: Design, twin: str) -> Iterator[Stage]:
    budget = design.budget
    logs = {"fitted": design.seed, "held-out": design.seed + HELD_OUT_SEED}
    for log, seed in logs.items():
        yield Stage(
            name=f"record-{twin}-{log}",
            rule="record",
            options={
                "arm": f"twin:{twin_path(twin)}",
                "sequences": budget.sequences,
                "steps": budget.sequence_steps,
                "seed": seed,
            },
            expected=4.0 + 0.03 * budget.sequences * budget.sequence_steps,
        )
    for parameters in SETS:
        log = f"record-{twin}-fitted"
        name = fit_name(twin, parameters)
        usual = 300 if parameters == "paper" else 1200
        yield Stage(
            name=name,
            rule="fit",
            words=(str(stage_path(log) / RECORDING),),
            options={
                "parameters": parameters,
                "evaluations": budget.evaluations,
                "seed": design.seed,
            },
            needs=(log,),
            expected=2.0 + _REPLAY * (budget.evaluations or usual),
        )
        held_out = f"record-{twin}-held-out"
        yield Stage(
            name=f"report-{name}",
            rule="report",
            words=(str(stage_path(name) / FIT),),
            options={"held_out": stage_path(held_out) / RECORDING},
            needs=(name, held_out),
            expected=20.0,
        )


def _train_settings(budget: Budget, **changes: Any) -> dict[str, Any]:
    """Return all settings of a training, defaults included, as its file has them."""
    chosen = {"until": 1.0, **changes, **budget.train}
    given = {k: tuple(v) if isinstance(v, list) else v for k, v in chosen.items()}
    task = task_class(chosen.get("env", DEFAULT_ENV))
    settings = TrainConfig(**gather_options(given, task)).to_json()
    left_out = (*NOT_COMPARED, *(("arm", "plant") if "arm" in given else ()))
    return {
        name: value
        for name, value in settings.items()
        if value is not None and name not in left_out
    }


def _training(design: Design, training: Training) -> Stage:
    """Return a training in a simulation."""
    model = MODELS[training.model]
    settings = _train_settings(
        design.budget,
        plant=training.engine,
        stack=training.stack,
        randomise_dynamics=model.is_randomised,
        seed=training.seed,
        **LAWS[training.law].settings,
    )
    file, needs = None, ()
    if model.source == "truth":
        file = twin_path(training.twin)
    elif model.source:
        needs = (fit_name(training.twin, model.source),)
        file = stage_path(needs[0]) / FIT / MODEL
    return Stage(
        name=training.name,
        rule="train",
        needs=needs,
        options={"config": stage_path(training.name) / TRAIN, "model": file},
        settings=settings,
        expected=_START + _STEP * settings["steps"],
    )


def _evaluation(
    name: str,
    policy_of: str,
    twin: str,
    tries: int,
    engine: Engine = "mujoco",
    **options: Any,
) -> Stage:
    given = {
        "twin": twin_path(twin, engine),
        "tries": tries,
        "keep_logs": False,
        **options,
    }
    count = tries * (1 if "fixture" in given else 3)
    seconds = _TRY[engine] * (5.0 if "search" in given else 1.0)
    return Stage(
        name=name,
        rule="evaluate",
        needs=(policy_of,),
        words=(str(_policy(policy_of)),),
        options=given,
        expected=3.0 + seconds * count,
    )


def _policy(stage: str) -> Path:
    return stage_path(stage) / RUN / RUN_POLICY


def _trying(design: Design, trial: Trial) -> Stage:
    given = {} if trial.peg == "square" else {"peg": trial.peg}
    return _evaluation(
        trial.name,
        trial.training.name,
        trial.twin,
        design.budget.tries,
        trial.engine,
        **given,
    )


def _script(design: Design) -> Iterator[Stage]:
    """The scripted search on every twin, with the law of a tared policy."""
    policy = design.trainings("tared", "nominal")[0].name
    for twin in design.twins:
        name = script_name(twin)
        yield _evaluation(
            name,
            policy,
            twin,
            design.budget.tries,
            search="corner",
            **_search_length(design.budget),
        )


def _clip(design: Design) -> Iterator[Stage]:
    """The rail clip, trained in the nominal simulation and tried on every twin."""
    settings = _train_settings(
        design.budget,
        env=CLIP_ENV,
        seed=design.seed,
        **task_class(CLIP_ENV).training,
    )
    yield Stage(
        name=CLIP,
        rule="train",
        options={"config": stage_path(CLIP) / TRAIN},
        settings=settings,
        expected=_START + _STEP * settings["steps"],
    )
    for twin in design.twins:
        yield _evaluation(clip_name(twin), CLIP, twin, design.budget.tries)


def _search_length(budget: Budget) -> dict[str, Any]:
    steps = budget.search_steps
    return {} if steps is None else {"max_steps": steps}


def _learners(design: Design) -> Iterator[Stage]:
    for seed in range(design.seed, design.seed + design.budget.learner_seeds):
        for learner, (_, changes) in LEARNERS.items():
            name = learner_name(learner, seed)
            settings = _train_settings(design.budget, seed=seed, **changes)
            yield Stage(
                name=name,
                rule="train",
                options={"config": stage_path(name) / TRAIN},
                settings=settings,
                expected=_START + 2.0 * _STEP * settings["steps"],
            )


def _on_arm(design: Design) -> Iterator[Stage]:
    """Fine-tune nominal policies of the paper's law on the arm; train another there."""
    budget = design.budget
    for training in design.trainings("paper", "nominal")[: budget.failing]:
        seed = training.seed
        before, tune, after = (arm_name(w, seed) for w in ("before", "tune", "after"))
        yield _at_one_hole(before, training.name, budget)
        yield _over_fri(
            tune,
            training.name,
            budget,
            budget.fine_tune_steps,
            seed=seed,
            **LAWS["paper"].settings,
        )
        yield _at_one_hole(after, tune, budget)
    yield _over_fri(SCRATCH, None, budget, budget.scratch_steps, seed=design.seed)
    yield _at_one_hole(f"try-{SCRATCH}", SCRATCH, budget)


def _over_fri(
    name: str, source: str | None, budget: Budget, steps: int, **changes: Any
) -> Stage:
    """Return a training on the arm, at one hole pose."""
    policy = None if source is None else str(_policy(source))
    settings = _train_settings(
        replace(budget, train={**budget.train, "steps": steps}),
        arm="mujoco",  # the rule gives the real one
        from_policy=policy,
        fixed_goal=True,
        fixture=ONE_HOLE,
        **changes,
    )
    return Stage(
        name=name,
        rule="train_on_twin",
        needs=() if source is None else (source,),
        options={"config": stage_path(name) / TRAIN},
        settings=settings,
        twin=str(twin_path(ARM)),
        expected=_START + _FRI * _STEP * steps,
    )


def _at_one_hole(name: str, policy_of: str, budget: Budget) -> Stage:
    return _evaluation(name, policy_of, ARM, budget.arm_tries, fixture=ONE_HOLE)


def robustness_cases(budget: Budget) -> Iterator[tuple[str, float, dict[str, Any]]]:
    """Yield what is done to the arm or the hole, how much, and evaluate's settings."""
    for shift in budget.shifts:
        yield "shift", shift, {"fixture_shift": shift}
    for shift in budget.searches:
        steps = _search_length(budget)
        yield "search", shift, {"fixture_shift": shift, "search": "corner", **steps}
    for push in budget.pushes:
        yield "push", push, {"push": push}
    for speed in budget.speeds:
        yield "speed", speed, {"fixture_speed": speed}
    yield "below", 1.0, {"start": "below"}


def _robustness(design: Design) -> Iterator[Stage]:
    """The identified policy of the first twin, with a tare, on that twin."""
    training = design.trainings("tared", "identified")[0]
    for what, level, settings in robustness_cases(design.budget):
        yield _evaluation(
            robustness_name(what, level),
            training.name,
            training.twin,
            design.budget.arm_tries,
            **settings,
        )
