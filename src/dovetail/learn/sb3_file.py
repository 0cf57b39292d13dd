"""Read the actor out of a model.zip of Stable-Baselines3 or SBX; run nothing of it.

Stable-Baselines3 writes weights as tensors (policy.pth), which PyTorch reads without
unpickling. SBX writes its whole policy as a pickle inside the file `data`; of that only
the numbers are read, see `inert_pickle`. `model.load` of either library would run
whatever the file's author put there.
"""

import base64
import io
import json
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from dovetail.errors import MissingDependencyError, PolicyError, install_command
from dovetail.learn.export import flax_layers
from dovetail.learn.inert_pickle import Inert, attributes, find_array, read_inert
from dovetail.learn.policy import ACTIVATIONS, Layer

_LARGEST = 1 << 30
_PLAIN_FEATURES = "stable_baselines3.common.torch_layers.FlattenExtractor"
_ADVICE = "only multilayer perceptrons on the environment's own observation can be"


class Actor(NamedTuple):
    """The deterministic part of a trained model."""

    layers: list[Layer]
    activation: str
    """Between the layers: relu or tanh."""
    output: str
    """After the last: tanh, or clip to [-1, 1]."""
    facts: dict[str, Any]
    """Policy class, library version and steps, for the provenance."""


def read_actor(source: Path | IO[bytes]) -> Actor:
    """Return the actor of a model that `model.save` wrote.

    Args:
        source: The zip file, or its bytes as a file.

    Raises:
        PolicyError: No such file, no model, or a network that cannot be run here.
        MissingDependencyError: Weights of PyTorch, and PyTorch is not installed.
    """
    try:
        with zipfile.ZipFile(source) as archive:
            data = json.loads(_read(archive, "data"))
            names = archive.namelist()
            weights = _read(archive, "policy.pth") if "policy.pth" in names else b""
            version = _read(archive, "_stable_baselines3_version").decode().strip()
    except (OSError, KeyError, zipfile.BadZipFile, ValueError, RecursionError) as error:
        raise PolicyError(
            f"{source if isinstance(source, Path) else 'the model'} is no model.zip of "
            f"Stable-Baselines3 or SBX: {error}"
        ) from error
    if not isinstance(data, dict):
        raise PolicyError("the model's file `data` is no table")
    if data.get("use_sde"):
        raise PolicyError(
            "the model explores by gSDE (use_sde=True), which changes its actor; "
            f"{_ADVICE} exported: train with use_sde=False"
        )
    _require_unit_actions(data.get("action_space"))
    steps = data.get("num_timesteps")
    facts = {
        "policy_class": _name_of(_entry(data, "policy_class"))[:200],
        "stable_baselines3": version[:40],
        "steps": steps if isinstance(steps, int) else 0,
    }
    if isinstance(data.get("policy"), Mapping):
        return _from_sbx(_entry(data, "policy"), facts)
    if weights:
        return _from_torch(weights, _entry(data, "policy_kwargs"), facts)
    raise PolicyError("the model holds no policy; save it with model.save")


def _read(archive: zipfile.ZipFile, name: str) -> bytes:
    size = archive.getinfo(name).file_size
    if size > _LARGEST:
        raise ValueError(f"{name} has {size} bytes; allowed: {_LARGEST}")
    return archive.read(name)


def _entry(data: Mapping[str, Any], name: str) -> Any:
    """Return an entry of `data`, plain or as an inert record of its pickle."""
    entry = data.get(name)
    if isinstance(entry, Mapping) and ":serialized:" in entry:
        try:
            return read_inert(base64.b64decode(entry[":serialized:"]))
        except (TypeError, ValueError) as error:
            raise PolicyError(f"the model's {name} is damaged: {error}") from error
    return entry


def _name_of(record: Any) -> str:
    """Return the name of a class or a function."""
    if isinstance(record, type) and issubclass(record, Inert):
        return record.origin
    found = attributes(record)
    name = found.get("__name__") or found.get("function_name")
    return str(name or (record.origin if isinstance(record, Inert) else record))


def _require_unit_actions(entry: Any) -> None:
    space = attributes(_entry({"space": entry}, "space"))
    for name, wanted in (("low", -1.0), ("high", 1.0)):
        limit = find_array(space.get(name))
        if limit is not None and not np.allclose(limit, wanted):
            raise PolicyError(
                f"the model's actions have {name} {limit.tolist()}, dovetail's "
                f"{wanted:g}: train on the environment itself, without RescaleAction"
            )


