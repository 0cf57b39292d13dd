"""A model.zip of Stable-Baselines3 or SBX: what it plainly says, and how it is loaded.

`data` in the zip is JSON. Objects in it are pickles, but their class, and of a space
the numbers, stand beside them as text. That text is enough to refuse what cannot be
exported without loading anything. Loading runs the pickles, so it needs a yes.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from dovetail.archives import open_zip, read_member
from dovetail.errors import (
    MissingDependencyError,
    PolicyError,
    install_command,
)
from dovetail.learn.foreign_actor import ADVICE, EXPLORES_BY_SDE
from dovetail.reading import TEXT_BYTES, parse_json, read_bytes

ZIP_BYTES = 200_000_000
"""Largest model that is read, unpacked [bytes]; [256, 256] of SAC has 4 MB."""

_ALGORITHMS = {
    "stable_baselines3.common.policies": "PPO",  # or A2C
    "stable_baselines3.sac.policies": "SAC",
    "stable_baselines3.td3.policies": "TD3",  # DDPG, too
    "sbx.ppo.policies": "PPO",
    "sbx.sac.policies": "SAC",
    "sbx.td3.policies": "TD3",
    "sbx.tqc.policies": "TQC",
    "sbx.crossq.policies": "CrossQ",
}
"""Algorithm that loads a model, by the module of its policy class."""
_BOX = "<class 'gymnasium.spaces.box.Box'>"
_FLAT = "stable_baselines3.common.torch_layers.FlattenExtractor"
_ELSE = (
    "; where this is right, call dovetail.learn.foreign.import_model in the program "
    "that trained it"
)


class ModelFacts(NamedTuple):
    """Facts that a model.zip states about itself."""

    library: str
    """stable_baselines3 or sbx."""
    algorithm: str
    """Name of the class that loads it."""
    version: str
    """Of Stable-Baselines3."""
    is_on_policy: bool
    """True for an on-policy algorithm; its file shows whether VecNormalize was used."""


def read_facts(path: Path, env: gymnasium.Env) -> ModelFacts:
    """Return the facts that a model.zip states about itself; nothing in it is run.

    Args:
        path: The file.
        env: The environment that it is said to be of.

    Raises:
        PolicyError: No such model, or one that cannot be exported to equal actions.
    """
    data, version = _read_data(path)
    module = str(_entry(data, "policy_class").get("__module__"))
    if module not in _ALGORITHMS:
        raise PolicyError(
            f"the model has a policy class of the module {module[:80]!r}; known: "
            f"{', '.join(_ALGORITHMS)}{_ELSE}"
        )
    if data.get("use_sde") is not False:
        raise PolicyError(EXPLORES_BY_SDE)
    _require_spaces(data, env)
    is_on_policy = "rollout_buffer_class" in data
    if is_on_policy and data.get("_last_original_obs") is not None:
        raise PolicyError(
            "the model was trained on observations that VecNormalize changed, which "
            "the file does not hold: train without VecNormalize, dovetail's "
            f"observations are scaled already{_ELSE}"
        )
    features = str(_entry(data, "policy_kwargs").get("features_extractor_class", _FLAT))
    if _FLAT not in features and features != "None":
        raise PolicyError(
            f"the model has the features extractor {features[:80]!r}; {ADVICE}"
        )
    name = _ALGORITHMS[module]
    if name == "PPO" and "clip_range" not in data:
        name = "A2C"
    return ModelFacts(module.partition(".")[0], name, version, is_on_policy)


def _read_data(path: Path) -> tuple[dict[str, Any], str]:
    try:
        with open_zip(path, ZIP_BYTES) as archive:
            data = parse_json(read_member(archive, "data", TEXT_BYTES), "its `data`")
            name = "_stable_baselines3_version"
            version = read_member(archive, name, 100).decode().strip()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise PolicyError(
            f"{path} is no model.zip of Stable-Baselines3 or SBX: {reason}"
        ) from error
    if not isinstance(data, dict):
        raise PolicyError(f"{path} is no model.zip: its `data` is no table")
    return data, version[:40]


def _entry(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = data.get(name)
    return found if isinstance(found, Mapping) else {}


def _require_spaces(data: Mapping[str, Any], env: gymnasium.Env) -> None:
    for name, own in (
        ("observation", env.observation_space),
        ("action", env.action_space),
    ):
        space = _entry(data, f"{name}_space")
        kind = str(space.get(":type:"))
        if kind != _BOX:
            words = kind.rpartition(".")[2].strip("'>")[:40]
            count = f"({str(space['n'])[:20]})" if "n" in space else ""
            raise PolicyError(
                f"the model's {name}s are {words}{count}, the environment's are "
                f"{own}: such a model cannot be exported, train on the environment's "
                f"own {name}s"
            )
        shape, wanted = space.get("_shape"), list(own.shape or ())
        if shape not in (wanted, str(wanted)):
            raise PolicyError(
                f"the model's {name}s have shape {str(shape)[:40]}, the environment's "
                f"{wanted}: give the settings that it was trained with (task, stack)"
            )
    space = _entry(data, "action_space")
    for bound, wanted in (("low", -1.0), ("high", 1.0)):
        text = str(space.get(bound))
        try:
            values = [float(word) for word in text.strip("[]").split()]
        except ValueError:
            values = []
        if not values or any(value != wanted for value in values):
            raise PolicyError(
                f"the model's actions have {bound} {text[:80]}, dovetail's "
                f"{wanted:g}: train on the environment itself, without RescaleAction"
            )


def load_model(path: Path, facts: ModelFacts) -> Any:
    """Return the algorithm in a model.zip by its library's `load`, which runs pickles.

    Args:
        path: The file; the code in it is run.
        facts: What `read_facts` found.

    Raises:
        MissingDependencyError: The library is not installed.
        PolicyError: It cannot be loaded.
    """
    try:
        import sbx
        import stable_baselines3
    except ImportError as error:
        raise MissingDependencyError(
            f"loading a model needs its library: {install_command('learn')}"
        ) from error
    library: Any = sbx if facts.library == "sbx" else stable_baselines3
    try:
        content = io.BytesIO(read_bytes(path, ZIP_BYTES))
        model = getattr(library, facts.algorithm).load(content, device="cpu")
    except Exception as error:
        # Its readers and the pickles may raise any error.
        raise PolicyError(
            f"{facts.library}.{facts.algorithm} cannot load {path}: "
            f"{type(error).__name__} {error}{_ELSE}"
        ) from error
    return model


def require_raw_observations(model: Any) -> None:
    """Refuse a loaded model whose last observations are not its environment's own.

    An off-policy model does not say whether VecNormalize changed what it saw. Its last
    observations do where they lie outside of the observation space.

    Raises:
        PolicyError: They do.
    """
    last = getattr(model, "_last_obs", None)
    space = model.observation_space
    if last is None or not isinstance(space, gymnasium.spaces.Box):
        return
    seen = np.asarray(last, dtype=float)
    if (seen < space.low - 1e-3).any() or (seen > space.high + 1e-3).any():
        raise PolicyError(
            "the model's last observations lie outside of its observation space, so "
            "that VecNormalize changed what it saw, which the file does not hold: "
            f"train without VecNormalize{_ELSE}"
        )
