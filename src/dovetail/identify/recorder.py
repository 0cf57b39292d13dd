"""Play the scripted sequences on an arm and log them."""

import json
import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from dovetail.arms.address import parse_address
from dovetail.control.limits import ApproachLimits, DeclaredErrors
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.control.proven import DECLARED
from dovetail.control.target_columns import TARGET_UNITS, target_row
from dovetail.distribution import installed_version
from dovetail.envs.commands import per_axis
from dovetail.envs.config import FORCE_DAMPING, USUAL, EnvConfig
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.registered import make_task
from dovetail.envs.workspace import require_inside
from dovetail.episode import Episode
from dovetail.errors import ArmError, ConfigError
from dovetail.files import require_writable, write_atomic
from dovetail.identify.contact_recorder import record_contact
from dovetail.identify.excitation import EXCITATION, EXCITED, excitation
from dovetail.identify.gapless import play_gapless
from dovetail.identify.measured_delay import measure_delay
from dovetail.identify.plain_strip import plain_strips
from dovetail.identify.recording import (
    DESCRIPTION,
    FORMAT,
    TARGETS,
    Recording,
    read_description,
    sequence_path,
    usual_place,
)
from dovetail.identify.starts import plan_starts, start_box
from dovetail.options import Period, Placement
from dovetail.plants.plant import COLUMN
from dovetail.robots.find import find_robot, whole_robot
from dovetail.settings import settings
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.options import option_types, require_apart
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.tasks.task import Task
from dovetail.types import Array, Vec7
from dovetail.workcell.cell_config import CellFile
from dovetail.workcell.workcell import Workcell

CONTACT_FORCE = 0.1
"""Contact force from which the held part counts as in contact [N]."""
PLAY = 0.002
"""Distance from the block that counts as contact where no force is measured [m]."""


