"""Go on from a trained policy: its weights become the new run's first actor."""

import math
from collections.abc import Mapping
from typing import Any

from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import PolicyError
from dovetail.learn.config import TrainConfig
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.spaces import require_spaces

START_STD = 0.2
"""Standard deviation of the exploring actor's first actions, before tanh [1]: a fresh
actor's 1.0 would drown what the policy knows."""


def load_start(config: TrainConfig) -> Policy | None:
    """Return the policy that a run starts from, or None when it starts from nothing.

    What the settings alone decide is checked here, before the learning stack is
    imported; the rest by `require_fit`.

    Args:
        config: Settings of the run.

    Raises:
        ConfigError: No such policy.
        PolicyError: It is not one for these settings; says what to change.
    """
    if config.from_policy is None:
        return None
    policy = Policy.load(find_policy(config.from_policy))
    try:
        _require_settings(policy, config)
    except PolicyError as error:
        raise _refused(config, error) from error
    return policy


def require_fit(policy: Policy, config: TrainConfig, env: Any) -> None:
    """Refuse a policy whose observation or action is not an environment's.

    Args:
        policy: What `load_start` gave.
        config: Settings of the run.
        env: One environment of the run.

    Raises:
        PolicyError: Says what to change.
    """
    try:
        _require_sizes(policy, env)
        require_spaces(policy.metadata, env)
    except PolicyError as error:
        raise _refused(config, error) from error


def _refused(config: TrainConfig, error: PolicyError) -> PolicyError:
    return PolicyError(f"cannot start from {config.from_policy}: {error}")


def _require_settings(policy: Policy, config: TrainConfig) -> None:
    policy.require_env(config.env, config.env_options())
    hidden = tuple(int(weight.shape[1]) for weight, _ in policy.layers[:-1])
    if hidden != config.net:
        raise PolicyError(
            f"its hidden layers have widths {hidden}, this run's {config.net}; add "
            f"--net {' '.join(map(str, hidden))}"
        )
    network = policy.metadata["network"]
    kind = ("tanh", "clip") if config.algorithm == "ppo" else ("relu", "tanh")
    if (network["activation"], network["output"]) != kind:
        raise PolicyError(
            f"its layers use {network['activation']} and its output "
            f"{network['output']}, those of {config.algorithm} {kind[0]} and "
            f"{kind[1]}; policies of ppo go on with ppo, the others with sac, tqc, "
            "td3 or ddpg"
        )


def _require_sizes(policy: Policy, env: Any) -> None:
    size = int(env.observation_space.shape[0])
    if policy.observation_size != size:
        raise PolicyError(
            f"it takes {policy.observation_size} observations, this run's environment "
            f"gives {size}; give the stack it was trained with"
        )
    num_axes = len(require_contact_env(env).commands)
    if policy.action_size != num_axes:
        raise PolicyError(
            f"it gives {policy.action_size} actions, this run's environment takes "
            f"{num_axes}; give the task it was trained with"
        )


def start_from(model: Any, policy: Policy) -> None:
    """Put a policy's weights into a freshly built SBX algorithm's actor.

    Where the actor explores by a standard deviation of its own, that becomes
    `START_STD`. The critics stay as they are: new.

    Args:
        model: SBX algorithm whose actor has the policy's shape.
        policy: A policy that `load_start` and `require_fit` accepted.
    """
    import jax.numpy as jnp

    _put(
        model,
        {
            f"Dense_{i}": {"kernel": jnp.array(weight), "bias": jnp.array(bias)}
            for i, (weight, bias) in enumerate(policy.layers)
        },
    )


def start_still(model: Any) -> None:
    """Let a freshly built SBX algorithm's actor begin with zeros, and explore a little.

    Args:
        model: SBX algorithm.
    """
    layers = _layers(model.policy.actor_state)
    last = f"Dense_{len(model.policy.net_arch_pi)}"
    _put(model, {last: _constant(layers[last], 0.0)})


def _layers(state: Any) -> dict[str, Any]:
    return dict(state.params.get("params", state.params))


def _put(model: Any, changed: Mapping[str, Any]) -> None:
    """Change layers of the actor, and let it explore by `START_STD`."""
    import jax.numpy as jnp

    state = model.policy.actor_state
    is_nested = "params" in state.params
    layers = _layers(state) | dict(changed)
    head = f"Dense_{max(int(name.rpartition('_')[2]) for name in changed) + 1}"
    if head in layers:
        layers[head] = _constant(layers[head], math.log(START_STD))
    if "log_std" in layers:
        layers["log_std"] = jnp.full_like(layers["log_std"], math.log(START_STD))
    params = {**state.params, "params": layers} if is_nested else layers
    changes = {"params": params}
    if "target_params" in vars(state):
        changes["target_params"] = params
    model.policy.actor_state = state.replace(**changes)


def _constant(layer: Mapping[str, Any], value: float) -> dict[str, Any]:
    """Return a dense layer that gives `value` for every input."""
    import jax.numpy as jnp

    return {
        "kernel": jnp.zeros_like(layer["kernel"]),
        "bias": jnp.full_like(layer["bias"], value),
    }
