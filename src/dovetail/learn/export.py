"""From a trained SBX model to a Policy: the actor's layers and their provenance."""

import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.learn.config import TrainConfig
from dovetail.learn.policy import Layer, Policy

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
    layers = actor_layers(model)
    is_ppo = config.algorithm == "ppo"
    metadata = {
        "network": {
            "layers": [list(weight.shape) for weight, _ in layers],
            "activation": "tanh" if is_ppo else "relu",
            "output": "clip" if is_ppo else "tanh",
        },
        "env_id": config.env,
        "env": config.env_options(),
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
            "model": config.model_file and config.model_file.describe(),
        },
    }
    return Policy(layers, metadata)


def actor_layers(model: Any) -> list[Layer]:
    """Return the dense layers of an SBX actor up to the mean's head.

    CrossQ's batch renormalisation stands before each dense layer and is affine outside
    training (running statistics), so it is folded into that layer.
    """
    state = model.policy.actor_state
    params = state.params
    params = params.get("params", params)
    layers: list[Layer] = []
    for i in range(len(model.policy.net_arch_pi) + 1):
        weight = np.asarray(params[f"Dense_{i}"]["kernel"], dtype=np.float64)
        bias = np.asarray(params[f"Dense_{i}"]["bias"], dtype=np.float64)
        if (name := f"BatchRenorm_{i}") in params:
            scale, shift = _affine(params[name], state.batch_stats[name])
            bias = bias + shift @ weight
            weight = scale[:, None] * weight
        layers.append((weight.astype(np.float32), bias.astype(np.float32)))
    return layers


def _affine(
    params: Mapping[str, Any], stats: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Return scale and shift of a batch renormalisation outside training."""
    mean = np.asarray(stats["mean"], dtype=np.float64)
    variance = np.asarray(stats["var"], dtype=np.float64)
    scale = np.asarray(params["scale"]) / np.sqrt(variance + _RENORM_EPSILON)
    return scale, np.asarray(params["bias"]) - mean * scale


def describe_spaces(env: Any) -> dict[str, Any]:
    """Return size and meaning of observation and action, for the sidecar."""
    core = env.unwrapped
    return {
        "observation": {
            "size": int(env.observation_space.shape[0]),
            "columns": [list(column) for column in core.scaling.columns],
            "scaling": core.scaling.describe(),
        },
        "action": {
            "size": int(env.action_space.shape[0]),
            "axes": list(core.commands.axes),
            "scale": [float(value) for value in core.commands.scale],
        },
    }


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that shape the result."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


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
