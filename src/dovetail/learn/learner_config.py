"""The learning algorithm of a training and its settings."""

from typing import Annotated, Literal, Self, get_args

from pydantic import model_validator

from dovetail.errors import ConfigError
from dovetail.settings import Range, defaults_of, names_in, settings

Algorithm = Literal["sac", "ppo", "ddpg", "td3", "tqc", "crossq", "gps"]
ALGORITHMS: tuple[Algorithm, ...] = get_args(Algorithm)


@settings()
class GradientConfig:
    """Gradient steps."""

    updates_per_step: Annotated[float | None, Range(0.01, 64.0, "1")] = None
    """Gradient steps per environment step (not ppo): 0.5, on an arm or with gps 2. An
    arm's steps take more time than what is learned from them."""
    learning_rate: Annotated[float | None, Range(1e-7, 1.0, "1")] = None
    """Step size of Adam [1]: 2e-3 for sac, 1e-3 on an arm or from a policy. It is 1e-3
    for the other algorithms, too."""
    final_rate: Annotated[float, Range(1e-3, 1.0, "1")] = 0.1
    """Share of it at the end, reached from the middle on [1]. The last policy is the
    one that is kept, so it must not be a lucky or unlucky one."""
    batch_size: Annotated[int, Range(2, 65536, "transitions")] = 256
    """Transitions per gradient step."""
    policy_delay: Annotated[int, Range(1, 100, "steps")] = 2
    """Gradient steps of the critics for one of the actor (sac)."""
    tau: Annotated[float, Range(1e-6, 1.0, "1")] = 0.01
    """Share by which a target follows its critic per gradient step [1].
    Not ppo, crossq and gps."""

    @property
    def full_rate(self) -> float:
        """Step size of Adam before it falls [1]."""
        return 0.0 if self.learning_rate is None else self.learning_rate


@settings()
class ReturnConfig:
    """The sum of rewards that it learns."""

    n_steps: Annotated[int, Range(1, 100, "steps")] = 3
    """Rewards summed up before the critic's own estimate (not ppo, gps). More than 1
    carries the bonus faster from the fixture to the way there."""
    gamma: Annotated[float, Range(0.0, 0.99999, "1")] = 0.97
    """Discount per 50 ms step (not gps) [1]. It looks as far ahead as an insertion
    takes: with 0.99 the critic has to tell millimetres apart in sums over a whole
    episode."""
    reward_scale: Annotated[float, Range(1e-6, 1e6, "1")] = 5.0
    """Factor on the reward inside training. What is reported is unscaled."""
    force_weight: Annotated[float, Range(0.0, 1e3, "1/N")] = 0.0
    """Weight of contact force in the reward [1/N]; 0 is the paper. Not gps."""


@settings()
class GpsConfig:
    """Guided policy search (gps)."""

    conditions: Annotated[int, Range(1, 256, "rollouts")] = 8
    """Rollouts of an iteration, each the middle of a local controller (gps)."""
    horizon: Annotated[int, Range(5, 1000, "steps")] = 80
    """Steps of a rollout at most (gps). An episode ends there, or at `max_steps`."""
    kl_step: Annotated[float, Range(1e-3, 100.0, "nat")] = 1.0
    """Largest KL divergence of new actions from old ones, per step (gps) [nat]."""

    def require_gps(self, algorithm: str) -> None:
        """Refuse a setting of gps that another algorithm would ignore."""
        usual = defaults_of(GpsConfig)
        for name in names_in(GpsConfig):
            if algorithm != "gps" and vars(self)[name] != usual[name]:
                raise ConfigError(f"{name} is given, which needs --algorithm gps")


@settings()
class LearnerConfig(GradientConfig, ReturnConfig, GpsConfig):
    """Learning algorithm."""

    algorithm: Algorithm = "sac"
    """sac, ppo, ddpg, td3, tqc or crossq, of SBX; or gps, guided policy search."""
    net: tuple[int, ...] = (128, 128)
    """Width of each hidden layer, actor and critic alike."""
    layer_norm: bool = True
    """Layer normalisation in the critic (not ppo, gps). It diverges on the bonus
    without."""
    ent_coef: str = "auto_0.1"
    """Entropy coefficient (sac, tqc, crossq), or auto_START. That adapts it."""
    exploration_noise: Annotated[float, Range(0.0, 2.0, "1")] = 0.1
    """Standard deviation of the actions' noise (ddpg, td3) [1]."""
    rollout_steps: Annotated[int, Range(2, 1e6, "steps")] = 512
    """Steps per environment between two updates (ppo)."""

    @model_validator(mode="after")
    def _check_learner_config(self) -> Self:
        """Refuse networks or an entropy coefficient that cannot be."""
        if not self.net or not all(1 <= width <= 8192 for width in self.net):
            raise ConfigError(f"net is {self.net}; allowed: widths of 1 to 8192")
        self.entropy_coefficient()
        self.require_gps(self.algorithm)
        return self

    def entropy_coefficient(self) -> str | float:
        """Return `ent_coef` as SBX takes it: "auto", "auto_START" or a number."""
        start = self.ent_coef.removeprefix("auto").removeprefix("_")
        try:
            value = float(start) if start else 1.0
        except ValueError:
            value = -1.0
        if not 0.0 < value < 1e6:
            raise ConfigError(
                f"ent_coef is {self.ent_coef!r}; allowed: auto, auto_START or a "
                "number, each above 0, e.g. auto_0.1"
            )
        return self.ent_coef if self.ent_coef.startswith("auto") else value
