"""Settings of a training run: one frozen dataclass, also the command line's options."""

import shlex
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import tyro

from dovetail.arms.address import parse_address
from dovetail.control.period import format_period, require_period
from dovetail.control.ranges import Range, check_ranges
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.dynamics_randomisation import DynamicsRandomisation
from dovetail.envs.registered import split_settings
from dovetail.envs.tare import tared_axes
from dovetail.errors import ConfigError
from dovetail.evaluate.transfer import wilson_interval
from dovetail.learn.learner_settings import LearnerSettings
from dovetail.learn.model_file import ModelFile
from dovetail.learn.searching import SEARCHING
from dovetail.learn.variation import Variation
from dovetail.paths_option import some_paths
from dovetail.robots.find import find_robot
from dovetail.search.script import SCRIPT_SETTINGS
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.trackers.find import require_tracker

_NOT_COMPARED = ("out", "resume", "threads")
_OPTIONS = {"from_policy": "from"}
_USUAL = DynamicsRandomisation()


@dataclass(frozen=True, kw_only=True)
class TrainConfig(LearnerSettings, Variation):
    """Settings of one training run, or of several seeds of it."""

    out: Path | None = None
    """Run folder, new or empty unless it is resumed; default a new one in runs. That is
    named by part or environment and the time."""
    resume: bool = False
    """Continue the run in `out` from its newest checkpoint, with its settings. On the
    command line no other option is needed."""
    model: Path | None = None
    """Model of the arm to simulate, a file of `dovetail identify fit`. Any twin file is
    one: the engine takes its dynamics and delay. Without it the nominal model."""
    randomise_dynamics: bool = False
    """Draw the dynamics anew in every episode, as the next four say. They are gravity,
    link masses, joint damping and surface friction, about the model's."""
    random_gravity: float = _USUAL.gravity
    """Half range of gravity's residual on each of x y z [m/s2], uniform."""
    random_mass: tuple[float, float] = _USUAL.mass
    """Range of the factor on each link's mass and inertia [1]. Uniform."""
    random_damping: tuple[float, float] = _USUAL.damping
    """Range of the factor on each joint's damping [1], log-uniform."""
    random_friction: tuple[float, float] = _USUAL.friction
    """Range of the contacts' friction coefficient [1], uniform."""
    arm: str | None = None
    """Arm in place of a plant: twin:NAME, fri://HOST:PORT or grpc://HOST:PORT. It is
    one arm, and mujoco and bullet are addresses, too."""
    approach: bool = False
    """Let an arm behind fri:// go to its first start from afar, slowly. Afar is more
    than 0.15 m or 0.5 rad; it goes up, across and down."""
    fixed_goal: bool = False
    """Keep the fixture where `fixture` says, for an arm that cannot move it."""
    fixture: tuple[float, float, float, float] | None = None
    """Place of its frame: x y z [m], yaw [rad], world axes. Needs `fixed_goal`; default
    the first pose in which the task's policies are tried."""
    from_policy: Annotated[str | None, tyro.conf.arg(name="from")] = None
    """Policy to start from: a file, or the name of a shipped one. For the first
    `learning_starts` steps only the critics learn; then the actor does at a tenth of
    their rate, and goes back to the one whose episodes went best if its own go badly.
    The best one is what the run ends with."""
    demos: Annotated[tuple[str, ...], some_paths("--demos")] = ()
    """Episode logs, or folders of them, whose steps are in every batch. See `pretrain`.
    A person's or anybody's, of the same task, robot and meaning of an action."""
    teacher: str = "none"
    """Who acts in the first `learning_starts` steps: none, corner, or logs. None is
    chance; corner the scripted search, with noise; logs are as `demos`."""
    teacher_noise: Annotated[float, Range(0.0, 1.0, "1")] = 0.08
    """Standard deviation of the noise on a teacher's actions [1]."""
    teacher_share: Annotated[float | None, Range(0.0, 1.0, "1")] = None
    """Share of each batch that was shown [1]: 0.5, after `pretrain` 0.2. The teacher
    or `demos` show it; what was learned from them already needs less of them."""
    steps: Annotated[int, Range(1, 1e9, "steps")] = 60_000
    """Environment steps at most; see `until`."""
    until: Annotated[float | None, Range(0.0, 1.0, "1")] = None
    """Success that ends the run before `steps` [1]: 0.98, on an arm 1 (never).
    It is the lower end of the Wilson 95 % interval over `test_episodes`. An arm's time
    would go into the tests."""
    test_episodes: Annotated[int, Range(1, 1e6, "episodes")] = 300
    """Episodes of a test, without exploration; see `until`."""
    settle: Annotated[int, Range(1, 1e9, "steps")] = 8000
    """Steps in which the rate falls once nine of ten episodes succeed.
    Then the first test is made, and others after half as many steps each."""
    seed: Annotated[int, Range(0, 2**31 - 1, "1")] = 0
    """Seed of everything random, with `seeds` of the first run."""
    seeds: Annotated[int, Range(1, 1000, "runs")] = 1
    """Runs with seeds seed, seed + 1, ..., as many at once as cores."""
    threads: Annotated[int, Range(0, 256, "threads")] = 0
    """Threads that simulate them, with MuJoCo only; 0 is one for each core. These are
    the cores that this process may use, shared by `seeds`. What is learnt is the same
    with any number."""
    checkpoint_interval: Annotated[int, Range(1, 1e9, "steps")] = 5000
    """Steps between checkpoints: the most that a kill can lose."""
    eval_episodes: Annotated[int, Range(0, 1e6, "episodes")] = 200
    """Episodes of the evaluation at the end; 0 leaves it out."""

    def __post_init__(self) -> None:
        """Refuse what cannot be trained, by name and range."""
        if self.out is not None:
            object.__setattr__(self, "out", Path(self.out))
        self._fill_in()
        check_ranges(self)
        object.__setattr__(self, "period", require_period(self.period, "period"))
        self.require_learner()
        split_settings(self.task_class, self.given())
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
            object.__setattr__(self, "fixture", place[1:5])
        self._require_test()
        self._require_batch()
        self._require_dynamics()
        self._require_teacher()
        self.require_variation(self.num_envs)
        if self.tare:  # a policy must not ask for what cannot be done with it
            task = TaskSpec.parse(self.env_options()["task"])
            tared_axes(task, self.force_damping)

    def _fill_in(self) -> None:
        """Choose what is not given."""
        if self.arm is not None:
            object.__setattr__(self, "num_envs", 1)
        if self.script == "none":
            object.__setattr__(self, "script", None)
        for name, value in self._usual().items():
            if vars(self)[name] is None:
                object.__setattr__(self, name, value)

    def _usual(self) -> dict[str, float]:
        """Return what depends on other settings."""
        is_arm = self.arm is not None
        is_quick = self.algorithm == "sac" and not is_arm and self.from_policy is None
        first = 2000 if self.demos and self.from_policy is None else 0
        asked = first if self.pretrain is None else self.pretrain
        return {
            "pretrain": first,
            "until": 1.0 if is_arm else 0.98,
            "updates_per_step": 2.0 if is_arm else 0.5,
            "learning_rate": 2e-3 if is_quick else 1e-3,
            "teacher_share": 0.2 if asked else 0.5,
        }

    def _require_test(self) -> None:
        """Refuse a test that nothing could pass, or for which there is no arm."""
        until, count = self.asked_success, self.test_episodes
        most = wilson_interval(count, count)[0]
        if most < until < 1.0:
            raise ConfigError(
                f"until is {until:g}, but {count} episodes of {count} show only "
                f"{most:.4f}: raise --test-episodes, or give --until 1 for all steps"
            )
        if until < 1.0 and self.arm is not None and not parse_address(self.arm).is_here:
            raise ConfigError(
                f"until is {until:g}, but there is one arm at {self.arm}, and a test "
                "would break into its episodes: leave until out, or give 1"
            )

    def _require_batch(self) -> None:
        """Refuse threads that would do nothing."""
        if self.threads > 1 and not self._is_here_in_mujoco:
            raise ConfigError(
                f"threads is {self.threads}, but only MuJoCo in this process simulates "
                f"several environments at once, not {self.arm or self.plant}: leave "
                "threads out, or give --plant mujoco"
            )

    def _require_teacher(self) -> None:
        """Refuse a teacher that would not act, and demonstrations without a buffer."""
        if self.informed and (self.algorithm != "sac" or self.logs):
            raise ConfigError(
                "informed critics are told the truth, which no log has and only sac "
                "takes: leave --informed out, or give no --demos and --algorithm sac"
            )
        if self.script is not None and (self.logs or self.algorithm == "ppo"):
            raise ConfigError(
                f"with --script {self.script} an action is a correction, which no log "
                "has, and which ppo does not begin small: leave --demos out, give "
                "--teacher corner or none, and one of sac, tqc, crossq, td3 and ddpg"
            )
        self.require_used("correction", self.script is not None, "--script corner")
        can_tilt = self.env_options()["task"] == SCRIPT_SETTINGS["task"]
        self.require_used("fall_back", can_tilt, f"--task '{SCRIPT_SETTINGS['task']}'")
        self.require_used("teacher_noise", self.has_teacher, "--teacher corner")
        is_shown = self.has_teacher or self.logs
        if not is_shown and self.teacher_share != self._usual()["teacher_share"]:
            raise ConfigError("teacher_share is given: it needs a teacher or --demos")
        on_policy = self.algorithm == "ppo" and is_shown
        if on_policy or (self.has_teacher and self.from_policy):
            raise ConfigError(
                "a teacher and demonstrations fill a replay buffer before anything is "
                "learned: that is for sac, tqc, crossq, td3 and ddpg, a teacher's from "
                "the start; give --teacher none, and with ppo no --demos"
            )
        if self.pretrain and (not self.logs or self.from_policy):
            raise ConfigError(
                f"pretrain is {self.pretrain}, which needs demonstrations and an actor "
                "that is new: give --demos LOGS and no --from, or leave it out"
            )

    def _require_dynamics(self) -> None:
        """Read the model, and refuse dynamics that nothing would simulate."""
        if self.model is not None:
            object.__setattr__(self, "model", Path(self.model))
        for name in ("model", "randomise_dynamics"):
            if self.arm is not None and vars(self)[name]:
                raise ConfigError(
                    f"arm and {name} exclude each other: the arm at {self.arm} has its "
                    "own dynamics; give --plant in place of --arm"
                )
        ranges = self.dynamics_randomisation
        if ranges != _USUAL and not self.randomise_dynamics:
            raise ConfigError(
                "a range of random dynamics is given, which needs --randomise-dynamics"
            )
        _ = self.model_file

    @property
    def folder(self) -> Path:
        """The run folder, absolute.

        Raises:
            ConfigError: None is given.
        """
        if self.out is None:
            raise ConfigError(
                "out is not given: say with --out FOLDER where the run is (a training "
                "prints its folder when it begins)"
            )
        return self.out.expanduser().absolute()

    @property
    def _is_here_in_mujoco(self) -> bool:
        return self.arm is None and self.plant == "mujoco"

    @property
    def is_batch(self) -> bool:
        """Whether the environments are stepped at the same time."""
        has_threads = self.threads != 1 and self.num_envs > 1
        return has_threads and self._is_here_in_mujoco

    @property
    def asked_success(self) -> float:
        """Success that ends the run before `steps` [1]; 1 for never."""
        return 1.0 if self.until is None else self.until

    @cached_property
    def model_file(self) -> ModelFile | None:
        """The model's content when these settings were made."""
        return None if self.model is None else ModelFile.load(self.model.expanduser())

    @property
    def has_teacher(self) -> bool:
        """Whether the first steps are a script's."""
        return self.teacher == "corner"

    @property
    def logs(self) -> tuple[str, ...]:
        """Episode logs that are in every batch."""
        is_log = self.teacher not in ("none", "corner")
        return (*self.demos, *((self.teacher,) if is_log else ()))

    @property
    def dynamics_randomisation(self) -> DynamicsRandomisation:
        """The ranges as the environment takes them."""
        return DynamicsRandomisation(
            gravity=self.random_gravity,
            mass=self.random_mass,
            damping=self.random_damping,
            friction=self.random_friction,
        )

    def _require_arm(self, text: str) -> None:
        """Refuse what the one arm cannot do."""
        arm = parse_address(text)
        usual = TrainConfig.period
        asked = None if self.period == usual else self.period
        object.__setattr__(self, "period", arm.control_period(asked, usual))
        if self.seeds > 1 and not arm.is_here:
            raise ConfigError(
                f"seeds is {self.seeds}, but there is one arm at {text}; train one "
                "seed after the other, each with its own --out"
            )
        if self.force_weight > 0.0 and not arm.measures_contact:
            raise ConfigError(
                f"force_weight is {self.force_weight:g}, but FRI does not measure "
                "contact force; needs 0"
            )
        if not arm.places_fixture and self.fixture is None:
            raise ConfigError(
                f"the arm at {text} cannot move the fixture: add --fixed-goal and say "
                "where it is with --fixture X Y Z YAW [m, rad]"
            )

    @property
    def fixed_place(self) -> FixturePose | None:
        """Where the fixture stays; None where each episode draws it."""
        if not self.fixed_goal:
            return None
        usual = self.task_class.trial_poses[0]
        return FixturePose.given(self.fixture or usual[1:5], usual.facing)

    def for_seed(self, seed: int) -> "TrainConfig":
        """Return the run of one of several seeds, in its own sub-folder."""
        return replace(self, seed=seed, seeds=1, out=self.folder / f"seed-{seed}")

    def to_json(self) -> dict[str, Any]:
        """Return every setting that decides the result, as JSON knows it.

        A model is given by its table: the same content in another file is the same.
        """
        values = {f.name: vars(self)[f.name] for f in fields(self)}
        values |= values.pop("task_options") | self.own()
        if self.model_file is not None:
            values["model"] = self.model_file.table()
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
            if name not in _NOT_COMPARED
        }

    def require_same(self, other: dict[str, Any]) -> None:
        """Refuse to continue a run that was started with other settings.

        Args:
            other: `to_json` of the run's own settings.

        Raises:
            ConfigError: Names the field and both values.
        """
        mine = _flat(self.to_json())
        usual = TrainConfig(env=self.env).to_json()
        other = _flat(usual) | _flat(other)  # from before an option
        if not other["fixed_goal"]:
            other["fixture"] = None  # older versions write a place all the same
        for name in {**mine, **other}:
            if mine.get(name) != other.get(name):
                raise ConfigError(
                    f"cannot resume {self.out}: {name} is {mine.get(name)!r}, the run "
                    f"was started with {other.get(name)!r}; give {name} the "
                    "run's value or choose another --out"
                )

    def command(self) -> str:
        """Return the command line that trains with these settings."""
        searching = SEARCHING if self.doubt > 0.0 else {}
        default = TrainConfig(env=self.env, **searching).to_json()
        default |= {k: v for k, v in self._usual().items() if k not in searching}
        default["env"] = TrainConfig.env
        words = ["dovetail", "train"]
        for name, value in self.to_json().items():
            if value == default[name]:
                continue
            option = _OPTIONS.get(name, name).replace("_", "-")
            if name == "model":
                words += ["--model", str(self.model)]
            elif name == "period":
                words += ["--period", format_period(value)]
            elif isinstance(value, bool):
                words.append(f"--{option}" if value else f"--no-{option}")
            else:
                values = value if isinstance(value, list) else [value]
                words += [f"--{option}", *map(str, values)]
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
