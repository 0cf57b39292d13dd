"""The learning algorithms, on Stable-Baselines3, from one config; all but gps SBX's."""

import os
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from dovetail.arms.address import parse_address
from dovetail.errors import MissingDependencyError, install_command
from dovetail.learn.config import TrainConfig
from dovetail.learn.demonstrations import fill, load_demonstrations, rows_of
from dovetail.learn.teacher import Teacher, taught
from dovetail.tasks.reward import RewardConfig

ACTOR_SHARE = 0.1
"""Share of the learning rate for the actor of a run that starts from a policy, or that
corrects a script [1]: what it does well from the start it forgets ten times slower,
while its critics learn at full rate."""

_LARGEST_BUFFER = 1_000_000
_WITH_ENTROPY = ("sac", "tqc", "crossq")


def derive_seed(*numbers: int) -> int:
    """Return a seed of 31 bits that is far from those of neighbouring numbers."""
    return int(np.random.SeedSequence(numbers).generate_state(1)[0] >> 1)


def limit_threads() -> None:
    """Keep the numerical libraries to one thread; call before their first import.

    Networks this small gain nothing from more, and several seeds share the cores.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ.setdefault(
        "XLA_FLAGS",
        "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    )


def import_sbx() -> Any:
    """Import SBX on one thread, or say how to get it.

    Raises:
        MissingDependencyError: The extra `learn` is not installed.
    """
    limit_threads()
    try:
        import sbx
        import torch
    except ImportError as error:
        raise MissingDependencyError(
            f"training needs more packages ({error}): {install_command('learn')}"
        ) from error
    torch.set_num_threads(1)
    return sbx


def make_vec_env(config: TrainConfig) -> Any:
    """Return `num_envs` environments in this process, rewards scaled for training.

    Episode returns in `info["episode"]` stay unscaled.
    """
    import_sbx()  # takes seconds, for which an arm on the network would have to wait
    from gymnasium.wrappers import TransformReward
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    from dovetail.envs.dynamics_randomisation import RandomDynamics
    from dovetail.envs.fixed_fixture import FixedFixture
    from dovetail.envs.registered import make as make_one

    options: dict[str, Any] = {}
    options["reward"] = RewardConfig(force_weight=config.force_weight)
    if config.arm is not None:
        address = parse_address(config.arm)
        options["arm"] = address.with_approach() if config.approach else config.arm
    if config.model_file is not None:
        options |= {"twin": config.model_file.twin, "engine": config.plant}

    def make(index: int) -> Any:
        given = config.varied_options(index) | options
        env = make_one(config.env, **given)
        if config.randomise_dynamics:
            env = RandomDynamics(env, config.ranges)
        if (place := config.fixed_place) is not None:
            env = FixedFixture(env, place.pose())
        return TransformReward(Monitor(env), lambda r: config.reward_scale * float(r))

    makers = [partial(make, index) for index in range(config.num_envs)]
    if config.is_batch:
        from dovetail.learn.batch_vec_env import BatchVecEnv

        return BatchVecEnv(makers, config.threads or None)
    return DummyVecEnv(makers)


def falling_rate(rate: float, final: float, remaining: float) -> float:
    """Return Adam's step size with this share of the training remaining.

    Args:
        rate: Step size during the first half [1].
        final: Share of it at the end [1].
        remaining: From 1 to 0.
    """
    return rate * (final + (1.0 - final) * min(1.0, 2.0 * remaining))


def make_model(
    config: TrainConfig, env: Any, share: Callable[[int], float] = lambda step: 1.0
) -> Any:
    """Build the SBX algorithm, its networks drawn from the config's seed.

    Args:
        config: Settings.
        env: Vectorised environment.
        share: Of the learning rate at a step of the run, beside what `steps` says.

    Raises:
        MissingDependencyError: The extra `learn` is not installed.
        LogError: A demonstration cannot be learned from; says which, and what to do.
    """
    if config.algorithm == "gps":
        return _make_gps(config, env, share)
    logs, script = config.logs, config.script
    demos = load_demonstrations(logs, env.envs[0]) if logs else None
    sbx = import_sbx()
    num_seen = env.observation_space.shape[0]
    env = _informed(env, config)
    kind = {
        "sac": sbx.SAC,
        "ppo": sbx.PPO,
        "ddpg": sbx.DDPG,
        "td3": sbx.TD3,
        "tqc": sbx.TQC,
        "crossq": sbx.CrossQ,
    }[config.algorithm]

    is_good = config.from_policy is not None or script is not None
    is_careful = is_good and config.algorithm != "ppo"
    actor_rate = (ACTOR_SHARE if is_careful else 1.0) * config.full_rate
    settings: dict[str, Any] = {
        "learning_rate": _rate(config, actor_rate, share),
        "gamma": config.gamma,
        "batch_size": config.batch_size,
        "seed": derive_seed(config.seed),
        "policy_kwargs": {"net_arch": list(config.net)},
    }
    if config.has_teacher:
        kind = taught(kind)
    if config.algorithm == "ppo":
        settings["n_steps"] = config.rollout_steps
    else:
        count = 0 if demos is None else len(demos)
        settings |= _off_policy_settings(config, env.action_space.shape[0], count)
        settings["policy_kwargs"]["layer_norm"] = config.layer_norm
        if config.algorithm == "sac":
            from dovetail.learn.networks import Critics, SbxActor

            actor = partial(SbxActor, num_seen=num_seen)
            kinds = {"actor_class": actor, "vector_critic_class": Critics}
            settings["policy_kwargs"] |= kinds
            settings["policy_delay"] = config.policy_delay
        if is_careful:
            settings["qf_learning_rate"] = config.full_rate
    model = kind("MlpPolicy", env, **settings)
    if script is not None:
        from dovetail.learn.fine_tune import start_still

        start_still(model)
    if config.has_teacher:
        seed = derive_seed(config.seed, 3)
        model.teacher = Teacher(env.envs, config.teacher_noise, seed)
    if demos is not None:
        fill(model.replay_buffer, demos, config.reward_scale)
    return model


def _rate(
    config: TrainConfig, full: float, share: Callable[[int], float]
) -> Callable[[float], float]:
    """Return the learning rate for the share of the training that remains."""

    def rate(remaining: float) -> float:
        falling = falling_rate(full, config.final_rate, remaining)
        settling = full * share(round(config.steps * (1.0 - remaining)))
        return min(falling, settling)

    return rate


def _make_gps(config: TrainConfig, env: Any, share: Callable[[int], float]) -> Any:
    """Build guided policy search."""
    import_sbx()
    from dovetail.learn.gps.learner import GPS, GpsSettings

    settings = GpsSettings(
        conditions=config.conditions,
        horizon=config.horizon,
        kl_step=config.kl_step,
        updates_per_step=config.updates_per_step or 0.0,
        batch_size=config.batch_size,
        net=config.net,
    )
    rate = _rate(config, config.full_rate, share)
    return GPS(env, settings, rate, derive_seed(config.seed))


def _informed(env: Any, config: TrainConfig) -> Any:
    """Return environments that show the truth, where critics are to be told it."""
    if not config.informed:
        return env
    from dovetail.learn.privileged_critic import PrivilegedCritic

    kinds = config.kinds(config.num_envs)
    return PrivilegedCritic(env, kinds)


def _off_policy_settings(
    config: TrainConfig, num_actions: int, num_demos: int
) -> dict[str, Any]:
    num_envs = config.num_envs
    shown = rows_of(num_demos, num_envs)
    own = min(config.steps + num_envs, _LARGEST_BUFFER)
    settings: dict[str, Any] = {
        "buffer_size": own + shown * num_envs,
        "learning_starts": config.learning_starts,
        "n_steps": config.n_steps,
        "train_freq": 1,
        "gradient_steps": config.gradient_steps,
    }
    if config.algorithm != "crossq":  # has no target
        settings["tau"] = config.tau
    if config.has_teacher or num_demos:
        from dovetail.learn.taught_replay import TaughtReplay

        if config.has_teacher:
            shown += config.learning_starts // num_envs

        settings["replay_buffer_class"] = TaughtReplay
        settings["replay_buffer_kwargs"] = {
            "n_steps": config.n_steps,
            "gamma": config.gamma,
            "taught": shown,
            "share": config.teacher_share,
        }
        settings["n_steps"] = 1  # the buffer sums rewards up
    if config.algorithm in _WITH_ENTROPY:
        settings["ent_coef"] = config.entropy_coefficient()
    else:
        from stable_baselines3.common.noise import NormalActionNoise

        spread = np.full(num_actions, config.exploration_noise)
        settings["action_noise"] = NormalActionNoise(np.zeros(num_actions), spread)
    return settings