@settings()
class RecordedArmConfig:
    """The arm that moves."""

    arm: str = "twin:medium"
    """Arm: mujoco, bullet, drake, twin:NAME, fri://, franka:// or grpc://HOST."""
    period: Period = DEFAULT_PERIOD
    """Control period: 1ms, 2ms, 2.5ms or 5ms."""
    robot: str = USUAL.robot
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION."""
    cell: CellFile = None
    """Cell file: table, tool, walls and fixture."""


@settings()
class MotionsConfig:
    """The scripted config."""

    seed: int = 0
    """Seed; another one makes a held-out log."""
    sequences: int = 10
    """Number of sequences."""
    steps: int = 50
    """Policy steps of 50 ms of each."""
    f_scale: float = 8.0
    """f* of X Y Z at action 1 [m/s2]."""
    force_damping: float = FORCE_DAMPING
    """Damping of X Y Z [1/s]."""


@settings()
class RecordedTaskConfig:
    """Held part, and the fixture around it."""

    env: str = DEFAULT_ENV
    """Task: an id, or MODULE:ID."""
    task_options: dict[str, Any] = field(default_factory=dict)
    """Fields of the task; left out, they are its own."""
    fixture: Placement = None
    """Place of the fixture: x y z [m], yaw, tilts B C [rad]."""
    allow_contact: bool = False
    """Keep a sequence with contact."""
    contact: bool = False
    """Slide the part on the fixture, too, for its friction."""


@settings()
class RecordConfig(
    RecordedArmConfig, DeclaredErrors, MotionsConfig, RecordedTaskConfig
):
    """Settings of a recording: motions, arm, task and folder."""

    out: Path
    """Folder for the recording; one cut short goes on."""


def record(
    config: RecordConfig, console: Console, starts: Sequence[Vec7] | None = None
) -> Recording:
    """Play what is missing of the sequences and return the whole recording.

    Args:
        config: What to do.
        console: Where progress goes.
        starts: Configuration at the start of each sequence [rad]; None plans them.

    Raises:
        ConfigError: A setting, or a folder that holds another recording.
        ArmError: The arm, or the held part in contact.
    """
    count = config.sequences
    actions = excitation(config.seed, count, config.steps)
    address = parse_address(config.arm)
    _require_fixture(config, can_place=address.places_fixture)
    asked = None if config.period == DEFAULT_PERIOD else config.period
    task = replace(make_task(config.env, config.task_options), axes=EXCITED)
    settings = EnvConfig(
        robot=config.robot,
        cell=config.cell,
        period=address.control_period(asked, DEFAULT_PERIOD),
        max_steps=config.steps + 1,
        f_scale=config.f_scale,
        force_damping=config.force_damping,
        near_press=ApproachLimits.near_press,  # none: motions are as they were drawn
        tare=False,  # a motion without it is what a replay repeats
        **config.declared_errors(),
    )
    cell = task.workcell(find_robot(config.robot), config.cell)
    place = _place(task, config, cell)
    box = start_box(cell, place.pose(), may_touch=config.allow_contact)
    strips = plain_strips(task, cell, place.pose()) if config.contact else ()
    env = ContactEnv(task, config.arm, settings)
    with closing(env):
        _require_fixture(config, can_place=env.places_fixture)
        require_inside(task, cell, env.arm, place.pose())
        if starts is None:
            robot = env.arm.facts.robot
            starts = plan_starts(task, robot, config.seed, count, place, box)
        metadata = _describe(config, env, place, starts)
        if not _is_begun(config.out, metadata):
            _begin(env, config.out, metadata, place, console)
        left = [n for n in range(count) if not sequence_path(config.out, n).is_file()]
        for number in track(left, f"recording {config.arm}", console=console):
            rows = actions[number]
            episode = play_gapless(
                partial(_play_once, env, config, metadata, place, number, rows),
                lambda played: [played.data[:, COLUMN["time"]]],
                env.arm.facts.period,
                f"sequence {number}",
            )
            episode.save(sequence_path(config.out, number))
        if strips:
            record_contact(env, strips, place.pose(), config.out, metadata, console)
    return Recording.load(config.out)


def _place(task: Task, config: RecordConfig, cell: Workcell) -> FixturePose:
    """Return where the fixture is, or is put."""
    usual = usual_place(task, cell)
    if config.fixture is None:
        return usual
    return FixturePose.given(config.fixture, usual.facing)


def _require_fixture(config: RecordConfig, *, can_place: bool) -> None:
    """Refuse to guess where the fixture is, for an arm that cannot move it."""
    if config.fixture is None and not can_place:
        raise ConfigError(
            f"the arm at {config.arm} cannot move the fixture: say where it is "
            "with --fixture X Y Z YAW [m, rad]; the motions stay above it"
        )


def _describe(
    config: RecordConfig,
    env: ContactEnv,
    place: FixturePose,
    starts: Sequence[Vec7],
) -> dict[str, Any]:
    """Return what `recording.json` holds."""
    address = parse_address(config.arm)
    declared = config.declared_errors()
    facts = env.arm.facts
    is_hardware = address.margins == "hardware"
    about = {
        "format": FORMAT,
        "robot": facts.robot.name,
        "env_id": config.env,
        "arm_model": whole_robot(config.robot),
        "task": str(env.axes),
        "period": facts.period,
        "fixture": list(place.numbers),
        "arm": parse_address(config.arm).text,
        "tare": env.is_tared,
        "commands": {
            "f_scale": list(per_axis("f_scale", env.config.f_scale)),
            "f_scale_angular": env.config.f_scale_angular,
            "theta_range": env.config.theta_range,
            "position_range": env.config.position_range,
        },
        "controller": {
            "force_damping": list(per_axis("", env.config.force_damping)),
            "near_speed": env.config.near_speed,
            "walls": [list(side) for side in env.cell.walls],
            "scheme": env.config.scheme,
            "is_hardware": is_hardware,
            **({} if declared == DECLARED else declared),
        },
        "excitation": {
            "description": EXCITATION,
            "seed": config.seed,
            "sequences": config.sequences,
            "steps": config.steps,
        },
        "q_start": [np.asarray(q).tolist() for q in starts],
    }
    if config.cell is not None:
        about["cell"] = config.cell.table()
    task = type(env.task)
    require_apart(task, about, "words of recording.json")
    return about | {name: vars(env.task)[name] for name in option_types(task)}


def _is_begun(folder: Path, metadata: dict[str, Any]) -> bool:
    """Say whether a folder holds the begin of this recording.

    Raises:
        ConfigError: It holds something else.
    """
    if (folder / DESCRIPTION).is_file():
        before = read_description(folder)
        differ = [k for k in metadata if before.get(k) != metadata[k]]
        if differ:
            raise ConfigError(
                f"{folder} holds a recording with other settings: "
                f"{', '.join(differ)} differ; nothing was overwritten: choose another "
                "--out"
            )
        return True
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder} exists and is no recording; choose another --out")
    require_writable(folder, "--out")  # before the arm moves
    return False


def _begin(
    env: ContactEnv,
    folder: Path,
    metadata: dict[str, Any],
    place: FixturePose,
    console: Console,
) -> None:
    """Measure and print the arm's delay, and write the description."""
    q_start = np.array(metadata["q_start"][0])
    delay = measure_delay(env, q_start, place.pose())
    colour = "green" if delay.check.status == "ok" else "red"
    console.print(
        f"[{colour}]{delay.check.status}[/] delay {delay.check.detail}",
        markup=True,
        highlight=False,
        soft_wrap=True,
    )
    folder.mkdir(parents=True, exist_ok=True)
    facts = {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": installed_version("dovetail"),
        "delay": delay.facts,
    }
    write_atomic(folder / DESCRIPTION, json.dumps(metadata | facts, indent=1) + "\n")


