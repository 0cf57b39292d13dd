"""Settings of an evaluation, and the options of its environment."""

from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from dovetail.arms.address import SCHEMES, parse_address
from dovetail.arms.arm_address import ArmAddress
from dovetail.control.limits import DeclaredErrors
from dovetail.control.period import DEFAULT_PERIOD, require_period
from dovetail.control.task_spec import AXES, HOLD, TaskSpec
from dovetail.envs.config import GRASP_ERROR, GRASP_TURN
from dovetail.envs.registered import make_task
from dovetail.errors import ConfigError
from dovetail.evaluation.perturbation import Perturbation
from dovetail.learn.policy_env import (
    known_env_id,
    policy_settings,
    require_own_cell,
    require_own_robot,
)
from dovetail.options import Period, Placement
from dovetail.plants.plant import PLANTS
from dovetail.plants.twin import list_twins, load_twin
from dovetail.plugins import module_of
from dovetail.poses import rotation_error
from dovetail.robots.find import DEFAULT_ROBOT, find_robot
from dovetail.search.script import SCRIPT_SETTINGS
from dovetail.settings import names_in, settings
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.task import Task
from dovetail.workcell.cell_config import CellConfig, CellFile

_HELD_MOST = 0.05
"""Largest turn about an axis that is held, between start and goal [rad]."""


@settings()
class TriedTaskConfig:
    """The task, by default as in the policy's training."""

    env: str | None = None
    """Environment of the policy; needed for one of your own, MODULE:ID. --part FILE has
    its own task. A policy's file alone lets no module be imported."""
    task_options: dict[str, Any] = field(default_factory=dict)
    """Fields of the task; left out, they are the policy's."""
    fixture: Placement = None
    """Place of the fixture: x y z [m], yaw and perhaps tilts B C [rad].
    World axes; B and C are about its y and x. Default three poses, which an arm must be
    able to put the fixture at."""
    cell: CellFile = None
    """Cell file: table, tool, walls, and where fixtures stand. Left out, the cell is
    that of the policy's training; an empty file is the task's own."""
    max_steps: int | None = None
    """Policy steps of 50 ms in a try; default the policy's. With a search 400."""
    fall_back: float | None = None
    """The corner search takes over after this time of a try [s]; 0 is never. Default
    what the policy's file says."""
    tare: bool | None = None
    """Measure before each try the weight that gravity compensation misses. It is taken
    off what the policy commands. Default as the policy was trained, or else on every
    arm but the nominal simulation, which misses none."""
    grasp_error: Annotated[float | None, GRASP_ERROR] = None
    """Largest displacement of the held part in the fingers [m].
    Default the policy's."""
    grasp_turn: Annotated[float | None, GRASP_TURN] = None
    """Largest turn of it about each axis [rad]; default the policy's."""


@settings()
class TriedPlaceConfig:
    """Plant, twin or arm to try on."""

    plant: str | None = None
    """Engine of an ideal plant, mujoco, bullet or drake; or give a twin, or an arm."""
    twin: str | None = None
    """Twin to try on: the name of a shipped one, or a .toml file."""
    arm: str | None = None
    """Arm to try on: mujoco, bullet, drake, twin:NAME, fri://HOST:PORT, grpc://HOST:PORT."""
    approach: bool = False
    """Let an arm behind fri:// go to its first start from afar, slowly."""
    accept_contact: bool = False
    """Yes to a policy on a robot whose contact settings are laxer than the defaults."""
    robot: str | None = None
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION.
    Default the policy's."""
    tracker: str | None = None
    """Tracker of the fixture: truth, delayed, noisy, late, twin, or a camera's file.
    With numbers: delayed?delay=0.1, late?bias=0.002; twin is the camera of the twin's
    file; MODULE:CLASS is one of your own. Default the truth."""
    period: Period | None = None
    """Control period: 1ms, 2ms, 2.5ms or 5ms. Default the one in the arm's address, or
    else the policy's training's."""


