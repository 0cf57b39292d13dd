"""Choice of policy, task and place, and the environment built from it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

import gymnasium
import numpy as np

from dovetail.arms.address import parse_address
from dovetail.control.limits import SCHEMES
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.envs.config import ENDLESS
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.log_facts import describe_cell
from dovetail.envs.registered import make, task_class
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import (
    known_env_id,
    make_policy_env,
    require_contact_accepted,
    require_own_robot,
)
from dovetail.plants.plant import PLANTS
from dovetail.plants.twin import list_twins
from dovetail.plugins import is_read, module_of
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.search.script import SCRIPT_SETTINGS, CornerScript
from dovetail.tasks.shipped import DEFAULT_ENV

NO_POLICY = "none"
"""Name that means no policy: only a person moves the arm."""
SCRIPT = "corner"
"""Name of the scripted corner search, in place of a policy."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Policy, place and task; a new choice rebuilds everything."""

    policy: str = NO_POLICY
    """A policy's file, the name of a shipped one, `SCRIPT` or `NO_POLICY`."""
    place: str = "mujoco"
    """Address of the arm: a plant, twin:NAME, fri://..., grpc://..."""
    env: str | None = None
    """Gymnasium id of the task; None is the policy's, or the usual one."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of task and environment; they override the policy's."""
    accept_contact: bool = False
    """Yes to laxer contact settings than the defaults, on a robot."""


def build(
    choice: Choice, fixture: Sequence[float] | None = None
) -> tuple[gymnasium.Env, Policy | CornerScript | None]:
    """Return the environment, and the policy or script that acts in it, if any.

    Args:
        choice: Policy, place and task.
        fixture: Place of the fixture: x y z [m], yaw and perhaps tilts B C [rad]; None
            is the task's.

    Raises:
        DovetailError: No such policy, place or setting; they do not fit together; or
            the fixture's place is unknown.
    """
    policy: Policy | CornerScript | None = None
    where: dict[str, Any] = {"arm": choice.place, "max_steps": ENDLESS}
    where |= choice.settings
    if choice.policy in (NO_POLICY, SCRIPT):
        env_id = choice.env or DEFAULT_ENV
        task_class(env_id)
        where["period"] = _period(choice, {})
        if choice.policy == SCRIPT:
            policy, where = CornerScript(), {**SCRIPT_SETTINGS, **where}
            require_contact_accepted(
                where, choice.place, is_given=choice.accept_contact
            )
        env = make(env_id, **where)
    else:
        policy = Policy.load(find_policy(choice.policy))
        trained = policy.metadata.get("env", {})
        robot = _trained_robot(trained)
        require_own_robot(robot, choice.place, is_given="robot" in where)
        where = {"robot": robot, **where}
        where["period"] = _period(choice, trained)
        env = make_policy_env(
            policy,
            env_id=choice.env,
            accept_contact=choice.accept_contact,
            **where,
        )
    try:
        core = require_contact_env(env)
        _require_place(core, fixture)
        if isinstance(policy, CornerScript):
            policy.take(core)
        elif policy is not None:
            nothing = np.zeros(env.observation_space.shape or ())
            policy.require_size(nothing, env.action_space.shape or ())
    except BaseException:
        env.close()
        raise
    return env, policy


def _period(choice: Choice, trained: Mapping[str, Any]) -> float:
    """Return the control period [s]: the one set, the arm's, or the training's."""
    usual = trained.get("period", DEFAULT_PERIOD)
    asked = choice.settings.get("period")
    return parse_address(choice.place).control_period(asked, usual)


def _trained_robot(trained: Mapping[str, Any]) -> str:
    """Return the robot of a policy's training; only the user may name a module's."""
    robot = str(trained.get("robot", DEFAULT_ROBOT))
    return DEFAULT_ROBOT if module_of("robot", robot) or is_read(robot) else robot


def describe(env: gymnasium.Env, choice: Choice) -> dict[str, Any]:
    """Return the metadata of a log: enough to draw it again."""
    core = require_contact_env(env)
    return describe_cell(env) | {
        "policy": choice.policy,
        "place": parse_address(choice.place).text,  # without a token
        "period [s]": core.arm.facts.period,
        "tare [m/s2, rad/s2]": np.round(core.commands.tare, 3).tolist(),
    }


def known_places(choice: Choice) -> tuple[str, ...]:
    """Return the places to choose from: the simulations, if it runs in one."""
    address = parse_address(choice.place)
    if not address.is_here:
        return (address.text,)
    usual = (*(f"twin:{name}" for name in list_twins()), *PLANTS)
    return tuple(dict.fromkeys((choice.place, *usual)))


def known_words(choice: Choice) -> dict[str, tuple[str, ...]]:
    """Return the settings with a few allowed words: the task's, and the scheme."""
    kind = task_class(_env_id(choice))
    kinds = get_type_hints(kind)
    found = {
        f.name: get_args(kinds[f.name])
        for f in fields(kind)
        if get_origin(kinds[f.name]) is Literal
    }
    return {**found, "scheme": tuple(SCHEMES)}


def _env_id(choice: Choice) -> str:
    if choice.policy in (NO_POLICY, SCRIPT):
        return choice.env or DEFAULT_ENV
    return known_env_id(Policy.load(find_policy(choice.policy)).metadata, choice.env)


def _require_place(core: ContactEnv, fixture: Sequence[float] | None) -> None:
    """Raise if the fixture's place is unknown: the arm cannot move it."""
    if fixture is None and not core.places_fixture:
        raise ConfigError(
            "this arm cannot move the fixture: give its place with --fixture X Y Z "
            "YAW [m, rad], or add control=HOST:PORT for a simulated cabinet"
        )
