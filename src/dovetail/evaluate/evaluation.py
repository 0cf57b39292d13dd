"""One evaluation from its settings to the written report."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import gymnasium as gym
import numpy as np
from rich.console import Console

from dovetail.arms.address import SCHEMES, parse_address
from dovetail.arms.arm_address import ArmAddress
from dovetail.control.period import DEFAULT_PERIOD, require_period
from dovetail.control.period_option import Period
from dovetail.envs.hole_pose import HolePose
from dovetail.envs.registered import environment_class
from dovetail.errors import ConfigError
from dovetail.evaluate.figures import draw_forces, draw_paths
from dovetail.evaluate.origin import (
    command_line,
    describe_settings,
    name_ground,
    other_period,
    provenance,
    shared_engine,
)
from dovetail.evaluate.outcome import Outcome
from dovetail.evaluate.perturbation import SEARCH_STEPS, Perturbation, make_perturbed
from dovetail.evaluate.report import Report
from dovetail.evaluate.terminal import render_table, run_shown
from dovetail.evaluate.transfer import Row, summarise
from dovetail.evaluate.trials import plan_trials, run_trials
from dovetail.files import claim_output_folder, dated_folder, write_atomic
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import known_env_id, policy_settings, require_yes
from dovetail.learn.spaces import require_spaces
from dovetail.plants.plant import PLANTS
from dovetail.plants.twin import list_twins, load_twin
from dovetail.scene import SceneConfig


@dataclass(frozen=True, kw_only=True)
class EvaluationConfig:
    """What to try, where, and how often."""

    policy: str
    """Policy: a file (.safetensors or .json) or the name of a shipped one."""
    plant: str | None = None
    """Engine of an ideal plant, mujoco or bullet; or give a twin, or an arm."""
    twin: str | None = None
    """Twin to try on: the name of a shipped one, or a .toml file."""
    arm: str | None = None
    """Arm to try on: mujoco, bullet, twin:NAME, fri://HOST:PORT, grpc://HOST:PORT."""
    approach: bool = False
    """Let an arm behind fri:// go to its first start from afar, slowly."""
    accept_contact: bool = False
    """Yes to a policy on a robot whose contact settings are laxer than the defaults."""
    hole: tuple[float, float, float, float] | None = None
    """Where the hole is: x y z [m] of its mouth and yaw [rad], world axes; default
    three poses, which an arm must be able to put the hole at."""
    period: Period | None = None
    """Control period: 1ms, 2ms, 2.5ms or 5ms; default the one in the arm's address, or
    else the policy's training's."""
    peg: str | None = None
    """Shape of peg and hole: square, triangle or round; default the policy's."""
    clearance: float | None = None
    """Gap between peg and hole on each side [m]; default the policy's."""
    hole_shift: float = 0.0
    """Cover the camera: the hole is this far [m], in a random horizontal direction,
    from where it was seen last; 0 to 0.05."""
    push: float = 0.0
    """Push the tool at random times in random directions with up to this force [N];
    0 to 100."""
    hole_speed: float = 0.0
    """Move the hole during the tries at this speed [m/s], out and back, the camera
    following; 0 to 0.1."""
    start: Literal["random", "below"] = "random"
    """Where the tool starts: random, or below the block's surface, beside it."""
    search: Literal["none", "spiral"] = "none"
    """With `hole_shift`: lead the policy over the surface until the peg drops in."""
    tare: bool = True
    """Before each try measure, in free air, the weight that the arm's gravity
    compensation misses, and take it off what the policy commands; not where the policy
    was trained with --no-tare."""
    max_steps: int | None = None
    """Policy steps of 50 ms in a try; default the policy's, 20000 with a search."""
    tries: int = 20
    """Tries at each hole pose."""
    seed: int = 0
    """Seed of starts and noise, 0 or more."""
    workers: int = 1
    """Processes that share the tries; the outcome does not depend on it."""
    keep_logs: bool = True
    """Keep an Episode log of each try: a search of six minutes is one of 40 MB."""
    out: Path | None = None
    """Folder for table, figures, report and logs, new or empty; default a new one, by
    the time, in results."""

    def perturbation(self) -> Perturbation:
        """Return what is done to arm and hole.

        Raises:
            ConfigError: A number out of range.
        """
        return Perturbation(
            hole_shift=self.hole_shift,
            push=self.push,
            hole_speed=self.hole_speed,
            start=self.start,
            search=self.search,
        )


