"""One run: a seed from its settings to weights, evaluation and provenance."""

import json
import shlex
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

from dovetail.arms.address import parse_address
from dovetail.envs.unwrapped import require_contact_env
from dovetail.envs.workspace import require_drawn
from dovetail.errors import ArmError, PlantError
from dovetail.files import write_atomic
from dovetail.interrupt import Interrupt, ends_whole
from dovetail.learn.algorithms import make_model, make_vec_env
from dovetail.learn.assess import TestEnvs, assess
from dovetail.learn.best_actor import BestActor
from dovetail.learn.checkpoint import (
    list_checkpoints,
    load_checkpoint,
    save_checkpoint,
    seed_run,
)
from dovetail.learn.config import TrainConfig
from dovetail.learn.demonstrations import pretrain
from dovetail.learn.early_stopping import EarlyStopping
from dovetail.learn.fine_tune import load_start, require_fit, start_from
from dovetail.learn.policy import RUN_POLICY, Policy
from dovetail.learn.progress import (
    EpisodeLog,
    Report,
    Stopwatch,
    read_progress,
    summarise,
)
from dovetail.learn.run_folder import (
    CHECKPOINTS,
    EVALUATION,
    PROGRESS,
    TENSORBOARD,
    RunLock,
    open_run,
    require_run,
)
from dovetail.learn.tester import Tester, stage_of
from dovetail.plugins import named_modules
from dovetail.settings import values_of


class TrainResult(NamedTuple):
    """Result of a finished run."""

    policy: Path
    """The policy's weights; the JSON file lies beside them."""
    evaluation: dict[str, Any] | None
    """Content of evaluation.json; None where `eval_episodes` is 0."""
    steps: int
    """Environment steps trained."""
    wall_time: float
    """Training time over all sittings [s]."""
    end: str = ""
    """Reason for which it ended, in words."""


CUT_SHORT = "finishing this step, then a checkpoint is saved"
"""Message after Ctrl-C."""


def resume_command(config: TrainConfig, folder: Path) -> str:
    """Return the command line that goes on with a run."""
    own = named_modules(values_of(config))  # a run's folder alone lets none be imported
    arm = None if config.arm is None else parse_address(config.arm)
    if arm is not None and not arm.is_here:  # nor does it let one be reached
        own += ["--arm", arm.text]
    return shlex.join(["dovetail", "train", "--resume", "--out", str(folder), *own])


def train_one(
    config: TrainConfig,
    report: Report,
    begin: Callable[[Path], None] = lambda folder: None,
    interrupt: Interrupt | None = None,
) -> TrainResult:
    """Train one seed in this process; see `train`.

    Args:
        config: Settings; `seeds` is not looked at.
        report: Told now and then where the run stands.
        begin: Told the run folder as soon as it is there.
        interrupt: Ends the run at its next whole step; None is Ctrl-C's.

    Raises:
        KeyboardInterrupt: It was cut short; a checkpoint was saved.
    """
    with prepared(config) as run:
        model = run.model
        folder = open_run(config)
        given = ends_whole(CUT_SHORT) if interrupt is None else nullcontext(interrupt)
        with RunLock(folder), given as told:
            begin(folder)
            test = Tester(model, run.best, config, run.stop, told.check)
            with closing(test) as tester:
                wall_time = _learn(run, tester, config, folder, report, told.check)
            policy = _export(model, config, folder, wall_time)
            steps = int(model.num_timesteps)
            rows = read_progress(folder / PROGRESS)
            phase = "evaluating" if config.eval_episodes else "done"
            report(summarise(rows, steps, 0.0)._replace(phase=phase))
            stage = stage_of(model.get_env())._replace(check=told.check)
            evaluation = _evaluate(policy, config, folder, stage)
    end = run.stop.end or _unproven(run.stop, config)
    return TrainResult(folder / RUN_POLICY, evaluation, steps, wall_time, end)


def _unproven(stop: EarlyStopping, config: TrainConfig) -> str:
    """Say that the steps ended a run, and what its last test had shown."""
    if config.asked_success == 1.0:
        return "all steps, as asked"
    shown = stop.said or "no test was due: too many tries failed"
    return f"all steps; {shown}; more of them may help (--steps)"