@settings()
class TriesConfig:
    """The tries and their results."""

    tries: int = 20
    """Tries at each fixture pose."""
    seed: int = 0
    """Seed of starts and noise, 0 or more."""
    workers: int = 1
    """Processes that share the tries; the outcome does not depend on it."""
    keep_logs: bool = True
    """Keep an Episode log of each try."""
    video: bool = False
    """Film the first try at each pose: an animated GIF beside the report, and in it."""
    out: Path | None = None
    """Folder for table, figures, report and logs, new or empty. Default a new one, by
    the time, in results."""


@settings()
class EvaluationConfig(
    TriedTaskConfig, TriedPlaceConfig, DeclaredErrors, Perturbation, TriesConfig
):
    """Settings of an evaluation: policy, place, disturbances and tries."""

    policy: str
    """Policy: a file (.safetensors, .json), a training's folder or a shipped name."""

    @property
    def perturbation(self) -> Perturbation:
        """The disturbances alone."""
        return Perturbation(**{n: vars(self)[n] for n in names_in(Perturbation)})


def environment_options(
    config: EvaluationConfig, policy: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the keyword arguments of the environment for a policy.

    Args:
        config: Plant or twin, and what differs from the policy's own task.
        policy: The policy's description; "env" holds its environment's settings.

    Raises:
        ConfigError: Neither or both of plant and twin, or an unknown one.
    """
    places = ("plant", "twin", "arm")
    if sum(vars(config)[name] is not None for name in places) != 1:
        raise ConfigError(
            "give either a plant or a twin or an arm to try the policy on; known "
            f"plants: {', '.join(PLANTS)}; shipped twins: {', '.join(list_twins())}; "
            f"arms: {', '.join(SCHEMES)}"
        )
    options = policy_settings(policy, config.env) | config.task_options
    options |= _trained_robot(config, policy) | config.declared_errors()
    require_own_cell(options, config.arm, is_given=config.cell is not None)
    told = policy["env"].get("robot")
    require_own_robot(told, config.arm, is_given=config.robot is not None)
    for name in (*places, "robot", "tracker", "cell"):
        if (value := vars(config)[name]) is not None:
            options[name] = value
    if config.plant is None:
        options.pop("plant", None)
    if config.twin is not None:
        if Path(config.twin).suffix == ".toml":
            options["twin"] = str(Path(config.twin).expanduser().absolute())
        load_twin(options["twin"])
    arm = None if config.arm is None else parse_address(config.arm)
    _require_used(config)
    trained = options.get("period", DEFAULT_PERIOD)
    if arm is None:
        options["period"] = require_period(config.period or trained, "period")
    else:
        options["period"] = arm.control_period(config.period, trained)
        options["arm"] = _usable(config, arm)
    if config.search != "none":
        options |= SCRIPT_SETTINGS
    return options | _episode(config)


def _require_used(config: EvaluationConfig) -> None:
    """Refuse what is given beside another option that would override it."""
    shift = config.fixture_shift
    if config.approach and config.arm is None:
        raise ConfigError("approach is given, which needs --arm fri://HOST:PORT")
    if config.tracker is not None and shift:
        raise ConfigError(
            f"the tracker {config.tracker} and a covered camera (fixture_shift "
            f"{shift:g} m) exclude each other: leave one of them out"
        )


def _episode(config: EvaluationConfig) -> dict[str, Any]:
    """Return what is asked of an episode's course."""
    search = config.search
    if search != "none" and config.fall_back:
        raise ConfigError(
            f"fall_back is {config.fall_back:g} s, but with --search {search} "
            "the search acts from the start; give one of the two"
        )
    names = ("fall_back", "max_steps", "tare", "grasp_error", "grasp_turn")
    return {n: vars(config)[n] for n in names if vars(config)[n] is not None}


def _trained_robot(
    config: EvaluationConfig, policy: Mapping[str, Any]
) -> dict[str, str]:
    """Return the robot of the policy's training, where no other is asked for.

    Raises:
        ConfigError: It is a module's, which only the command line may name.
    """
    told = policy["env"].get("robot")
    if config.robot is not None or not isinstance(told, str):
        return {}
    if module_of("robot", told):
        raise ConfigError(
            f"the policy was trained with the robot {told!r}, of a module; add --robot "
            f"{told} if you trust it"
        )
    return {"robot": told}


def _usable(config: EvaluationConfig, arm: ArmAddress) -> str:
    """Return the address, or refuse what an arm outside this process cannot do."""
    config.perturbation.require_possible(arm)
    workers = config.workers
    if not arm.is_here and workers > 1:
        raise ConfigError(
            f"workers is {workers}, but there is one arm at {config.arm}; needs 1"
        )
    require_place(config, can_place=arm.places_fixture)
    return arm.with_approach() if config.approach else str(config.arm)


def require_place(config: EvaluationConfig, *, can_place: bool) -> None:
    """Refuse to guess where the fixture is, for an arm that cannot move it."""
    if config.fixture is None and not can_place:
        raise ConfigError(
            f"the arm at {config.arm} cannot move the fixture: say where it is "
            "with --fixture X Y Z YAW [m, rad], or add control=HOST:PORT for a "
            "simulated cabinet"
        )


def cell_in(config: EvaluationConfig, policy: Mapping[str, Any]) -> CellConfig | None:
    """Return the cell of the tries: the given one, or that of the policy's training."""
    if config.cell is not None:
        return config.cell
    return policy_settings(policy, config.env).get("cell")


def other_cell(config: EvaluationConfig, policy: Mapping[str, Any]) -> str:
    """Say that the policy was trained in another cell; empty where not."""
    trained = policy_settings(policy, config.env).get("cell") or CellConfig()
    if config.cell is None or config.cell == trained:
        return ""
    return (
        f"the cell of the tries has {config.cell.describe() or 'nothing of its own'}, "
        f"that of the policy's training {trained.describe() or 'nothing of its own'}"
    )


def fixture_poses(
    config: EvaluationConfig, policy: Mapping[str, Any]
) -> tuple[FixturePose, ...]:
    """Return where the fixture is for the tries: the policy's own poses, or given."""
    options = policy_settings(policy, config.env) | config.task_options
    task = make_task(known_env_id(policy, config.env), options)
    trained = _trained_robot(config, policy).get("robot", DEFAULT_ROBOT)
    robot = find_robot(config.robot or trained)
    poses = task.trial_poses_in(task.workcell(robot, cell_in(config, policy)))
    if config.fixture is None:
        return poses
    place = FixturePose.given(config.fixture, poses[0].facing)
    _require_turning(task, place)
    return (place,)


def _require_turning(task: Task, place: FixturePose) -> None:
    """Refuse a tilted place for a policy that holds the tool as a try starts.

    Raises:
        ConfigError: Names the axes that would have to turn, and by how much.
    """
    if not (place.b or place.c):
        return
    fixture = place.pose()
    start = task.draw_start(np.random.default_rng(0), fixture)
    lacking = rotation_error(task.goal(fixture).quat_wxyz, start.quat_wxyz)
    modes = TaskSpec.parse(task.axes).modes
    held = [
        f"{axis} ({lacking[AXES.index(axis) - 3]:.2f} rad)"
        for axis in "BC"
        if modes[AXES.index(axis)] == HOLD
        and abs(lacking[AXES.index(axis) - 3]) > _HELD_MOST
    ]
    if held:
        raise ConfigError(
            f"the fixture is tilted, and the policy's task '{task.axes}' holds "
            f"{' and '.join(held)} where a try starts, so that the tool cannot turn to "
            "it; take a policy that commands B and C, such as one trained with --tilt"
        )
