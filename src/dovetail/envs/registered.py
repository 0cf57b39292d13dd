"""Environments that have a name: a task and a few short settings.

``gym.make("dovetail/GearMesh-v0", clearance=0.0003, twin="medium")``. A task outside
the package is registered by its own module with `register_task` and named
``my_module:MyTask-v0``.
"""

import copy
import importlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import gymnasium

from dovetail.arms.arm import Arm
from dovetail.envs.batch_vector_env import BatchVectorEnv
from dovetail.envs.config import ENDLESS, USUAL, EnvConfig
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.contract import build_task, require_class
from dovetail.errors import ConfigError, did_you_mean
from dovetail.plugins import import_names
from dovetail.robots.find import DEFAULT_ROBOT, find_robot
from dovetail.search.corrected_env import CorrectedEnv
from dovetail.search.fall_back_env import FallBackEnv
from dovetail.settings import names_in
from dovetail.tasks.shipped import DEFAULT_ENV, EPISODE_STEPS
from dovetail.tasks.task import Task
from dovetail.trackers.tracker import Tracker
from dovetail.workcell.cell_config import CellConfig
from dovetail.workcell.workcell import Workcell

_OF_TASK = frozenset(names_in(EnvConfig)) - {"max_steps"}
"""Settings of an environment that a task may need otherwise than usual; Gymnasium
counts the steps."""
_MAKE = "dovetail.envs.registered:make_untimed"
_MAKE_TIMED = "dovetail.envs.registered:make_env"
_MAKE_BATCH = "dovetail.envs.registered:make_batch"


class UnknownSettingError(ConfigError, TypeError):
    """A setting that neither the task nor its environment takes."""


def register_task(env_id: str, task: type[Task] | str) -> None:
    """Give a task a name for `gym.make` and for every command's `--env`.

    Args:
        env_id: Gymnasium id, such as ``MyTask-v0``.
        task: The task's class, or ``module:Class``.

    Raises:
        TaskError: The class lacks a part of the contract.
    """
    if isinstance(task, type):
        require_class(task)
    if env_id not in gymnasium.registry:
        gymnasium.register(
            env_id,
            entry_point=_MAKE,
            vector_entry_point=_MAKE_BATCH,
            max_episode_steps=EPISODE_STEPS,
            kwargs={"task_class": task},
        )


def make(env_id: str, **settings: Any) -> gymnasium.Env:
    """Make an environment as `gym.make` does, its length the setting `max_steps`.

    Args:
        env_id: Gymnasium id; ``module:Id`` imports the module first.
        **settings: See `make_env`.

    Raises:
        ConfigError: See `make_env`; or no task has this name.
    """
    task_class(env_id)
    spec = copy.deepcopy(gymnasium.spec(env_id.rpartition(":")[2]))
    spec.entry_point, spec.max_episode_steps = _MAKE_TIMED, None
    return gymnasium.make(spec, disable_env_checker=True, **settings)


def make_untimed(
    task_class: type[Task] | str,
    config: EnvConfig | None = None,
    max_steps: int | None = None,
    **settings: Any,
) -> ContactEnv:
    """Build the environment of a task for `gym.make`, which ends its episodes.

    Args:
        task_class: The task's class, or ``module:Class``.
        config: Settings to begin with; None is the usual ones.
        max_steps: Must be left out: Gymnasium's word is `max_episode_steps`.
        **settings: See `make_env`.

    Raises:
        ConfigError: See `make_env`; or a `max_steps`.
    """
    base = config or _usual(_class(task_class))
    _require_untimed(max_steps, base)
    whole = replace(base, max_steps=ENDLESS)
    return make_env(task_class, config=whole, **settings)


def _require_untimed(max_steps: int | None, config: EnvConfig | None) -> None:
    """Refuse a length of episodes that Gymnasium would not know."""
    given = (config or USUAL).max_steps if max_steps is None else max_steps
    if max_steps is not None or given != EPISODE_STEPS:
        raise ConfigError(
            f"max_steps is {given}, which gymnasium.make calls max_episode_steps: give "
            f"max_episode_steps={given} in its place"
        )


def make_env(
    task_class: type[Task] | str,
    arm: Arm | str | None = None,
    config: EnvConfig | None = None,
    tracker: Tracker | str | None = None,
    render_mode: str | None = None,
    **settings: Any,
) -> ContactEnv:
    """Build the environment of a task.

    Args:
        task_class: The task's class, or ``module:Class``.
        arm: The arm to use, or its address; None is the settings'.
        config: Settings to begin with; None is the usual ones.
        tracker: Where the fixture is, or its name; None is the settings'.
        render_mode: None, or "rgb_array" for pictures of a simulation here; `gym.make`
            makes "human" and "rgb_array_list" of it.
        **settings: Fields of the task, and of `EnvConfig`; ``task`` is
            the mode of each axis.

    Raises:
        ConfigError: An unknown setting, or a value out of range.
    """
    kind = _class(task_class)
    own, rest = split_settings(kind, settings)
    base = config or _usual(kind)
    if isinstance(tracker, str):
        base, tracker = replace(base, tracker=tracker), None
    whole = replace(base, **rest)
    return _kind(whole)(
        build_task(kind, own), arm, whole, tracker=tracker, render_mode=render_mode
    )


def _usual(task: type[Task]) -> EnvConfig:
    """Return the usual settings of a task's environment."""
    return EnvConfig(**{n: v for n, v in task.training.items() if n in _OF_TASK})


