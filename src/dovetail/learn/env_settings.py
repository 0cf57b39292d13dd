"""What a training and an export say about the environment, written once."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

from dovetail.control.period import DEFAULT_PERIOD
from dovetail.control.period_option import Period
from dovetail.envs.config import F_SCALE, FORCE_DAMPING, USUAL
from dovetail.envs.registered import task_class
from dovetail.errors import ConfigError
from dovetail.tasks.options import TaskOptions, own_options, require_apart
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.tasks.task import Task
from dovetail.trackers.find import without_images

ENV_FIELDS = (
    *("plant", "task", "stack", "also", "recall", "period"),
    *("robot", "tracker"),
    *("f_scale", "f_scale_angular", "force_damping", "tare"),
    *("script", "correction"),
    *("near_speed", "near_press", "near_distance"),
    *("theta_range", "position_range", "max_steps", "scheme"),
)
"""Fields that are handed to the environment as they are."""


@dataclass(frozen=True, kw_only=True)
class EnvSettings:
    """The environment of a policy."""

    env: str = DEFAULT_ENV
    """Task: a Gymnasium id, or MODULE:ID of your own."""
    plant: str = USUAL.place.plant
    """Physics engine to train in: mujoco or bullet."""
    task_options: TaskOptions = field(default_factory=TaskOptions)
    """Fields of the task; left out, they are its own."""
    robot: str = USUAL.place.robot
    """Robot in the cell, or MODULE:FUNCTION of your own."""
    tracker: str = USUAL.observation.tracker
    """What tells where the fixture is: truth, late or a camera's file.
    With numbers: delayed?delay=0.1, late?bias=0.002. Of a camera.toml its delay, rate
    and error are taken, not its pictures; MODULE:CLASS is one of your own."""
    task: str | None = None
    """Mode of each axis, as "XYZ:force A:pose BC:hold"; free is a fourth mode. Default
    the environment's, for example "X:force A:pose YZBC:hold" for the rail clip."""
    stack: int = USUAL.observation.stack
    """Past (observation, action) pairs in the observation."""
    also: tuple[str, ...] = USUAL.observation.also
    """Columns the policy sees beside the task's: tilt, spin, wrench or force."""
    recall: tuple[int, ...] = USUAL.observation.recall
    """Steps ago of which the policy sees where the tool was. And the last action."""
    period: Period = DEFAULT_PERIOD
    """Control period: 1ms, 2ms, 2.5ms or 5ms. An action acts for 50 ms at any of them;
    an arm's address may give its own."""
    f_scale: tuple[float, ...] = (F_SCALE,)
    """f* at action 1 on X Y Z [m/s2]: one number, or three."""
    f_scale_angular: float = USUAL.action.f_scale_angular
    """f* at action 1 on A B C [rad/s2]."""
    force_damping: tuple[float, ...] = (FORCE_DAMPING,)
    """Damping D of force axes X Y Z [1/s], one number or three. f_scale / D is the top
    speed. The paper has 0, and nothing near contact: near_speed 0.25, near_press of
    f_scale, no tare."""
    script: str | None = USUAL.action.script
    """Script that acts, corrected by the policy's action: corner, or none.
    It is then part of the policy, which sees what the script would do next. A teacher's
    steps are the script's alone."""
    correction: float = USUAL.action.correction
    """How much of an action is added to what the script does [1]."""
    fall_back: float = USUAL.action.fall_back
    """Time after which the corner search takes over [s]; 0 is never.
    It does where the policy is used: a training is of the policy alone."""
    tare: bool = True
    """Measure before each episode the weight that gravity compensation misses. It is
    taken off what the policy commands: in training with `model`, `randomise_dynamics`
    or `arm`, as there is none in the nominal model; and wherever the policy is
    evaluated."""
    near_speed: float = USUAL.approach.near_speed
    """Speed limit of the tool there, per axis [m/s]."""
    near_press: float = USUAL.approach.near_press
    """Largest f* towards the fixture there [m/s2]. It is about a tenth of the newtons
    with which the tool can stand on the rim."""
    near_distance: float = USUAL.approach.near_distance
    """How far above the fixture's mouth contact is near [m]."""
    theta_range: float = USUAL.action.theta_range
    """Rotation at action 1 on pose axes A B C [rad]."""
    position_range: float = USUAL.action.position_range
    """Displacement at action 1 on pose axes X Y Z [m]."""
    max_steps: int = USUAL.episode.max_steps
    """Actions per episode."""
    scheme: str = USUAL.control.scheme
    """How the controller keeps its limits: qp or paper."""

    @cached_property
    def task_class(self) -> type[Task]:
        """The class of the environment's task.

        Raises:
            ConfigError: No such environment; lists the known ones. Or a field of the
                task is called as one of these settings is: a file has them in one.
        """
        task, names = task_class(self.env), [f.name for f in fields(self)]
        require_apart(task, names, f"settings of {type(self).__name__}")
        return task

    def require_used(self, name: str, is_used: object, needed: str) -> None:
        """Refuse a setting that is not the usual one and would be ignored."""
        (usual,) = (f.default for f in fields(self) if f.name == name)
        if not is_used and vars(self)[name] != usual:
            raise ConfigError(f"{name} is given, which needs {needed}")

    def env_options(self) -> dict[str, Any]:
        """Return the keyword arguments of the environment, as JSON knows them."""
        return self.given() | self.own()

    def policy_env(self) -> dict[str, Any]:
        """Return the settings with which the policy is used, as JSON knows them."""
        more = {"fall_back": self.fall_back} if self.fall_back else {}
        return self.env_options() | more

    def given(self) -> dict[str, Any]:
        """Return the settings of the environment that are given."""
        given = {name: vars(self)[name] for name in ENV_FIELDS} | self.task_options
        given["tracker"] = without_images(self.tracker)  # drawing takes 15 ms a step
        return {name: value for name, value in given.items() if value is not None}

    def own(self) -> dict[str, Any]:
        """Return what is not given and so is the task's own."""
        own = {**own_options(self.task_class), "task": self._usual_axes()}
        given = self.given()
        return {name: value for name, value in own.items() if name not in given}

    def _usual_axes(self) -> str:
        (axes,) = (f.default for f in fields(self.task_class) if f.name == "axes")
        return str(axes)
