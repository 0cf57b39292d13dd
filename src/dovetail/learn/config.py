"""Settings of a training run: one frozen dataclass, also the command line's options."""

import shlex
from dataclasses import replace
from functools import cache
from typing import Any, Self

from pydantic import model_validator

from dovetail.arms.address import parse_address
from dovetail.control.period import DEFAULT_PERIOD, require_period
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import split_settings
from dovetail.envs.tare import tared_axes
from dovetail.errors import ConfigError
from dovetail.evaluation.transfer import wilson_interval
from dovetail.learn.arm_config import ArmPlaceConfig, SimulatedDynamicsConfig
from dovetail.learn.learner_config import LearnerConfig
from dovetail.learn.policy_env_config import find_task
from dovetail.learn.run_config import LengthConfig, RunsConfig
from dovetail.learn.teaching_config import TeachingConfig
from dovetail.learn.variation import VariationConfig
from dovetail.options import option_words
from dovetail.plugins import is_robot_text
from dovetail.robots.find import find_robot, robot_label
from dovetail.search.script import SCRIPT_SETTINGS
from dovetail.settings import defaults_of, fill_in, names_in, settings, values_of
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.options import require_types
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.trackers.find import require_tracker

NOT_COMPARED = ("out", "resume", "threads")
"""Settings that are a sitting's, not the run's."""