def _activation(record: Any, usual: str) -> str:
    if record is None:
        return usual
    name = _name_of(record).rpartition(".")[2].lower()
    if name not in ACTIVATIONS:
        raise PolicyError(
            f"the model's activation is {name[:80]!r}; known: {', '.join(ACTIVATIONS)}"
        )
    return name


def _require_plain(settings: Mapping[str, Any]) -> None:
    """Refuse a network that looks at the observation through something else."""
    features = settings.get("features_extractor_class")
    if features is not None and _name_of(features) != _PLAIN_FEATURES:
        raise PolicyError(
            f"the model has the features extractor {_name_of(features)[:80]!r}; "
            f"{_ADVICE} exported"
        )


def _from_sbx(policy: Any, facts: dict[str, Any]) -> Actor:
    found = attributes(policy)
    _require_plain(found)
    state = attributes(found.get("actor_state"))
    hidden = found.get("net_arch_pi")
    if not state or not isinstance(hidden, list):
        raise PolicyError(
            f"a model of {facts['policy_class']} has no actor of dense layers; "
            f"{_ADVICE} exported"
        )
    params = _arrays(state.get("params"))
    params = params.get("params", params)
    layers = flax_layers(params, _arrays(state.get("batch_stats")), len(hidden) + 1)
    output = "clip" if "vf_state" in found else "tanh"
    activation = _activation(found.get("activation_fn"), "relu")
    return Actor(layers, activation, output, facts)


def _arrays(tree: Any) -> dict[str, Any]:
    """Return a tree of parameters with arrays in place of inert records."""
    arrays: dict[str, Any] = {}
    for name, entry in attributes(tree).items():
        array = find_array(entry)
        arrays[str(name)] = _arrays(entry) if array is None else array
    return arrays


_PPO = {
    r"mlp_extractor\.policy_net\.(\d+)\.(weight|bias)": 0,
    r"action_net\.(weight|bias)": 1,
}
_SAC = {r"actor\.latent_pi\.(\d+)\.(weight|bias)": 0, r"actor\.mu\.(weight|bias)": 1}
_TD3 = {r"actor\.mu\.(\d+)\.(weight|bias)": 0}
_NOT_ACTING = re.compile(
    r"critic|actor_target\.|value_net\.|mlp_extractor\.value_net\.|log_std$"
    r"|actor\.log_std\."
)


def _from_torch(weights: bytes, settings: Any, facts: dict[str, Any]) -> Actor:
    settings = attributes(settings)
    _require_plain(settings)
    try:
        import torch
    except ImportError as error:
        raise MissingDependencyError(
            f"reading the weights needs PyTorch: {install_command('learn')}"
        ) from error
    try:
        state = torch.load(io.BytesIO(weights), map_location="cpu", weights_only=True)
        arrays = {name: state[name].numpy() for name in state}
    except Exception as error:
        # PyTorch raises whatever its readers of zip and pickle raise.
        raise PolicyError(f"the model's policy.pth cannot be read: {error}") from error
    acting = {n: array for n, array in arrays.items() if not _NOT_ACTING.match(n)}
    is_ppo = "action_net.weight" in acting
    is_sac = "actor.mu.weight" in acting
    patterns = _PPO if is_ppo else _SAC if is_sac else _TD3
    activation = _activation(
        settings.get("activation_fn"), "tanh" if is_ppo else "relu"
    )
    layers = _dense(acting, patterns, facts["policy_class"])
    return Actor(layers, activation, "clip" if is_ppo else "tanh", facts)


def _dense(
    acting: Mapping[str, Any], patterns: Mapping[str, int], policy_class: str
) -> list[Layer]:
    """Return the layers in their order; refuse whatever else would act."""
    found: dict[tuple[int, int], dict[str, Any]] = {}
    for name, array in acting.items():
        for pattern, rank in patterns.items():
            if match := re.fullmatch(pattern, name):
                *number, part = match.groups()
                place = rank, int(number[0]) if number else 0
                found.setdefault(place, {})[part] = array
                break
        else:
            raise PolicyError(
                f"a model of {policy_class} acts by {name[:80]!r}, too; {_ADVICE} "
                "exported"
            )
    layers = []
    for place in sorted(found):
        weight, bias = found[place].get("weight"), found[place].get("bias")
        if weight is None or bias is None or weight.ndim != 2:
            raise PolicyError(
                f"a model of {policy_class} has a layer that is not dense; {_ADVICE} "
                "exported"
            )
        layers.append((weight.T.astype(np.float32), bias.astype(np.float32)))
    if not layers:
        raise PolicyError(
            f"a model of {policy_class} has no actor of dense layers; {_ADVICE} "
            "exported"
        )
    return layers
