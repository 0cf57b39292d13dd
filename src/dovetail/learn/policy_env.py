"""The environment that a policy was trained for, as far as its file may choose it.

A policy's file may be a stranger's. It says what the task was and how actions act; the
user chooses where it runs (plant, twin, arm), never the file.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium

from dovetail.arms.address import parse_address
from dovetail.control.proven import DECLARED
from dovetail.envs.config import USUAL, EnvOptions
from dovetail.envs.registered import make, task_class
from dovetail.errors import ConfigError, PolicyError
from dovetail.learn.policy import Policy
from dovetail.learn.spaces import require_spaces
from dovetail.plugins import is_robot_text, require_unread
from dovetail.robots.find import robot_label
from dovetail.settings import names_in, values_of
from dovetail.tasks.options import option_types, require_types
from dovetail.workcell.cell_config import CellConfig, cell_of

TRAINED_IN = ("plant", "robot", "tracker")
"""Settings that say where the policy was trained: read, and never taken."""
CHOSEN = (
    "task",
    *(n for n in names_in(EnvOptions) if n not in (*TRAINED_IN, *DECLARED)),
)
"""Settings of the environment that a policy's file chooses, beside the task's own."""


def known_env_id(metadata: Mapping[str, Any], said: str | None = None) -> str:
    """Return the Gymnasium id of a policy's environment, dovetail's or the one said.

    Gymnasium imports the module that an id names; a file must not choose that.

    Args:
        metadata: Content of the policy's JSON file.
        said: Id that the user has given, MODULE:ID; None for none.

    Raises:
        ConfigError: No environment of dovetail (lists them), another than the user
            has given, or one of a module that the user has not given.
    """
    env_id = str(metadata.get("env_id"))
    if said not in (None, env_id):
        raise ConfigError(
            f"env is {said!r}, the policy was trained in {env_id!r}; give that one"
        )
    if said is None and ":" in env_id:
        raise ConfigError(
            f"the policy's environment is {env_id!r}: it imports the module "
            f"{env_id.rpartition(':')[0]!r}; add --env {env_id} if you trust it"
        )
    task_class(env_id)
    return env_id


def policy_settings(
    metadata: Mapping[str, Any], said: str | None = None
) -> dict[str, Any]:
    """Return the keyword arguments of the environment that a policy's file may choose.

    Args:
        metadata: Content of the policy's JSON file; "env" holds the settings.
        said: Id of the environment that the user has given, see `known_env_id`.

    Raises:
        ConfigError: See `known_env_id`.
        PolicyError: A setting that the file may not choose, or an unknown one; names
            it, and what is known.
    """
    env = metadata.get("env")
    if not isinstance(env, Mapping):
        raise PolicyError(
            "the policy's JSON file has no section 'env'; export the policy again"
        )
    task = task_class(known_env_id(metadata, said))
    options = option_types(task)
    known = [*CHOSEN, *options]
    for name in env:
        if name not in (*known, *TRAINED_IN):
            raise PolicyError(
                f"the policy's JSON file sets {name!r} of its environment, which is "
                f"not a policy's to choose; known: {', '.join(known)}. Where a policy "
                "runs is said by --plant, --twin or --arm. Do not use a file that "
                "somebody has changed; ask for the one that was exported"
            )
    shared = {name: env[name] for name in names_in(EnvOptions) if name in env}
    try:
        require_unread("the policy's JSON file", "robot", env.get("robot"))
        if "cell" in shared:  # its content: a file must not name another
            shared["cell"] = cell_of(env["cell"])
        checked = values_of(EnvOptions(**shared))
        require_types(env, task)
        if not isinstance(env.get("task", ""), str):
            raise ConfigError(f"task is {env['task']!r}; needed: str")
    except ConfigError as error:
        raise PolicyError(f"the policy's JSON file is damaged: {error}") from error
    own = {name: env[name] for name in ("task", *options) if name in env}
    try:
        own = task.whole(own, may_read=False)
    except ConfigError as error:
        raise PolicyError(f"the policy's JSON file is damaged: {error}") from error
    return own | {name: checked[name] for name in shared if name in CHOSEN}


class LaxSetting(NamedTuple):
    """A contact setting that is laxer than its default."""

    name: str
    """Keyword of the environment."""
    value: float | str
    """As the policy's file has it."""
    default: float | str
    """As it usually is."""
    unit: str = ""
    """Unit of both."""

    def __str__(self) -> str:
        """Name, value and default, for messages."""
        if isinstance(self.value, str) or isinstance(self.default, str):
            return f"{self.name} {self.value} (default {self.default})"
        return f"{self.name} {self.value:g} {self.unit} (default {self.default:g})"