@settings()
class TrainConfig(
    LengthConfig,
    RunsConfig,
    VariationConfig,
    ArmPlaceConfig,
    SimulatedDynamicsConfig,
    TeachingConfig,
    LearnerConfig,
):
    """Settings of one training run, or of several seeds of it.

    A setting has the same name here, on the command line and in a run's config.toml.
    """

    @model_validator(mode="after")
    def _check_train_config(self) -> Self:
        """Refuse what cannot be trained, by name and range."""
        find_task(self.env, type(self))
        self._fill_in()
        fill_in(self, period=require_period(self.period, "period"))
        split_settings(self.task_class, self.given())
        require_types(self.task_options, self.task_class)
        fill_in(self, task_options=self.task_class.whole(self.task_options))
        find_robot(self.robot)
        require_tracker(self.tracker)
        if self.fixture is not None and not self.fixed_goal:
            raise ConfigError("fixture is given, which needs --fixed-goal")
        if self.from_policy is not None and self.algorithm == "crossq":
            raise ConfigError(
                "crossq cannot start from a policy: its actor normalises by the batch "
                "while it trains; known: sac, tqc, td3, ddpg, ppo"
            )
        if self.arm is not None:
            self._require_arm(self.arm)
        if (place := self.fixed_place) is not None:
            fill_in(self, fixture=place.numbers)
        self._require_test()
        self._require_batch()
        self._require_dynamics()
        self._require_new()
        self._require_teacher()
        self.require_possible(self.num_envs)
        if self.tare:  # a policy must not ask for what it cannot be given
            task = TaskSpec.parse(self.env_options()["task"])
            tared_axes(task, self.force_damping)
        return self

    def _fill_in(self) -> None:
        """Choose what is not given."""
        if self.arm is not None:
            fill_in(self, num_envs=1)
        given, usual = values_of(self), self._usual()
        fill_in(self, **{name: usual[name] for name in usual if given[name] is None})

    def _usual(self) -> dict[str, float]:
        """Return what depends on other settings."""
        is_arm = self.arm is not None
        is_new = self.from_policy is None
        is_quick = self.algorithm == "sac" and not is_arm and is_new
        first = 2000 if self.demos and is_new else 0
        asked = first if self.pretrain is None else self.pretrain
        return {
            "pretrain": first,
            "until": 1.0 if is_arm else 0.98,
            "updates_per_step": 2.0 if is_arm or self.algorithm == "gps" else 0.5,
            "learning_rate": 2e-3 if is_quick else 1e-3,
            "teacher_share": 0.2 if asked else 0.5,
        }

    def _require_test(self) -> None:
        """Refuse a test that nothing could pass, or for which there is no arm."""
        until, count = self.asked_success, self.test_episodes
        arm = self.arm
        most = wilson_interval(count, count)[0]
        if most < until < 1.0:
            raise ConfigError(
                f"until is {until:g}, but {count} episodes of {count} show only "
                f"{most:.4f}: raise --test-episodes, or give --until 1 for all steps"
            )
        if until < 1.0 and arm is not None and not parse_address(arm).is_here:
            raise ConfigError(
                f"until is {until:g}, but there is one arm at {arm}, and a test "
                "would break into its episodes: leave until out, or give 1"
            )

    def _require_batch(self) -> None:
        """Refuse threads that would do nothing."""
        if self.threads > 1 and not self._is_here_in_mujoco:
            where = self.arm or self.plant
            raise ConfigError(
                f"threads is {self.threads}, but only MuJoCo in this process "
                f"simulates several environments at once, not {where}: leave "
                "threads out, or give --plant mujoco"
            )

    def _require_new(self) -> None:
        """Refuse a start with which gps does nothing."""
        starts = {
            "from_policy": self.from_policy,
            "demos": self.demos,
            "teacher": self.teacher != "none",
            "script": self.script,
            "informed": self.informed,
        }
        given = [name for name, value in starts.items() if value]
        if self.algorithm == "gps" and given:
            raise ConfigError(
                f"algorithm is gps, which learns from its own rollouts alone: leave "
                f"{' and '.join(given)} out, or give --algorithm sac"
            )

    def _require_teacher(self) -> None:
        """Refuse a teacher that would not act, and demonstrations without a buffer."""
        algorithm = self.algorithm
        logs, script = self.logs, self.script
        if self.informed and (algorithm != "sac" or logs):
            raise ConfigError(
                "informed critics are told the truth, which no log has and only sac "
                "takes: leave --informed out, or give no --demos and --algorithm sac"
            )
        if script is not None and (logs or algorithm == "ppo"):
            raise ConfigError(
                f"with --script {script} an action is a correction, which no log "
                "has, and which ppo does not begin small: leave --demos out, give "
                "--teacher corner or none, and one of sac, tqc, crossq, td3 and ddpg"
            )
        self._require_used("approach", self.arm is not None, "--arm")
        self._require_used("correction", script is not None, "--script corner")
        axes = SCRIPT_SETTINGS["task"]
        can_tilt = self.env_options()["task"] == axes
        self._require_used("fall_back", can_tilt, f"--task '{axes}'")
        self._require_used("teacher_noise", self.has_teacher, "--teacher corner")
        is_shown = self.has_teacher or logs
        if not is_shown and self.teacher_share != self._usual()["teacher_share"]:
            raise ConfigError("teacher_share is given: it needs a teacher or --demos")
        on_policy = algorithm == "ppo" and is_shown
        if on_policy or (self.has_teacher and self.from_policy):
            raise ConfigError(
                "a teacher and demonstrations fill a replay buffer before anything is "
                "learned: that is for sac, tqc, crossq, td3 and ddpg, a teacher's from "
                "the start; give --teacher none, and with ppo no --demos"
            )
        if self.pretrain and (not logs or self.from_policy):
            raise ConfigError(
                f"pretrain is {self.pretrain}, which needs demonstrations and an "
                "actor that is new: give --demos LOGS and no --from-policy, or leave "
                "pretrain out"
            )

    def _require_used(self, name: str, is_used: bool, needed: str) -> None:
        """Refuse a setting that is not the usual one and would be ignored."""
        if not is_used and vars(self)[name] != _usual_of(name):
            raise ConfigError(f"{name} is given, which needs {needed}")

    def _require_dynamics(self) -> None:
        """Read the model, and refuse dynamics that nothing would simulate."""
        for name in ("model", "randomise_dynamics"):
            if self.arm is not None and vars(self)[name]:
                raise ConfigError(
                    f"arm and {name} exclude each other: the arm at {self.arm} "
                    "has its own dynamics; give --plant in place of --arm"
                )
        _ = self.model_file

    @property
    def _is_here_in_mujoco(self) -> bool:
        plant = self.plant
        return self.arm is None and plant == "mujoco"

    @property
    def is_batch(self) -> bool:
        """True if the environments are stepped at the same time."""
        has_threads = self.threads != 1 and self.num_envs > 1
        return has_threads and self._is_here_in_mujoco

    @property
    def gradient_steps(self) -> int:
        """Gradient steps after a step of all environments."""
        ratio = self.updates_per_step or 0.0
        return max(1, round(self.num_envs * ratio))

    def _require_arm(self, text: str) -> None:
        """Refuse what the one arm cannot do."""
        arm = parse_address(text)
        period = self.period
        asked = None if period == DEFAULT_PERIOD else period
        fill_in(self, period=arm.control_period(asked, DEFAULT_PERIOD))
        if self.seeds > 1 and not arm.is_here:
            raise ConfigError(
                f"seeds is {self.seeds}, but there is one arm at {text}; train "
                "one seed after the other, each with its own --out"
            )
        weight = self.force_weight
        if weight > 0.0 and not arm.measures_contact:
            raise ConfigError(
                f"force_weight is {weight:g}, but FRI does not measure "
                "contact force; needs 0"
            )
        if not arm.places_fixture and self.fixture is None:
            raise ConfigError(
                f"the arm at {text} cannot move the fixture: add --fixed-goal and say "
                "where it is with --fixture X Y Z YAW [m, rad]"
            )

    @property
    def fixed_place(self) -> FixturePose | None:
        """Fixed place of the fixture; None where each episode draws it."""
        if not self.fixed_goal:
            return None
        task, robot = self.made_task(), find_robot(self.robot)
        usual = task.trial_poses_in(task.workcell(robot, self.cell))[0]
        return FixturePose.given(self.fixture or usual.numbers, usual.facing)

    def for_seed(self, seed: int) -> Self:
        """Return the run of one of several seeds, in its own sub-folder."""
        return replace(self, seed=seed, seeds=1, out=self.folder / f"seed-{seed}")

    def to_json(self) -> dict[str, Any]:
        """Return every setting that decides the result, as JSON knows it.

        A model and a cell are given by their tables: the same content in another file
        is the same.
        """
        values = {name: vars(self)[name] for name in names_in(TrainConfig)}
        values |= values.pop("task_options") | self.own()
        if self.arm is not None:
            values["arm"] = parse_address(self.arm).text  # without its token
        if self.model_file is not None:
            values["model"] = self.model_file.table()
        if self.cell is not None:
            values["cell"] = self.cell.table()
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
            if name not in NOT_COMPARED
        }

    def require_same(self, other: "TrainConfig") -> None:
        """Refuse to continue a run that was started with other settings.

        Args:
            other: The run's own settings.

        Raises:
            ConfigError: Names the setting and both values.
        """
        mine, theirs = _flat(self.to_json()), _flat(other.to_json())
        for name in {**mine, **theirs}:
            if mine.get(name) != theirs.get(name):
                raise ConfigError(
                    f"cannot resume {self.out}: {name} is {_short(mine.get(name))}, "
                    f"the run was started with {_short(theirs.get(name))}; give {name} "
                    "the run's value or choose another --out",
                    name=name,
                )

    def command(self) -> str:
        """Return the command line that trains with these settings."""
        default = TrainConfig(env=self.env).to_json() | self._usual()
        default["env"] = DEFAULT_ENV
        words = ["dovetail", "train"]
        for name, value in self.to_json().items():
            if value == default[name]:
                continue
            files = {"model": self.model, "cell": self.cell and self.cell.file}
            words += option_words(name, str(files[name]) if name in files else value)
        return shlex.join(words)


@cache
def _usual_of(name: str) -> Any:
    return defaults_of(TrainConfig)[name]


def _flat(settings: dict[str, Any]) -> dict[str, Any]:
    """Return settings with a file's entries beside the others, as model.KEY."""
    files = ("model", "cell")
    flat = {name: value for name, value in settings.items() if name not in files}
    for file in files:
        entries = settings[file] or {}
        flat |= {f"{file}.{key}": value for key, value in entries.items()}
    return flat


def _short(value: Any) -> str:
    if isinstance(value, str) and is_robot_text(value):
        return f"{robot_label(value)}, read from a file"
    text = repr(value)
    return text if len(text) < 80 else f"{text[:77]}..."
