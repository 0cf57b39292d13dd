"""From a trained SBX model to a Policy: the actor's layers and their provenance."""

import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.distribution import installed_version
from dovetail.errors import PolicyError
from dovetail.learn.config import TrainConfig
from dovetail.learn.policy import Layer, Policy
from dovetail.learn.spaces import describe_spaces

_RENORM_EPSILON = 1e-3  # sbx.common.jax_layers.BatchRenorm
_PACKAGES = (
    *("dovetail", "numpy", "mujoco", "pybullet", "gymnasium"),
    *("sbx-rl", "stable-baselines3", "jax", "flax", "optax"),
)


def export_policy(
    model: Any, config: TrainConfig, env: Any, *, wall_time: float
) -> Policy:
    """Return the model's deterministic policy with all that is needed to use it.

    Args:
        model: SBX algorithm.
        config: Settings of the run.
        env: One environment of the run.
        wall_time: Time spent training [s].
    """
    bare, model_file = current_policy(model, config), config.model_file
    metadata = {
        **bare.metadata,
        "env_id": config.env,
        "env": config.policy_env(),
        **describe_spaces(env),
        "provenance": {
            "command": config.command(),
            "algorithm": config.algorithm,
            "seed": config.seed,
            "steps": int(model.num_timesteps),
            "wall_time_s": round(wall_time, 1),
            "date": datetime.now(UTC).date().isoformat(),
            "versions": versions(),
            "commit": commit(),
            "config": config.to_json(),
            "model": model_file and model_file.describe(),
        },
    }
    return Policy(bare.layers, metadata)


def current_policy(model: Any, config: TrainConfig, actor: Any = None) -> Policy:
    """Return the model's deterministic policy alone, to be run here and now.

    Args:
        model: SBX algorithm.
        config: Settings of the run.
        actor: Its weights and optimiser, as SBX has them; None is the model's own.
    """
    layers = actor_layers(model, actor)
    is_ppo = config.algorithm == "ppo"
    network = {
        "layers": [list(weight.shape) for weight, _ in layers],
        "activation": "tanh" if is_ppo else "relu",
        "output": "clip" if is_ppo else "tanh",
    }
    return Policy(layers, {"network": network})


def actor_layers(model: Any, state: Any = None) -> list[Layer]:
    """Return the dense layers of an SBX actor up to the mean's head.

    Args:
        model: SBX algorithm.
        state: The actor's weights and optimiser, as SBX has them; None is the model's.
    """
    state = model.policy.actor_state if state is None else state
    params = state.params.get("params", state.params)
    count = len(model.policy.net_arch_pi) + 1
    return flax_layers(params, vars(state).get("batch_stats", {}), count)


def flax_layers(
    params: Mapping[str, Any], stats: Mapping[str, Any], count: int
) -> list[Layer]:
    """Return the first dense layers of an SBX actor; its deviation's may follow.

    CrossQ's batch renormalisation stands before each dense layer and is affine outside
    training (running statistics), so it is folded into that layer.

    Args:
        params: The actor's parameters, by module.
        stats: Running statistics of its batch renormalisations.
        count: Number of layers.

    Raises:
        PolicyError: Other modules, or missing ones.
    """
    dense = [f"Dense_{i}" for i in range(count)]
    renorm = [f"BatchRenorm_{i}" for i in range(count)]
    beside = (f"Dense_{count}", "log_std")
    if strange := set(params) - {*dense, *renorm, *beside}:
        raise PolicyError(
            f"the actor has the modules {', '.join(sorted(strange))[:200]}; only dense "
            "layers, with or without batch renormalisation, can be exported"
        )
    layers: list[Layer] = []
    try:
        for name, norm in zip(dense, renorm, strict=True):
            weight = np.asarray(params[name]["kernel"], dtype=np.float64)
            bias = np.asarray(params[name]["bias"], dtype=np.float64)
            if norm in params:
                scale, shift = _affine(params[norm], stats[norm])
                bias = bias + shift @ weight
                weight = scale[:, None] * weight
            layers.append((weight.astype(np.float32), bias.astype(np.float32)))
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise PolicyError(f"the actor's parameters are damaged: {error}") from error
    return layers


def _affine(
    params: Mapping[str, Any], stats: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Return scale and shift of a batch renormalisation outside training."""
    mean = np.asarray(stats["mean"], dtype=np.float64)
    variance = np.asarray(stats["var"], dtype=np.float64)
    scale = np.asarray(params["scale"]) / np.sqrt(variance + _RENORM_EPSILON)
    return scale, np.asarray(params["bias"]) - mean * scale


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that shape the result."""
    python = {"python": platform.python_version()}
    return python | {package: installed_version(package) for package in _PACKAGES}


def commit() -> str | None:
    """Return the git commit of this source tree, or None where there is none.

    "-dirty" is appended when tracked files differ from it.
    """
    try:
        done = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None
