"""Policies that were trained without `dovetail train`, as files of dovetail."""

import hashlib
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from dovetail.envs import registered
from dovetail.envs.config import ENDLESS
from dovetail.envs.registered import task_class
from dovetail.errors import ConfigError, PolicyError
from dovetail.learn.export import commit, versions
from dovetail.learn.foreign_actor import ActorLayers, read_actor
from dovetail.learn.model_zip import (
    ZIP_BYTES,
    load_model,
    read_facts,
    require_raw_observations,
)
from dovetail.learn.policy import Layer, Policy
from dovetail.learn.policy_env_config import PolicyEnvConfig
from dovetail.learn.spaces import describe_spaces
from dovetail.reading import read_bytes
from dovetail.settings import names_in
from dovetail.tasks.options import gather_options, option_types

TOLERANCE = 1e-5
"""Largest difference between the exported policy's actions and the model's [1], with
hidden layers of 256 units together; rounding grows with their number."""
COMPARED = 256
"""Observations on which they are compared."""
_BEYOND = 3.0
"""Largest of these, in half widths of the observation space."""


def settings_of_env(env: Any) -> PolicyEnvConfig:
    """Return the settings of an environment that `gymnasium.make` built.

    Args:
        env: One environment, or a vector environment of Stable-Baselines3.

    Raises:
        ConfigError: No environment of dovetail, or one that was built by its class.
        PolicyError: A wrapper changes its observations or actions.
    """
    is_vector = not isinstance(env, gymnasium.Env)
    _require_unchanged(env, is_vector)
    spec = env.get_attr("spec")[0] if is_vector else env.spec
    if spec is None:
        raise ConfigError(
            "the environment does not know its own settings: build it by "
            'gymnasium.make("dovetail/...", ...)'
        )
    task = task_class(spec.id)
    known = {*names_in(PolicyEnvConfig), *option_types(task)}
    given = {n: v for n, v in spec.kwargs.items() if n in known and v is not None}
    own = (
        env.get_attr("max_steps")[0] if is_vector else env.get_wrapper_attr("max_steps")
    )
    if (length := spec.max_episode_steps or own) != ENDLESS:
        given["max_steps"] = length
    return PolicyEnvConfig(env=spec.id, **gather_options(given, task))


def _require_unchanged(env: Any, is_vector: bool) -> None:
    """Refuse an environment under a wrapper of its observations or actions."""
    wrappers = (gymnasium.ObservationWrapper, gymnasium.ActionWrapper)
    if is_vector:
        found = [k.__name__ for k in wrappers if any(env.env_is_wrapped(k))]
    else:
        found = []
        while isinstance(env, gymnasium.Wrapper):
            found += [type(env).__name__] if isinstance(env, wrappers) else []
            env = env.env
    if found:
        raise PolicyError(
            f"the environment is under {found[0]}, which a policy file does not hold: "
            "train on the environment's own observations and actions"
        )


