"""Policies that were trained without `dovetail train`, as files of dovetail."""

import hashlib
import io
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from dovetail.control.sections import settings_in
from dovetail.envs.config import ENDLESS
from dovetail.envs.registered import task_class
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError, PolicyError
from dovetail.learn.env_settings import EnvSettings
from dovetail.learn.export import commit, versions
from dovetail.learn.gru import Gru
from dovetail.learn.policy import Layer, Policy
from dovetail.learn.sb3_file import Actor, read_actor
from dovetail.learn.spaces import describe_spaces
from dovetail.tasks.options import gather_options, option_types

TOLERANCE = 1e-4
"""Largest difference between the exported policy's actions and the model's [1]."""


def settings_of_env(env: gymnasium.Env) -> EnvSettings:
    """Return the settings of an environment that `gymnasium.make` built.

    Raises:
        ConfigError: No environment of dovetail, or one that was built by its class.
    """
    spec = env.spec
    if spec is None:
        raise ConfigError(
            "the environment does not know its own settings: build it by "
            'gymnasium.make("dovetail/...", ...)'
        )
    task = task_class(spec.id)
    known = {*settings_in(EnvSettings), *option_types(task)}
    given = {n: v for n, v in spec.kwargs.items() if n in known and v is not None}
    length = spec.max_episode_steps or require_contact_env(env).max_steps
    if length != ENDLESS:
        given["max_steps"] = length
    return EnvSettings.of(env=spec.id, **gather_options(given, task))


def make_policy(
    layers: list[Layer],
    env: gymnasium.Env,
    *,
    activation: str,
    output: str,
    memory: tuple[Gru, int] | None = None,
    provenance: Mapping[str, Any] | None = None,
    settings: EnvSettings | None = None,
) -> Policy:
    """Return weights from anywhere as a policy for an environment.

    Args:
        layers: Weight (inputs, outputs) and bias of each dense layer.
        env: The environment that it acts in, built by `gymnasium.make`.
        activation: Between the layers, relu or tanh.
        output: After the last one: tanh, or clip to [-1, 1].
        memory: A GRU, and the number of the layer that takes its state.
        provenance: Where the weights come from.
        settings: Of the environment; None are its own, by `settings_of_env`.

    Raises:
        PolicyError: The layers do not fit one another, or the environment.
        ConfigError: See `settings_of_env`.
    """
    settings = settings or settings_of_env(env)
    network: dict[str, Any] = {
        "layers": [list(weight.shape) for weight, _ in layers],
        "activation": activation,
        "output": output,
    }
    if memory is not None:
        network["memory"] = memory[0].describe() | {"before": memory[1]}
    metadata = {
        "network": network,
        "env_id": settings.env,
        "env": settings.policy_env(),
        **describe_spaces(env),
        "provenance": {
            **(provenance or {}),
            "date": datetime.now(UTC).date().isoformat(),
            "versions": versions(),
            "commit": commit(),
        },
    }
    policy = Policy(layers, metadata, None if memory is None else memory[0])
    size = env.observation_space.shape or ()
    policy.require_size(np.zeros(size), env.action_space.shape or ())
    return policy


def import_file(path: Path, env: gymnasium.Env, settings: EnvSettings) -> Policy:
    """Return the policy in a model.zip of Stable-Baselines3 or SBX; runs none of it.

    Args:
        path: The file.
        env: The environment that it was trained in.
        settings: Its settings, which the file does not tell.

    Raises:
        PolicyError: No such model, or one that does not fit the environment.
    """
    actor = read_actor(path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    file = {"model_file": path.name, "model_sha256": digest}
    return _policy_of(actor, env, file, settings)


def import_model(model: Any, env: gymnasium.Env) -> Policy:
    """Return the policy of a model of Stable-Baselines3 or SBX in this process.

    Args:
        model: The algorithm, such as `stable_baselines3.PPO`.
        env: One environment that it was trained in, built by `gymnasium.make`.

    Raises:
        PolicyError: A network that cannot be run here, one trained on observations that
            VecNormalize changed, or actions that differ from `model.predict`.
    """
    normalise = model.get_vec_normalize_env()
    if normalise is not None and normalise.norm_obs:
        raise PolicyError(
            "the model sees observations through VecNormalize, which a policy file "
            "does not hold; dovetail's are scaled already: train with norm_obs=False"
        )
    buffer = io.BytesIO()
    model.save(buffer)
    buffer.seek(0)
    policy = _policy_of(read_actor(buffer), env, {}, None)
    _require_same_actions(policy, model)
    return policy


def _policy_of(
    actor: Actor,
    env: gymnasium.Env,
    file: Mapping[str, Any],
    settings: EnvSettings | None,
) -> Policy:
    return make_policy(
        actor.layers,
        env,
        activation=actor.activation,
        output=actor.output,
        provenance={**file, **actor.facts},
        settings=settings,
    )


def _require_same_actions(policy: Policy, model: Any) -> None:
    rng = np.random.default_rng(0)
    observations = rng.uniform(-3.0, 3.0, (50, policy.observation_size)).astype("f4")
    wanted, _ = model.predict(observations, deterministic=True)
    actions = np.array([policy(observation) for observation in observations])
    worst = float(np.abs(actions - wanted).max())
    if not worst <= TOLERANCE:
        raise PolicyError(
            f"the exported policy's actions differ by up to {worst:.2g} from "
            f"model.predict; allowed: {TOLERANCE:g}. Please report the model's policy "
            "class and policy_kwargs"
        )