def _kind(config: EnvConfig) -> type[ContactEnv]:
    """Return the class of the environment whose actions mean what a config says."""
    if config.script is not None:
        return CorrectedEnv
    return FallBackEnv if config.fall_back else ContactEnv


vars(make_env)["metadata"] = ContactEnv.metadata
vars(make_untimed)["metadata"] = ContactEnv.metadata
# By it `gym.make` knows how to make "human" and "rgb_array_list" of "rgb_array".


def make_batch(
    task_class: type[Task] | str,
    num_envs: int,
    threads: int | None = None,
    max_episode_steps: int | None = None,
    **settings: Any,
) -> BatchVectorEnv:
    """Build many environments of a task that are stepped at once.

    Args:
        task_class: The task's class, or ``module:Class``.
        num_envs: How many, at least 1.
        threads: That simulate; None is one for each core that this process may use.
        max_episode_steps: What `gym.make_vec` calls `max_steps`.
        **settings: See `make_env`; an arm is given by its address, a tracker by its
            name.

    Raises:
        ConfigError: See `make_env`; or these settings do not lead to MuJoCo in this
            process.
    """
    if num_envs < 1:
        raise ConfigError(f"num_envs is {num_envs}; allowed: 1 and more")
    if max_episode_steps is not None:
        _require_untimed(settings.get("max_steps"), settings.get("config"))
        settings["max_steps"] = max_episode_steps
    for name in ("arm", "tracker"):
        if not isinstance(settings.get(name), str | None):
            raise ConfigError(
                f"{name} is an object, which {num_envs} environments would share; give "
                "its address or name, or a BatchVectorEnv one function per environment"
            )
    return BatchVectorEnv(
        [partial(make_env, task_class, **settings)] * num_envs, threads
    )


def split_settings(
    task: type[Task], settings: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what a task takes of these settings, and what the environment takes.

    Raises:
        UnknownSettingError: Something that neither takes; lists what both do.
    """
    given = {("axes" if k == "task" else k): v for k, v in settings.items()}
    known = {f.name for f in fields(task) if f.init}
    if unknown := sorted(set(given) - known - set(names_in(EnvConfig))):
        raise UnknownSettingError(_unknown(task, unknown, sorted(known)))
    # None is what a caller says who has nothing to say.
    own = {k: v for k, v in given.items() if k in known and v is not None}
    return own, {k: v for k, v in given.items() if k not in known}


def _unknown(task: type[Task], unknown: Sequence[str], known: Sequence[str]) -> str:
    """Word a refusal as Python does: TorchRL knows one of `frameskip` by that alone."""
    usual = names_in(EnvConfig)
    first, *others = (f"{n!r}{did_you_mean(n, [*known, *usual])}" for n in unknown)
    return (
        f"{task.__name__} got an unexpected keyword argument {first}"
        f"{''.join(f', and {other}' for other in others)}; known: {', '.join(known)}; "
        f"of its environment: {', '.join(usual)} (max_steps is gym.make's "
        "max_episode_steps)"
    )


def task_class(env_id: str) -> type[Task]:
    """Return the class of the task behind a name.

    ``module:Id`` imports the module first, which registers the id.

    Raises:
        ConfigError: No task has this name; lists those that do.
    """
    module, _, name = env_id.rpartition(":")
    if module:
        _import(module, env_id)
    spec = gymnasium.registry.get(name)
    found = spec.kwargs.get("task_class") if spec else None
    if found is None:
        known = [n for n, s in gymnasium.registry.items() if "task_class" in s.kwargs]
        raise ConfigError(
            f"environment {env_id!r} is unknown{did_you_mean(env_id, known)}; known: "
            f"{', '.join(known)}; or give MODULE:ID of your own, see "
            "docs/your-own-task.md"
        )
    return _class(found)


def find_cell(
    env_id: str = DEFAULT_ENV,
    robot: str = DEFAULT_ROBOT,
    cell: CellConfig | None = None,
    **settings: Any,
) -> Workcell:
    """Return the workcell of a task.

    Args:
        env_id: Its name.
        robot: The robot in it, see `robots.find`.
        cell: Facts of a cell file, in the place of the task's own.
        **settings: Fields of the task; None is its own.

    Raises:
        ConfigError: An unknown name or setting, or a value out of range.
    """
    return make_task(env_id, settings).workcell(find_robot(robot), cell)


def make_task(env_id: str, settings: Mapping[str, Any]) -> Task:
    """Build the task behind a name.

    Args:
        env_id: Its name.
        settings: Fields of the task; None is its own.

    Raises:
        ConfigError: An unknown name or setting, or a value out of range.
    """
    kind = task_class(env_id)
    given = {name: value for name, value in settings.items() if value is not None}
    own, _ = split_settings(kind, given)
    return build_task(kind, own)


def task_of_file(env_id: str, settings: Mapping[str, Any]) -> Task:
    """Build the task that a log or a recording describes: it names no other file.

    Raises:
        ConfigError: See `make_task`; or a setting is the path of a file.
    """
    return make_task(env_id, task_class(env_id).whole(settings, may_read=False))


def _import(module: str, env_id: str) -> None:
    """Import a stranger's module, which registers its tasks."""
    try:
        import_names(module)
    except ImportError as error:
        raise ConfigError(
            f"environment {env_id!r}: Python finds no module {module!r} ({error}); "
            "start where its file lies, or set PYTHONPATH"
        ) from error


def _class(task: type[Task] | str) -> type[Task]:
    return require_class(task if isinstance(task, type) else _named(task))


def _named(text: str) -> type:
    """Return a class from ``module:Class``."""
    module, _, name = text.partition(":")
    return vars(importlib.import_module(module))[name]
