"""The actor of a live model of Stable-Baselines3 or SBX, as dense layers."""

from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box

from dovetail.errors import PolicyError
from dovetail.learn.export import actor_layers
from dovetail.learn.policy import ACTIVATIONS, Layer

EXPLORES_BY_SDE = (
    "the model explores by gSDE (use_sde=True), which changes its actor: train with "
    "use_sde=False"
)
ADVICE = (
    "only multilayer perceptrons on the environment's own observation can be exported"
)


class ActorLayers(NamedTuple):
    """The deterministic part of a trained model."""

    layers: list[Layer]
    activation: str
    """Between the layers: relu or tanh."""
    output: str
    """After the last: tanh, or clip to [-1, 1]."""
    facts: dict[str, Any]
    """Policy class and steps, for the provenance."""


def read_actor(model: Any) -> ActorLayers:
    """Return the actor of a model.

    Args:
        model: The algorithm, such as `stable_baselines3.PPO`.

    Raises:
        PolicyError: A network that cannot be run here.
    """
    policy = model.policy
    kind = type(policy)
    facts = {
        "policy_class": f"{kind.__module__}.{kind.__qualname__}"[:200],
        "steps": int(model.num_timesteps),
    }
    space = model.action_space
    if not isinstance(space, Box):
        raise PolicyError(
            f"the model's actions are {space}; only a Box of [-1, 1] can be exported"
        )
    if not (np.all(space.low == -1.0) and np.all(space.high == 1.0)):
        raise PolicyError(
            f"the model's actions are {space}, dovetail's lie in [-1, 1]: train on the "
            "environment itself, without RescaleAction"
        )
    if getattr(model, "use_sde", False):
        raise PolicyError(EXPLORES_BY_SDE)
    read = _from_sbx if hasattr(policy, "actor_state") else _from_torch
    layers, activation, output = read(model)
    if activation not in ACTIVATIONS:
        raise PolicyError(
            f"the model's activation is {activation[:80]!r}; known: "
            f"{', '.join(ACTIVATIONS)}"
        )
    return ActorLayers(layers, activation, output, facts)


def _from_sbx(model: Any) -> tuple[list[Layer], str, str]:
    policy = model.policy
    if policy.features_extractor_class is not None:
        raise _features(policy.features_extractor_class)
    output = "tanh" if policy.squash_output else "clip"
    return actor_layers(model), _name_of(policy.activation_fn), output


def _name_of(activation: Any) -> str:
    """Return the name of an activation, by its values: JAX's functions hide theirs."""
    x = np.linspace(-3.0, 3.0, 13, dtype=np.float32)
    y = np.asarray(activation(x))
    for name, wanted in (("relu", np.maximum(x, 0.0)), ("tanh", np.tanh(x))):
        if np.allclose(y, wanted, atol=1e-6):
            return name
    return str(getattr(activation, "__name__", activation))


def _features(kind: type) -> PolicyError:
    return PolicyError(
        f"the model has the features extractor {kind.__name__}; {ADVICE}"
    )


def _from_torch(model: Any) -> tuple[list[Layer], str, str]:
    from stable_baselines3.common.torch_layers import FlattenExtractor
    from torch import nn

    policy = model.policy
    if policy.features_extractor_class is not FlattenExtractor:
        raise _features(policy.features_extractor_class)
    if hasattr(policy, "action_net"):  # PPO and A2C
        modules = [*policy.mlp_extractor.policy_net, policy.action_net]
    elif hasattr(policy, "actor"):
        latent = getattr(policy.actor, "latent_pi", [])  # SAC; TD3 and DDPG have none
        head = policy.actor.mu
        modules = [*latent, *(head if isinstance(head, nn.Sequential) else [head])]
    else:
        raise PolicyError(f"a {type(policy).__name__} has no actor; {ADVICE}")
    if policy.squash_output and modules and isinstance(modules[-1], nn.Tanh):
        modules.pop()
    dense, between = modules[::2], modules[1::2]
    layers: list[Layer] = []
    for module in dense:
        if type(module) is not nn.Linear:
            raise PolicyError(
                f"the model's actor has a {type(module).__name__}; {ADVICE}"
            )
        weight, bias = module.weight, module.bias
        if bias is None:
            raise PolicyError(f"the model's actor has a layer without bias; {ADVICE}")
        layers.append((weight.detach().cpu().numpy().T, bias.detach().cpu().numpy()))
    names = sorted({type(module).__name__.lower() for module in between})
    activation = " and ".join(names) or ACTIVATIONS[0]
    return layers, activation, "tanh" if policy.squash_output else "clip"
