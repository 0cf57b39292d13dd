"""Settings of a training run: one frozen dataclass, also the command line's options."""

import shlex
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

from dovetail.arms.address import parse_address
from dovetail.control.period import DEFAULT_PERIOD, require_period
from dovetail.control.sections import Sectioned, option_words, settings_in
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import split_settings
from dovetail.envs.tare import tared_axes
from dovetail.errors import ConfigError
from dovetail.evaluation.transfer import wilson_interval
from dovetail.learn.env_settings import EnvSettings, find_task
from dovetail.learn.learner_settings import LearnerConfig
from dovetail.learn.place_settings import ArmPlaceConfig, SimulatedDynamicsConfig
from dovetail.learn.run_settings import LengthConfig, RunsConfig
from dovetail.learn.searching import SEARCHING
from dovetail.learn.teaching_settings import TeachingConfig
from dovetail.learn.variation import VariationConfig
from dovetail.robots.find import find_robot
from dovetail.search.script import SCRIPT_SETTINGS
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.trackers.find import require_tracker

NOT_COMPARED = ("out", "resume", "threads")
"""Settings that are a sitting's, not the run's."""
_OPTIONS = {"from_policy": "from"}


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Sectioned):
    """Settings of one training run, or of several seeds of it.

    `TrainConfig.of(steps=20_000, num_envs=4)` takes them by the names of the command
    line's options; a run's config.json has the same.
    """

    whose: ClassVar[str] = "a training"

    length: LengthConfig = field(default_factory=LengthConfig)
    """How long it learns."""
    runs: RunsConfig = field(default_factory=RunsConfig)
    """The runs and their folder."""
    environment: EnvSettings = field(default_factory=EnvSettings)
    """The task and its environment."""
    place: ArmPlaceConfig = field(default_factory=ArmPlaceConfig)
    """The arm, where it is none that is simulated for it alone."""
    dynamics: SimulatedDynamicsConfig = field(default_factory=SimulatedDynamicsConfig)
    """Dynamics of the simulation."""
    variation: VariationConfig = field(default_factory=VariationConfig)
    """What differs between episodes, and the policy is not told."""
    teaching: TeachingConfig = field(default_factory=TeachingConfig)
    """What it is shown before it learns by itself."""
    learner: LearnerConfig = field(default_factory=LearnerConfig)
    """How it learns from what was done."""

    def __post_init__(self) -> None:
        """Refuse what cannot be trained, by name and range."""
        find_task(self.environment.env, type(self))
        self._fill_in()
        period = self.environment.config.control.period
        self._settle(period=require_period(period, "period"))
        env, config = self.environment, self.environment.config
        split_settings(env.task_class, env.given())
        find_robot(config.place.robot)
        require_tracker(config.observation.tracker)
        if self.place.fixture is not None and not self.place.fixed_goal:
            raise ConfigError("fixture is given, which needs --fixed-goal")
        if self.teaching.from_policy is not None and self.learner.algorithm == "crossq":
            raise ConfigError(
                "crossq cannot start from a policy: its actor normalises by the batch "
                "while it trains; known: sac, tqc, td3, ddpg, ppo"
            )
        if self.place.arm is not None:
            self._require_arm(self.place.arm)
        if (place := self.fixed_place) is not None:
            self._settle(fixture=place[1:5])
        self._require_test()
        self._require_batch()
        self._require_dynamics()
        self._require_teacher()
        self.variation.require_possible(self.environment, self.runs.num_envs)
        if config.episode.tare:  # a policy must not ask for what it cannot be given
            task = TaskSpec.parse(env.env_options()["task"])
            tared_axes(task, config.action.force_damping)

    def _fill_in(self) -> None:
        """Choose what is not given."""
        if self.place.arm is not None:
            self._settle(num_envs=1)
        given, usual = self.flat(), self._usual()
        self._settle(**{name: usual[name] for name in usual if given[name] is None})

    def _usual(self) -> dict[str, float]:
        """Return what depends on other settings."""
        is_arm, teaching = self.place.arm is not None, self.teaching
        is_new = teaching.from_policy is None
        is_quick = self.learner.algorithm == "sac" and not is_arm and is_new
        first = 2000 if teaching.demos and is_new else 0
        asked = first if teaching.pretrain is None else teaching.pretrain
        return {
            "pretrain": first,
            "until": 1.0 if is_arm else 0.98,
            "updates_per_step": 2.0 if is_arm else 0.5,
            "learning_rate": 2e-3 if is_quick else 1e-3,
            "teacher_share": 0.2 if asked else 0.5,
        }

    def _require_test(self) -> None:
        """Refuse a test that nothing could pass, or for which there is no arm."""
        until, count = self.length.asked_success, self.length.test_episodes
        arm = self.place.arm
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
        if self.runs.threads > 1 and not self._is_here_in_mujoco:
            where = self.place.arm or self.environment.config.place.plant
            raise ConfigError(
                f"threads is {self.runs.threads}, but only MuJoCo in this process "
                f"simulates several environments at once, not {where}: leave "
                "threads out, or give --plant mujoco"
            )

    def _require_teacher(self) -> None:
        """Refuse a teacher that would not act, and demonstrations without a buffer."""
        teaching, algorithm = self.teaching, self.learner.algorithm
        logs, script = teaching.logs, self.environment.config.action.script
        if self.variation.informed and (algorithm != "sac" or logs):
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
        self._require_used("approach", self.place.arm is not None, "--arm")
        self._require_used("correction", script is not None, "--script corner")
        axes = SCRIPT_SETTINGS["task"]
        can_tilt = self.environment.env_options()["task"] == axes
        self._require_used("fall_back", can_tilt, f"--task '{axes}'")
        self._require_used("teacher_noise", teaching.has_teacher, "--teacher corner")
        is_shown = teaching.has_teacher or logs
        if not is_shown and teaching.teacher_share != self._usual()["teacher_share"]:
            raise ConfigError("teacher_share is given: it needs a teacher or --demos")
        on_policy = algorithm == "ppo" and is_shown
        if on_policy or (teaching.has_teacher and teaching.from_policy):
            raise ConfigError(
                "a teacher and demonstrations fill a replay buffer before anything is "
                "learned: that is for sac, tqc, crossq, td3 and ddpg, a teacher's from "
                "the start; give --teacher none, and with ppo no --demos"
            )
        if teaching.pretrain and (not logs or teaching.from_policy):
            raise ConfigError(
                f"pretrain is {teaching.pretrain}, which needs demonstrations and an "
                "actor that is new: give --demos LOGS and no --from, or leave it out"
            )

    def _require_used(self, name: str, is_used: bool, needed: str) -> None:
        """Refuse a setting that is not the usual one and would be ignored."""
        usual = settings_in(TrainConfig)[name].default
        if not is_used and self.flat()[name] != usual:
            raise ConfigError(f"{name} is given, which needs {needed}")

    def _require_dynamics(self) -> None:
        """Read the model, and refuse dynamics that nothing would simulate."""
        for name in ("model", "randomise_dynamics"):
            if self.place.arm is not None and vars(self.dynamics)[name]:
                raise ConfigError(
                    f"arm and {name} exclude each other: the arm at {self.place.arm} "
                    "has its own dynamics; give --plant in place of --arm"
                )
        _ = self.dynamics.model_file

    @property
    def _is_here_in_mujoco(self) -> bool:
        plant = self.environment.config.place.plant
        return self.place.arm is None and plant == "mujoco"

    @property
    def is_batch(self) -> bool:
        """Whether the environments are stepped at the same time."""
        has_threads = self.runs.threads != 1 and self.runs.num_envs > 1
        return has_threads and self._is_here_in_mujoco

    @property
    def gradient_steps(self) -> int:
        """Gradient steps after a step of all environments."""
        ratio = self.learner.gradient.updates_per_step or 0.0
        return max(1, round(self.runs.num_envs * ratio))

    def _require_arm(self, text: str) -> None:
        """Refuse what the one arm cannot do."""
        arm = parse_address(text)
        period = self.environment.config.control.period
        asked = None if period == DEFAULT_PERIOD else period
        self._settle(period=arm.control_period(asked, DEFAULT_PERIOD))
        if self.runs.seeds > 1 and not arm.is_here:
            raise ConfigError(
                f"seeds is {self.runs.seeds}, but there is one arm at {text}; train "
                "one seed after the other, each with its own --out"
            )
        weight = self.learner.returns.force_weight
        if weight > 0.0 and not arm.measures_contact:
            raise ConfigError(
                f"force_weight is {weight:g}, but FRI does not measure "
                "contact force; needs 0"
            )
        if not arm.places_fixture and self.place.fixture is None:
            raise ConfigError(
                f"the arm at {text} cannot move the fixture: add --fixed-goal and say "
                "where it is with --fixture X Y Z YAW [m, rad]"
            )

    @property
    def fixed_place(self) -> FixturePose | None:
        """Where the fixture stays; None where each episode draws it."""
        if not self.place.fixed_goal:
            return None
        usual = self.environment.task_class.trial_poses[0]
        return FixturePose.given(self.place.fixture or usual[1:5], usual.facing)

    def for_seed(self, seed: int) -> Self:
        """Return the run of one of several seeds, in its own sub-folder."""
        return self.having(seed=seed, seeds=1, out=self.runs.folder / f"seed-{seed}")

    def to_json(self) -> dict[str, Any]:
        """Return every setting that decides the result, as JSON knows it.

        A model is given by its table: the same content in another file is the same.
        """
        values = self.flat()
        values |= values.pop("task_options") | self.environment.own()
        if self.place.arm is not None:
            values["arm"] = parse_address(self.place.arm).text  # without its token
        if self.dynamics.model_file is not None:
            values["model"] = self.dynamics.model_file.table()
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
            if name not in NOT_COMPARED
        }

    def require_same(self, other: dict[str, Any]) -> None:
        """Refuse to continue a run that was started with other settings.

        Args:
            other: `to_json` of the run's own settings.

        Raises:
            ConfigError: Names the field and both values.
        """
        mine = _flat(self.to_json())
        usual = TrainConfig.of(env=self.environment.env).to_json()
        other = _flat(usual) | _flat(other)  # from before an option
        if not other["fixed_goal"]:
            other["fixture"] = None  # older versions write a place all the same
        for name in {**mine, **other}:
            if mine.get(name) != other.get(name):
                raise ConfigError(
                    f"cannot resume {self.runs.out}: {name} is {mine.get(name)!r}, "
                    f"the run was started with {other.get(name)!r}; give {name} the "
                    "run's value or choose another --out"
                )

    def command(self) -> str:
        """Return the command line that trains with these settings."""
        searching = SEARCHING if self.variation.doubt > 0.0 else {}
        default = TrainConfig.of(env=self.environment.env, **searching).to_json()
        default |= {k: v for k, v in self._usual().items() if k not in searching}
        default["env"] = DEFAULT_ENV
        words = ["dovetail", "train"]
        for name, value in self.to_json().items():
            if value == default[name]:
                continue
            given = str(self.dynamics.model) if name == "model" else value
            words += option_words(_OPTIONS.get(name, name), given)
        return shlex.join(words)


def _flat(settings: dict[str, Any]) -> dict[str, Any]:
    """Return settings with a table's entries beside the others, as model.KEY."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        if isinstance(value, dict):
            flat |= {f"{name}.{key}": entry for key, entry in value.items()}
        elif name != "model":
            flat[name] = value
    return flat