def make_policy(
    layers: list[Layer],
    env: gymnasium.Env,
    *,
    activation: str,
    output: str,
    provenance: Mapping[str, Any] | None = None,
    settings: PolicyEnvConfig | None = None,
) -> Policy:
    """Return weights from anywhere as a policy for an environment.

    Args:
        layers: Weight (inputs, outputs) and bias of each dense layer.
        env: The environment that it acts in, built by `gymnasium.make`.
        activation: Between the layers, relu or tanh.
        output: After the last one: tanh, or clip to [-1, 1].
        provenance: Where the weights come from.
        settings: Of the environment; None are its own, by `settings_of_env`.

    Raises:
        PolicyError: The layers do not fit one another, or the environment.
        ConfigError: See `settings_of_env`.
    """
    settings = settings or settings_of_env(env)
    metadata = {
        "network": {
            "layers": [list(weight.shape) for weight, _ in layers],
            "activation": activation,
            "output": output,
        },
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
    policy = Policy(layers, metadata)
    size = env.observation_space.shape or ()
    policy.require_size(np.zeros(size), env.action_space.shape or ())
    return policy


def import_file(
    path: Path, env: gymnasium.Env, settings: PolicyEnvConfig, *, is_trusted: bool
) -> Policy:
    """Return the policy in a model.zip of Stable-Baselines3 or SBX.

    Args:
        path: The file.
        env: The environment that it was trained in.
        settings: Its settings, which the file does not tell.
        is_trusted: Whether the library may load the file, which runs what is in it.

    Raises:
        PolicyError: No such model, one that does not fit the environment, or whose
            actions would differ; or a file that is not trusted.
    """
    facts = read_facts(path, env)
    if not is_trusted:
        raise PolicyError(
            f"loading {path} runs code that is in the file: if it is "
            "your own, add --trust; or call dovetail.learn.foreign.import_model in the "
            "program that trained it"
        )
    digest = hashlib.sha256(read_bytes(path, ZIP_BYTES)).hexdigest()
    model = load_model(path, facts)
    require_raw_observations(model)
    file = {"model_file": path.name, "model_sha256": digest}
    file["stable_baselines3"] = facts.version
    if not facts.is_on_policy:
        file["note"] = (
            "the file does not say whether it was trained under VecNormalize: if it "
            "was, the policy acts wrongly; import_model in the training's program knows"
        )
    return _policy_of(model, env, file, settings)


def import_model(model: Any, env: Any) -> Policy:
    """Return the policy of a model of Stable-Baselines3 or SBX in this process.

    Args:
        model: The algorithm, such as `stable_baselines3.PPO`.
        env: The environment that it was trained in, built by `gymnasium.make`, or the
            vector environment of such, as `make_vec_env` makes.

    Raises:
        PolicyError: A network that cannot be run here, one trained on observations that
            VecNormalize changed, or actions that differ from `model.predict`.
    """
    normalise = model.get_vec_normalize_env()
    if normalise is None and not isinstance(env, gymnasium.Env):
        from stable_baselines3.common.vec_env import unwrap_vec_normalize

        normalise = unwrap_vec_normalize(env)
    if normalise is not None and normalise.norm_obs:
        raise PolicyError(
            "the model sees observations through VecNormalize, which a policy file "
            "does not hold; dovetail's are scaled already: train with norm_obs=False"
        )
    settings = settings_of_env(env)
    if (own := model.get_env()) is not None:
        _require_unchanged(own, is_vector=True)
    if isinstance(env, gymnasium.Env):
        return _policy_of(model, env, {}, settings)
    one = registered.make(settings.env, **settings.env_options())
    try:
        return _policy_of(model, one, {}, settings)
    finally:
        one.close()


def _policy_of(
    model: Any, env: gymnasium.Env, file: Mapping[str, Any], settings: PolicyEnvConfig
) -> Policy:
    actor: ActorLayers = read_actor(model)
    policy = make_policy(
        actor.layers,
        env,
        activation=actor.activation,
        output=actor.output,
        provenance={**file, **actor.facts},
        settings=settings,
    )
    require_same_actions(policy, model, env)
    return policy


def require_same_actions(policy: Policy, model: Any, env: gymnasium.Env) -> None:
    """Refuse a policy that acts otherwise than `model.predict`.

    Args:
        policy: The exported policy.
        model: What it was exported of.
        env: Its environment: observations are drawn over its space and beyond.

    Raises:
        PolicyError: Says by how much.
    """
    rng = np.random.default_rng(0)
    space = env.observation_space
    assert isinstance(space, Box)
    width = np.where(np.isfinite(space.high), np.abs(space.high), 10.0)
    reach = np.linspace(0.0, _BEYOND, COMPARED)[:, None] * width
    observations = rng.uniform(-reach, reach).astype(np.float32)
    wanted, _ = model.predict(observations, deterministic=True)
    actions = np.array([policy(observation) for observation in observations])
    if np.shape(wanted) != actions.shape:
        raise PolicyError(
            f"the model's actions have shape {np.shape(wanted)[1:]}, the exported "
            f"policy's {actions.shape[1:]}"
        )
    worst = float(np.abs(actions - wanted).max())
    units = sum(weight.shape[1] for weight, _ in policy.layers[:-1])
    allowed = TOLERANCE * max(1.0, units / 256.0)
    if not worst <= allowed:
        raise PolicyError(
            f"the exported policy's actions differ by up to {worst:.2g} from "
            f"model.predict; allowed: {allowed:g}. Please report the model's policy "
            "class and policy_kwargs"
        )