def lax_contact(settings: Mapping[str, Any]) -> list[LaxSetting]:
    """Return the contact settings that are laxer than the defaults.

    Args:
        settings: Keyword arguments of an environment, by `policy_settings`.
    """
    usual, lax = USUAL, []
    for name, unit in (("near_speed", "m/s"), ("near_press", "m/s2")):
        default = vars(usual)[name]
        if (value := settings.get(name, default)) > default:
            lax.append(LaxSetting(name, value, default, unit))
    default = usual.near_distance
    if (value := settings.get("near_distance", default)) < default:
        lax.append(LaxSetting("near_distance", value, default, "m"))
    if (scheme := settings.get("scheme", "qp")) != "qp":
        lax.append(LaxSetting("scheme", scheme, "qp"))
    return lax


def require_contact_accepted(
    settings: Mapping[str, Any], arm: str | None, *, is_given: bool
) -> str:
    """Refuse laxer contact than usual on what may be a robot, unless it is wanted.

    Args:
        settings: Keyword arguments of the environment, by `policy_settings`.
        arm: Address of the arm; None is a simulation of this process. An arm behind
            gRPC may be a robot, one behind FRI is unless it has a control port.
        is_given: True if the user has accepted it.

    Returns:
        What is laxer, as a note; empty for nothing.

    Raises:
        ConfigError: It is laxer, the arm may be a robot, and `is_given` is False.
    """
    lax = lax_contact(settings)
    if not lax:
        return ""
    said = ", ".join(map(str, lax))
    note = f"the policy's contact settings are laxer than the defaults: {said}"
    is_robot = arm is not None and parse_address(arm).may_be_robot
    if is_robot and not is_given:
        raise ConfigError(
            f"{note}. The arm at {arm} may be a robot, which would touch and press "
            "harder; say --accept-contact where that is wanted, or take a policy or a "
            "search that keeps to the defaults"
        )
    return note


def require_own_cell(
    settings: Mapping[str, Any], arm: str | None, *, is_given: bool
) -> None:
    """Refuse to take walls and tool of a robot's cell from a policy's file.

    Args:
        settings: Keyword arguments of the environment, by `policy_settings`.
        arm: Address of the arm; None is a simulation of this process.
        is_given: True if the user has said which cell it is.

    Raises:
        ConfigError: The file says it, the arm may be a robot, and the user does not.
    """
    cell: CellConfig | None = settings.get("cell")
    if cell is None or is_given or arm is None or not parse_address(arm).may_be_robot:
        return
    raise ConfigError(
        f"the policy's file has a cell ({cell.describe()}), and the arm at {arm} may "
        "be a robot, whose walls and tool no policy may choose: say with --cell FILE "
        "which cell it is in"
    )


def require_own_robot(robot: object, arm: str | None, *, is_given: bool) -> None:
    """Refuse to take a robot's limits and masses from a policy's file.

    Args:
        robot: The policy's: a name, or a robot's text.
        arm: Address of the arm; None is a simulation of this process.
        is_given: True if the user has said which robot it is.

    Raises:
        ConfigError: The file describes it, the arm may be a robot, and the user does
            not.
    """
    if is_given or not (isinstance(robot, str) and is_robot_text(robot)):
        return
    if arm is None or not parse_address(arm).may_be_robot:
        return
    raise ConfigError(
        f"the policy's file describes its own robot, {robot_label(robot)!r}, and the "
        f"arm at {arm} may be a robot, whose limits and masses no policy may choose: "
        "say with --robot which robot it is"
    )


def make_policy_env(
    policy: Policy,
    *,
    env_id: str | None = None,
    accept_contact: bool = False,
    **where: Any,
) -> gymnasium.Env:
    """Build the environment that a policy was trained for, somewhere.

    Args:
        policy: Any policy.
        env_id: Its environment, where that is a module's: MODULE:ID.
        accept_contact: Yes to laxer contact settings than the defaults on a robot.
        where: `plant`, `twin` or `arm`, and other options of the environment, which
            override the policy's file. Without any it is the nominal plant.

    Raises:
        ConfigError: An unknown environment, or a setting out of range.
        PolicyError: The file sets what is not its to choose, or observation or action
            mean something else here than in training: names the column or axis.
    """
    settings = policy_settings(policy.metadata, env_id) | where
    env_id = known_env_id(policy.metadata, env_id)
    require_contact_accepted(settings, where.get("arm"), is_given=accept_contact)
    require_own_cell(settings, where.get("arm"), is_given="cell" in where)
    env = make(env_id, **settings)
    try:
        require_spaces(policy.metadata, env)
    except PolicyError:
        env.close()
        raise
    return env