class Evaluation(NamedTuple):
    """What an evaluation gave and where it is."""

    rows: list[Row]
    outcomes: list[Outcome]
    report: Report
    folder: Path
    files: list[Path]


def environment_options(
    config: EvaluationConfig, policy: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the keyword arguments of the environment for a policy.

    Args:
        config: Plant or twin, and what differs from the policy's own task.
        policy: The policy's description; "env" holds its environment's settings.

    Raises:
        ConfigError: Neither or both of plant and twin, or an unknown one.
        PolicyError: The policy sets what is not a policy's to choose.
    """
    places = ("plant", "twin", "arm")
    if sum(vars(config)[name] is not None for name in places) != 1:
        raise ConfigError(
            "give either a plant or a twin or an arm to try the policy on; known "
            f"plants: {', '.join(PLANTS)}; shipped twins: {', '.join(list_twins())}; "
            f"arms: {', '.join(SCHEMES)}"
        )
    options = policy_settings(policy)
    for name in (*places, "peg", "clearance"):
        if (value := vars(config)[name]) is not None:
            options[name] = value
    if config.twin is not None:
        if Path(config.twin).suffix == ".toml":
            options["twin"] = str(Path(config.twin).expanduser().absolute())
        load_twin(options["twin"])
    arm = None if config.arm is None else parse_address(config.arm)
    trained = options.get("period", DEFAULT_PERIOD)
    if arm is None:
        options["period"] = require_period(config.period or trained, "period")
    else:
        options["period"] = arm.control_period(config.period, trained)
        options["arm"] = _usable(config, arm)
    options["tare"] = config.tare and options.get("tare", True)
    is_searching = config.perturbation().search != "none"
    if config.max_steps is not None:
        options["max_steps"] = config.max_steps
    elif is_searching:
        options["max_steps"] = SEARCH_STEPS
    return options


def _usable(config: EvaluationConfig, arm: ArmAddress) -> str:
    """Return the address, or refuse what an arm outside this process cannot do."""
    config.perturbation().require_possible(arm)
    if not arm.is_here and config.workers > 1:
        raise ConfigError(
            f"workers is {config.workers}, but there is one arm at {config.arm}; "
            "needs 1"
        )
    _require_hole(config, can_place=arm.places_fixture)
    return arm.with_approach() if config.approach else arm.text


def _require_hole(config: EvaluationConfig, *, can_place: bool) -> None:
    """Refuse to guess where the hole is, for an arm that cannot move it."""
    if config.hole is None and not can_place:
        raise ConfigError(
            f"the arm at {config.arm} cannot move the hole: say where it is with "
            "--hole X Y Z YAW [m, rad], or add control=HOST:PORT for a simulated "
            "cabinet"
        )


def hole_poses(
    config: EvaluationConfig, policy: Mapping[str, Any]
) -> tuple[HolePose, ...]:
    """Return where the hole is for the tries: by the policy's environment, or given."""
    poses = environment_class(known_env_id(policy)).hole_poses
    if config.hole is None:
        return poses
    return (HolePose.given(config.hole, poses[0].facing),)


def evaluate(config: EvaluationConfig, console: Console) -> Evaluation:
    """Try the policy, print the table, and write everything into the folder.

    Args:
        config: What to do.
        console: Where the progress bar and the table go.

    Raises:
        DovetailError: A setting, the policy or the disk; see its message.
    """
    if config.workers < 1:
        raise ConfigError(f"workers is {config.workers}; needs at least 1")
    file = find_policy(config.policy)
    policy = Policy.load(file)
    poses = hole_poses(config, policy.metadata)
    jobs = plan_trials(len(poses), config.tries, config.seed)
    options = environment_options(config, policy.metadata)
    perturbation = config.perturbation()
    lax = require_yes(options, config.arm, is_given=config.accept_contact)
    if lax:
        console.print(f"note: {lax}", soft_wrap=True)  # before anything moves
    make_env = partial(
        make_perturbed, known_env_id(policy.metadata), perturbation, options
    )
    with closing(_inspect(config, make_env, policy)) as env:
        scene: SceneConfig = env.unwrapped.scene  # type: ignore[attr-defined]
        folder = claim_output_folder(config.out or dated_folder("results"))
        logs = folder / "logs" if config.keep_logs else None
        if logs is not None:
            logs.mkdir()
        started = datetime.now(UTC)
        # One process tries on the environment that is there: it may hold the only arm.
        make = make_env if config.workers > 1 else lambda: env
        load: Any = partial(Policy.load, file)
        trials = run_trials(
            make, load, jobs, poses=poses, logs=logs, workers=config.workers
        )
        ground = name_ground(config)
        parts = [
            file.stem,
            f"{scene.peg} peg",
            f"{1e3 * scene.clearance:g} mm clearance per side",
            *perturbation.describe(),
            f"on {ground}",
            f"control period {1e3 * options['period']:g} ms",
        ]
        title, names = ", ".join(parts), [pose.name for pose in poses]
        outcomes = run_shown(trials, len(jobs), title, names, console)
    rows = summarise(outcomes, names)
    report = Report(
        title=title,
        ground=ground,
        period=options["period"],
        note=_notes(lax, config, options["period"], policy.metadata),
        rows=rows,
        outcomes=outcomes,
        config=describe_settings(replace(config, out=folder), options, poses),
        policy=policy.metadata,
        provenance=provenance(started),
        command=command_line(config),
    )
    _print(report, options["tare"], console)
    files = write_report(report, folder, scene)
    return Evaluation(
        rows, outcomes, report, folder, [*files, *([logs] if logs else [])]
    )


def _notes(
    lax: str, config: EvaluationConfig, period: float, policy: Mapping[str, Any]
) -> str:
    """Return what a reader of the numbers must know; empty for nothing."""
    notes = (lax, other_period(period, policy), shared_engine(config, policy))
    return "; ".join(filter(None, notes))


def _print(report: Report, is_tared: bool, console: Console) -> None:
    if report.note:
        console.print(f"note: {report.note}", soft_wrap=True)
    console.print(report.title, soft_wrap=True)  # a table's title would be broken
    console.print(render_table(report.rows))
    outcomes = report.outcomes
    if tares := [o.tare[:3] for o in outcomes if is_tared and any(o.tare)]:
        x, y, z = np.mean(tares, axis=0)
        console.print(f"mean tare: f* {x:.2f} {y:.2f} {z:.2f} m/s2 along x y z")
    if stopped := Counter(o.stopped for o in outcomes if o.stopped):
        reasons = ", ".join(f"{reason} ({n})" for reason, n in stopped.most_common())
        console.print(f"the arm ended {stopped.total()} tries itself: {reasons}")


def _inspect(
    config: EvaluationConfig, make_env: Callable[[], gym.Env], policy: Policy
) -> gym.Env:
    """Return an environment; says what is wrong before anything is written."""
    env = make_env()
    try:
        _require_hole(config, can_place=env.unwrapped.places_fixture)  # type: ignore[attr-defined]
        pose = hole_poses(config, policy.metadata)[0].pose()
        observation, _ = env.reset(seed=config.seed, options={"hole": pose})
        policy.require_size(observation, env.action_space.shape or ())
        require_spaces(policy.metadata, env)
    except BaseException:
        env.close()
        raise
    return env


def write_report(report: Report, folder: Path, scene: SceneConfig) -> list[Path]:
    """Write figures, JSON and HTML, the HTML last.

    Raises:
        LogError: The disk is full or the folder is not writable.
    """
    labels = [row.label for row in report.rows[:-1]]
    paths = draw_paths(report.outcomes, labels, scene=scene, title=report.title)
    captions = {"Paths of the peg's tip": paths}
    files = [write_atomic(folder / "paths.png", paths)]
    if not math.isnan(report.rows[-1].force_peak):
        forces = captions["Contact force"] = draw_forces(report.outcomes)
        files.append(write_atomic(folder / "forces.png", forces))
    return [
        *files,
        write_atomic(folder / "report.json", report.to_json()),
        write_atomic(folder / "report.html", report.to_html(captions)),
    ]