class Prepared(NamedTuple):
    """Model, judge and stopping rule of a run."""

    model: Any
    """The algorithm with its environments."""
    best: BestActor | None
    """The judge of a run that starts from a policy."""
    stop: EarlyStopping
    """Says when it has learned."""


@contextmanager
def prepared(config: TrainConfig) -> Iterator[Prepared]:
    """Build the model of a run, and close its environments at the end.

    A wrong setting is refused here, before the run has a folder.

    Args:
        config: Settings.
    """
    require_run(config)  # before an arm on the network is waited for
    start = load_start(config)  # and before the learning stack is, which takes seconds
    env = make_vec_env(config)
    try:
        if config.fixed_place is None:
            core = require_contact_env(env.envs[0])
            require_drawn(core.task, core.cell, core.arm)
        stop = EarlyStopping(config)
        model = make_model(config, env, stop.rate)
        if start is not None or (config.pretrain and not config.has_teacher):
            model.learning_starts = 0  # its own actions are better than random ones
        best = None
        if start is not None:
            require_fit(start, config, env.envs[0])
            start_from(model, start)
            best = BestActor(model, config.learning_starts)
        yield Prepared(model, best, stop)
    finally:
        env.close()


def _learn(
    run: Prepared,
    tester: Tester,
    config: TrainConfig,
    folder: Path,
    report: Report,
    check: Callable[[], None],
) -> float:
    """Train from the start or the newest checkpoint; return the training time [s]."""
    from stable_baselines3.common.callbacks import ConvertCallback
    from stable_baselines3.common.logger import configure

    from dovetail.learn.recorder import Recorder

    model, stop = run.model, run.stop
    checkpoints = folder / CHECKPOINTS
    step, wall_time = 0, 0.0
    if found := list_checkpoints(checkpoints):
        wall_time = load_checkpoint(found[-1], model, config.seed)
        step = model.num_timesteps
    if step >= config.steps:
        return wall_time
    log = EpisodeLog(folder / PROGRESS, step)
    for row in log.before:
        stop.note(row)
    if stop.is_due(step) and tester.is_passed():  # the end was cut short
        log.close()
        return wall_time
    watch = Stopwatch(wall_time, step, lambda: model._n_updates)
    model.set_logger(configure(str(folder / TENSORBOARD), ["tensorboard"]))
    if not found:
        seed_run(model, config.seed, 0)
        if config.pretrain:
            report(summarise([], 0, 0.0)._replace(phase="pretraining"))
            pretrain(model, config, check)
    recorder = Recorder(
        log,
        watch,
        report,
        lambda: save_checkpoint(checkpoints, model, watch.elapsed()),
        config.checkpoint_interval,
        stop,
        tester.is_passed,
        run.best,
    )
    ended = ConvertCallback(lambda *_: check() is None)  # or it raises
    try:
        left = config.steps - step
        model.learn(left, callback=[recorder, ended], reset_num_timesteps=False)
        wall_time = watch.elapsed()
        save_checkpoint(checkpoints, model, wall_time)
    except (PlantError, ArmError, KeyboardInterrupt):
        save_checkpoint(checkpoints, model, watch.elapsed())  # an arm's time is dear
        raise
    finally:
        log.close()
        model.logger.close()
    return wall_time


def _export(model: Any, config: TrainConfig, folder: Path, wall_time: float) -> Policy:
    from dovetail.learn.export import export_policy

    env = model.get_env().envs[0]
    path = export_policy(model, config, env, wall_time=wall_time).save(
        folder / RUN_POLICY
    )
    return Policy.load(path)


def _evaluate(
    policy: Policy, config: TrainConfig, folder: Path, stage: TestEnvs
) -> dict[str, Any] | None:
    if config.eval_episodes == 0:
        return None
    # The run's own environments: what a policy's file says leaves arm and model out.
    evaluation = assess(policy, config.eval_episodes, stage)
    write_atomic(folder / EVALUATION, json.dumps(evaluation, indent=2) + "\n")
    return evaluation