def _play_once(
    env: ContactEnv,
    config: RecordConfig,
    metadata: dict[str, Any],
    place: FixturePose,
    number: int,
    actions: Array,
) -> Episode:
    """Play one sequence and return its log."""
    fixture, q_start = place.pose(), np.array(metadata["q_start"][number])
    seed = config.seed * 1000 + number
    env.reset(seed=seed, options={"fixture": fixture, "start": q_start})
    facts = {name: metadata[name] for name in ("robot", "task", "period")}
    facts |= {"q_start": env.state.q, "sequence": number}
    targets: list[list[float]] = []
    units = list(TARGET_UNITS.values())
    facts[TARGETS] = {"columns": list(TARGET_UNITS), "units": units, "rows": targets}
    episode = Episode(metadata=facts)
    for step, action in enumerate(actions.astype(np.float32)):
        targets.append(target_row(env.begin_step(action)).tolist())
        _, reward, _, _, info = env.step(action)
        contact = _contact(env, info["contact_force_max"])
        if contact and not config.allow_contact:
            raise ArmError(
                f"the held part is in contact: {contact} in sequence {number}, step "
                f"{step}; a fit needs free motion: move it away with --fixture, or "
                "give --allow-contact",
                "contact",
            )
        episode.append(env.state.log, step, action, float(reward))
    return episode


def _contact(env: ContactEnv, force: float) -> str:
    """Say in words how the held part touched something in the last step, or "".

    Args:
        env: After the step.
        force: Largest contact force [N]; not-a-number where the arm measures none, and
            the held part's place has to tell.
    """
    if math.isfinite(force):
        return f"{force:.1f} N" if force > CONTACT_FORCE else ""
    tips = env.state.log[:, COLUMN["x"] : COLUMN["z"] + 1]
    for tip in tips:
        if not env.cell.is_free(tip, env.fixture, PLAY):
            height = 1e3 * (tip[2] - env.fixture.position[2])
            return (
                f"the {env.cell.held.name}'s end {height:.1f} mm above the "
                f"{env.cell.fixture.name}, at its block"
            )
    return ""
