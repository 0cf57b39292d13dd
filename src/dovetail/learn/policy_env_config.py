"""Settings of a policy's environment, for a training and an export."""

from dataclasses import field
from functools import cached_property
from typing import Any

from dovetail.control.proven import DECLARED
from dovetail.envs.config import EnvOptions
from dovetail.envs.contract import build_task
from dovetail.envs.registered import task_class
from dovetail.settings import names_in, settings
from dovetail.tasks.options import own_options, require_apart
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.tasks.task import Task
from dovetail.trackers.find import without_images


@settings()
class PolicyEnvConfig(EnvOptions):
    """The task and its environment, as a policy has to know them."""

    env: str = DEFAULT_ENV
    """Task: a Gymnasium id, or MODULE:ID of your own; --part FILE has its own task."""
    task_options: dict[str, Any] = field(default_factory=dict)
    """Fields of the task; left out, they are its own."""
    task: str | None = None
    """Mode of each axis, as "XYZ:force A:pose BC:hold"; free is a fourth mode. Default
    the environment's, for example "XY:force A:pose ZBC:hold" for the rail clip."""

    @cached_property
    def task_class(self) -> type[Task]:
        """The class of the environment's task.

        Raises:
            ConfigError: See `find_task`.
        """
        return find_task(self.env, type(self))

    def env_options(self) -> dict[str, Any]:
        """Return the keyword arguments of the environment, as JSON knows them."""
        return self.given() | self.own()

    def policy_env(self) -> dict[str, Any]:
        """Return the settings with which the policy is used, as JSON knows them.

        What is declared is of the arm that it was trained on, not of the next one.
        """
        options, fall_back = self.env_options(), self.fall_back
        used = {k: v for k, v in options.items() if k not in DECLARED}
        return used | ({"fall_back": fall_back} if fall_back else {})

    def given(self) -> dict[str, Any]:
        """Return the settings of the environment that are given."""
        tracker = without_images(self.tracker)  # 15 ms a step
        given = {name: vars(self)[name] for name in names_in(EnvOptions)}
        given |= {"tracker": tracker, "task": self.task}
        given |= self.task_options
        given["cell"] = None if self.cell is None else self.cell.table()
        del given["fall_back"]  # a training is of the policy alone
        return {name: value for name, value in given.items() if value is not None}

    def own(self) -> dict[str, Any]:
        """Return what is not given and so is the task's own."""
        given = self.given()
        axes = given.get("task") or self.made_task().axes
        own = {**own_options(self.task_class), "task": axes}
        return {name: value for name, value in own.items() if name not in given}

    def made_task(self) -> Task:
        """Return the task with its options; some of them decide what others are."""
        return build_task(self.task_class, self.task_options)


def find_task(env: str, beside: type) -> type[Task]:
    """Return the class of an environment's task.

    Args:
        env: Its name.
        beside: Settings that a file has together with the task's fields.

    Raises:
        ConfigError: No such environment; lists the known ones. Or a field of the task
            is called as one of these settings is.
    """
    task = task_class(env)
    require_apart(task, names_in(beside), f"settings of {beside.__name__}")
    return task
